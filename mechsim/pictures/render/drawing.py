"""Frames of a motion, drawn in order, with paths and arrows."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.render import gl_backend as backends
from mechsim.pictures.render.drawn_model import DrawnModel, faded
from mechsim.pictures.render.frame_poses import FramePoses, Ghost, frame_poses, ghost_of_run
from mechsim.pictures.render.labels import INK, Notes, Picture, Placement, written
from mechsim.pictures.render.look import Look, changed
from mechsim.pictures.render.scenery import CAMERA, DECOR, Chain, chain, coil, dashpot, put_arrow
from mechsim.shapes.body import fixed_pivots, point_colours
from mechsim.shapes.camera import clearest_pose
from mechsim.shapes.shape import STEEL
from mechsim.shapes.springs import spring_ends

SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
# colour of the arrows from points to those of a ghost
ERROR = (0.75, 0.05, 0.05, 1.0)
# colour of the mark of a loop closure
CLOSURE = np.array([0.85, 0.11, 0.60, 1.0], dtype=np.float32)

# distance of arrows in front of the solid links, in rod radii; see `drawn_model.BEHIND`
BEFORE = 6.0


class Trace:
    """Overlays that are added to the scene of a drawn model in every frame."""

    def __init__(self, drawn: DrawnModel):
        self.drawn, look = drawn, drawn.look
        self.width = 2.4 * look.size[1] / 480.0 / drawn.camera.scale
        colours = point_colours(drawn.mechanism)
        self.paths: dict[str, Chain] = {}
        for name, path in drawn.frames.paths.items():
            colour = np.array(colours[name])
            colour[:3] *= 0.9
            self.paths[name] = chain(path, self.width, colour)

    def put(self, scene: mujoco.MjvScene, frame: int) -> None:
        """Add lines and arrows of a frame to a scene."""
        now, trace = self.drawn.frames, self.drawn.look.trace
        for path in self.paths.values() if trace == "whole" else ():
            path.put(scene)
        every = self.drawn.frames_shown(frame)
        frame = every[-1]
        for name in now.starts.keys() & {*self.drawn.look.closures}:
            for shown in every:
                self._put_mark(scene, now.starts[name][shown])
        self._put_arrows(scene, frame)
        radius = self.drawn.radius
        for end, other, damper in spring_ends(self.drawn.mechanism, self.drawn.look.forces):
            for copy, shown in enumerate(every):
                a, b = (now.position(link, point, shown) for link, point in (end, other))
                colour = faded(STEEL, (copy + 1) / len(every))
                if damper:
                    dashpot(a, b, radius, colour).put(scene)
                else:
                    coil(a, b, 2.0 * radius, 1.5 * self.width, colour).put(scene)
        if trace in ("grow", "tail"):
            self._put_passed(scene, frame, trace == "tail")

    def _put_arrows(self, scene: mujoco.MjvScene, frame: int) -> None:
        """Add the arrows of a frame, and those from tracked points to the same points of a ghost."""
        drawn = self.drawn
        nearer = BEFORE * drawn.radius * drawn.camera.back
        starts = {name: path[frame] + nearer for name, path in drawn.frames.starts.items()}
        for arrows in drawn.arrows:
            arrows.put(scene, starts, frame, 0.45 * drawn.radius)
        for name, (link, point) in drawn.mechanism.points.items():
            if drawn.ghost and link in drawn.ghost.poses:
                tip = drawn.ghost.poses[link].select(frame).point(point) + nearer
                put_arrow(scene, starts[name], tip - starts[name], 0.6 * drawn.radius, ERROR)

    def _put_passed(self, scene: mujoco.MjvScene, frame: int, tail: bool) -> None:
        """Add the paths that the tracked points have passed, or only the last quarter of a turn."""
        now = self.drawn.frames
        last = int(now.passed[frame]) - 1
        for name, path in self.paths.items():
            first = last - len(path) // 4 if tail else 0
            if now.closed and first < 0:
                path.put(scene, len(path) + first)
            path.put(scene, max(0, first), last)
            reached, current = now.paths[name][last], now.points[name][frame]
            if not np.array_equal(reached, current):
                chain(np.array([reached, current]), self.width, path.rgba).put(scene)

    def _put_mark(self, scene: mujoco.MjvScene, position: Array) -> None:
        """Add the mark of a loop closure, in front of all links."""
        if scene.ngeom < scene.maxgeom:
            position = position + 0.5 * self.drawn.camera.height * self.drawn.camera.back
            geom, radii = scene.geoms[scene.ngeom], np.full(3, 0.6 * self.drawn.radius)
            mujoco.mjv_initGeom(geom, SPHERE, radii, position, np.eye(3).ravel(), CLOSURE)
            geom.emission, geom.category = 0.6, DECOR
            scene.ngeom += 1


def frames(
    mechanism: Mechanism,
    motion: Motion,
    look: Look | None = None,
    *,
    angles: ArrayLike | None = None,
    exact: Motion | None = None,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
    every: int = 1,
    **options: Any,
) -> Iterator[Picture]:
    """Yield the frames of a motion, (height, width, 3) each.

    Args:
        mechanism: the mechanism.
        motion: its motion, analytic or simulated; a frame for each sample.
        look: contents of the pictures; None is the default.
        angles: crank angles of the frames in [rad], inside the motion; None draws every sample, or each
            `every`-th.
        exact: the same motion by the closed form, sample by sample; drawn as a ghost over `motion`,
            their difference magnified (see `Look.magnify`) and the factor written on the picture.
        forces: tracked point or joint -> force at each sample, (len(motion), 3) in [N], for `arrows`;
            `dynamics.prescribed(...).forces.reactions[joint].force` are those in the joints.
        moments: likewise moments, in [N m].
        every: number of samples from one frame to the next; paths pass through all of them.
        options: fields of `Look`, in place of the look's own.

    Raises:
        InputError: for an unknown option or camera, or a motion without links.
        MissingToolError: where this machine has no OpenGL.
    """
    drawn = Source(mechanism, motion, exact, forces, moments, every).drawn(changed(look, options), angles)
    return draw(drawn, backends.choose())


def still(
    mechanism: Mechanism,
    motion: Motion,
    look: Look | None = None,
    *,
    angle: float | None = None,
    exact: Motion | None = None,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
    **options: Any,
) -> Picture:
    """Return one picture, framed over the whole motion: at a crank angle in [rad], else in the clearest pose.

    Paths are drawn whole unless a look or `paths` says otherwise; other arguments as for `frames`.
    """
    if look is None:
        options.setdefault("paths", "whole")
    source = Source(mechanism, motion, exact, forces, moments)
    drawn = source.drawn(changed(look, options))
    if angle is not None:
        drawn.show(source.frames([angle]), source.ghost([angle], drawn.ghost.by if drawn.ghost else None))
    view = drawn.camera.right, drawn.camera.up
    posed = angle is None and drawn.look.overlay == 1
    start = clearest_pose(mechanism, drawn.frames.poses, view) if posed else 0
    with closing(draw(drawn, backends.choose(), start)) as pictures:
        return next(pictures)


@dataclass(frozen=True, slots=True)
class Source:
    """The source of frames; see `frames`."""

    mechanism: Mechanism
    motion: Motion
    exact: Motion | None = None
    forces: Mapping[str, ArrayLike] | None = None
    moments: Mapping[str, ArrayLike] | None = None
    every: int = 1

    def drawn(self, look: Look, angles: ArrayLike | None = None) -> DrawnModel:
        """Return the drawn model of all samples, or of given crank angles."""
        if self.exact is not None and look.overlay > 1:
            raise InputError("a ghost over overlaid positions cannot be read; ask for one position")
        shown = self.frames(angles)
        for kind in look.arrows:
            if not shown.vectors.get(kind):
                raise InputError(f"there is no {kind} to draw arrows for; give it with the motion")
        return DrawnModel(self.mechanism, shown, look, self.ghost(angles, look.magnify))

    def frames(self, angles: ArrayLike | None) -> FramePoses:
        """Return the poses at all samples, or at given crank angles."""
        return frame_poses(self.mechanism, self.motion, angles, self.forces, self.moments, self.every)

    def ghost(self, angles: ArrayLike | None, by: float | None) -> Ghost | None:
        """Return the ghost with its error magnified by a factor, or by an automatic one."""
        if self.exact is None:
            return None
        return ghost_of_run(self.mechanism, self.motion, self.exact, angles, self.every, by)


def draw(drawn: DrawnModel, backend: backends.Backend, start: int = 0) -> Generator[Picture]:
    """Yield the frames of a drawn model, from a first one on."""
    look = drawn.look
    count = 1 if look.overlay > 1 else len(drawn.frames)
    trace = Trace(drawn)
    # the lines at the foot of a picture: what the caller says, the ghost, the arrows
    legend = [(look.caption, INK)] if look.caption else []
    legend += [(drawn.ghost.legend, INK)] if drawn.ghost else []
    legend += [arrow_set.legend for arrow_set in drawn.arrows]
    notes = Notes(drawn.mechanism.name, tuple(legend)) if look.notes else None
    clear, stood = 2.2 * drawn.radius, dict[str, Placement]()
    with backends.renderer(drawn.model, look.size, backend) as drawing:
        for frame in range(start, count):
            drawn.set_frame(frame)
            drawing.update_scene(drawn.data, CAMERA)
            trace.put(drawing.scene, frame)
            picture = drawing.render()
            labels = named(drawn, drawn.frames_shown(frame)[-1]) if look.labels else {}
            instant = drawn.frames.instant(frame) if look.overlay == 1 else ""
            if labels or notes:
                picture = written(picture, drawn.camera, labels, clear, notes, instant, stood)
            yield picture


def named(drawn: DrawnModel, frame: int) -> dict[str, Array]:
    """Return what carries a name, and where: tracked points, fixed pivots unless the bodies are a user's own.

    A pivot at which a tracked point always stands goes by the point's name.
    """
    points = drawn.frames.points
    positions = {name: path[frame] for name, path in points.items()}
    for label, end in fixed_pivots(drawn.mechanism).values() if not drawn.look.bodies else ():
        position = np.array(end.point)
        if not any(np.abs(path - position).max() < 0.1 * drawn.radius for path in points.values()):
            positions[label] = position
    return positions
