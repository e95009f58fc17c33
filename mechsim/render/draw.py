"""Frames of a motion, drawn one after the other."""

from collections.abc import Generator, Iterator
from contextlib import closing
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.mechanism import Mechanism
from mechsim.motion import Motion
from mechsim.render import backend as backends
from mechsim.render.lines import Chain, chain
from mechsim.render.look import Look
from mechsim.render.marks import Picture, written
from mechsim.render.stage import CAMERA, Stage
from mechsim.render.track import track
from mechsim.shapes import link_colours

Array = NDArray[np.float64]


def frames(
    mechanism: Mechanism, motion: Motion, *, angles: ArrayLike | None = None, **options: Any
) -> Iterator[Picture]:
    """Yield the frames of a motion, (height, width, 3) each.

    Args:
        mechanism: what moves.
        motion: how it moves, from either road; a frame per sample.
        angles: crank angles of the frames in [rad], inside the motion; None draws every sample.
        options: see `Look`.

    Raises:
        InputError: for an unknown camera, point or back end, or a motion without links.
        MissingToolError: where this machine has no OpenGL.
    """
    look = Look(**options)
    look.check(mechanism)
    stage = Stage(mechanism, track(mechanism, motion, angles), look)
    return draw(stage, backends.choose(look.backend))


def still(mechanism: Mechanism, motion: Motion, *, angle: float | None = None, **options: Any) -> Picture:
    """Return one picture, framed over the whole motion: at a crank angle in [rad], else at the first sample.

    Paths are drawn whole unless asked for otherwise.
    """
    options.setdefault("paths", "whole")
    look = Look(**options)
    look.check(mechanism)
    whole = track(mechanism, motion)
    stage = Stage(mechanism, whole, look)
    if angle is not None:
        stage.track = track(mechanism, motion, [angle])
    with closing(draw(stage, backends.choose(look.backend))) as pictures:
        return next(pictures)


def draw(stage: Stage, backend: backends.Backend) -> Generator[Picture]:
    """Yield the frames of a stage."""
    look = stage.look
    count = 1 if look.overlay > 1 else len(stage.track)
    trace = Trace(stage)
    name = stage.mechanism.name if look.notes else ""
    clear = 2.2 * stage.radius
    with backends.renderer(stage.model, look.size, backend) as drawing:
        for frame in range(count):
            stage.place(frame)
            drawing.update_scene(stage.data, CAMERA)
            trace.put(drawing.scene, frame)
            picture = drawing.render()
            labels = {name: path[frame] for name, path in stage.track.points.items()} if look.labels else {}
            angle = float(stage.track.angle[frame]) if look.overlay == 1 else None
            yield written(picture, stage.camera, labels, clear, name, angle) if labels or name else picture


class Trace:
    """The lines of a picture: paths, their projections, the arrow of the crank's sense."""

    def __init__(self, stage: Stage):
        self.stage, look = stage, stage.look
        self.width = 2.4 * look.size[1] / 480.0 / stage.camera.scale
        colours = link_colours(stage.mechanism)
        self.paths: dict[str, Chain] = {}
        self.fixed: list[Chain] = []
        for name, path in stage.track.paths.items():
            colour = np.array(colours[stage.mechanism.points[name][0]])
            colour[:3] *= 0.9
            self.paths[name] = chain(path, self.width, colour)
            if name in look.projections:
                thrown = [chain(stage.thrown(path, wall), self.width, colour) for wall in stage.walls]
                self.fixed.extend(thrown)
        if look.trace == "whole":
            self.fixed.extend(self.paths.values())
        if look.sense:
            self.fixed.extend(self._sense())

    def put(self, scene: mujoco.MjvScene, frame: int) -> None:
        """Add the lines of a frame to a scene."""
        now, trace = self.stage.track, self.stage.look.trace
        for fixed in self.fixed:
            fixed.put(scene)
        if trace not in ("grow", "tail"):
            return
        done = int(now.passed[frame])
        for name, path in self.paths.items():
            start = 0
            if trace == "tail":
                length = len(path) // 4
                start = max(0, done - 1 - length)
                if now.closed and done - 1 < length:
                    path.put(scene, len(path) + done - 1 - length)
            path.put(scene, start, done - 1)
            reached, here = now.paths[name][done - 1], now.points[name][frame]
            if not np.array_equal(reached, here):
                chain(np.array([reached, here]), self.width, path.rgba).put(scene)

    def _sense(self) -> list[Chain]:
        """An arrow around the crank shaft, the way the crank turns, on the camera's side."""
        stage = self.stage
        end, radius = stage.mechanism.joint(stage.mechanism.driver).a, stage.radius
        axis, forward = np.asarray(end.axis), stage.forward
        lift = 3.0 * radius * axis * np.sign(axis @ stage.camera.back + 1e-12)
        turn = np.linspace(0.0, 1.5 * np.pi, 49) * (1.0 if forward else -1.0)
        ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(49)]) @ end.frame.T
        arc = np.asarray(end.point) + lift + 5.0 * radius * ring
        tip, ahead = arc[-1], arc[-1] - arc[-2]
        ahead /= np.linalg.norm(ahead)
        ink, width = np.array([0.11, 0.13, 0.16, 1.0]), 0.5 * radius
        barbs = [tip - 1.8 * radius * (ahead + side * 0.7 * ring[-1]) for side in (1.0, -1.0)]
        return [chain(arc, width, ink), chain(np.array([barbs[0], tip, barbs[1]]), width, ink)]
