"""Frames of a motion, drawn one after the other."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.mechanism import Mechanism
from mechsim.motion import Motion
from mechsim.render import backend as backends
from mechsim.render.look import Look
from mechsim.render.marks import Picture, written
from mechsim.render.stage import CAMERA, Stage
from mechsim.render.track import track
from mechsim.shapes import link_colours

Array = NDArray[np.float64]


def frames(mechanism: Mechanism, motion: Motion, *, angles: ArrayLike | None = None, **options: Any) -> Iterator[Picture]:
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
    look = Look(**{"paths": "whole", **options})
    look.check(mechanism)
    whole = track(mechanism, motion)
    stage = Stage(mechanism, whole, look)
    if angle is not None:
        stage.track = track(mechanism, motion, [angle])
    return next(iter(draw(stage, backends.choose(look.backend))))


def draw(stage: Stage, backend: backends.Backend) -> Iterator[Picture]:
    """Yield the frames of a stage."""
    look = stage.look
    count = 1 if look.overlay > 1 else len(stage.track)
    with backends.renderer(stage.model, look.size, backend) as drawing:
        for frame in range(count):
            stage.place(frame)
            drawing.update_scene(stage.data, CAMERA)
            _trace(stage, drawing.scene, frame)
            labels = {name: path[frame] for name, path in stage.track.points.items()} if look.labels else {}
            angle = float(stage.track.angle[frame]) if look.overlay == 1 else None
            name = stage.mechanism.name if look.notes else ""
            picture = drawing.render()
            clear = 2.2 * stage.radius
            yield written(picture, stage.camera, labels, clear, name, angle) if labels or name else picture


def _trace(stage: Stage, scene: mujoco.MjvScene, frame: int) -> None:
    """Add the paths of the tracked points to a scene."""
    look, now = stage.look, stage.track
    colours = link_colours(stage.mechanism)
    for name, path in now.paths.items():
        colour = np.array(colours[stage.mechanism.points[name][0]])
        colour[:3] *= 0.8
        done = int(now.passed[frame])
        if look.trace == "whole":
            _line(scene, path, colour)
        elif look.trace == "grow":
            _line(scene, np.vstack([path[:done], now.points[name][frame]]), colour)
        elif look.trace == "tail":
            _line(scene, _tail(path, done, now.closed), colour)
        if name in look.projections:
            for wall in stage.walls:
                _line(scene, stage.thrown(path, wall), colour)
    if look.sense:
        _sense(stage, scene)


def _tail(path: Array, done: int, closed: bool) -> Array:
    """The last quarter of a path up to a point, going back over the seam of a closed one."""
    length = len(path) // 4
    if done >= length or not closed:
        return path[max(0, done - length) : done]
    return np.vstack([path[done - 1 - length : -1], path[:done]])


def _sense(stage: Stage, scene: mujoco.MjvScene) -> None:
    """An arrow around the crank shaft, the way the crank turns."""
    end = stage.mechanism.joint(stage.mechanism.driver).a
    forward = stage.track.angle[-1] >= stage.track.angle[0]
    lift = np.asarray(end.axis) * (4.0 * stage.radius if stage.camera.back @ np.asarray(end.axis) > 0 else 0.0)
    turn = np.linspace(0.0, 1.5 * np.pi, 33) * (1.0 if forward else -1.0)
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(33)]) @ end.frame.T
    arc = np.asarray(end.point) + lift + 5.0 * stage.radius * ring
    ink = np.array([0.11, 0.13, 0.16, 1.0])
    for a, b in zip(arc[:-3], arc[1:-2], strict=True):
        _connect(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.3 * stage.radius, a, b, ink)
    head = arc[-4] + (arc[-3] - arc[-4]) / np.linalg.norm(arc[-3] - arc[-4]) * 3.6 * stage.radius
    _connect(scene, mujoco.mjtGeom.mjGEOM_ARROW, 0.75 * stage.radius, arc[-4], head, ink)


def _line(scene: mujoco.MjvScene, path: Array, colour: Array) -> None:
    for a, b in zip(path[:-1], path[1:], strict=True):
        _connect(scene, mujoco.mjtGeom.mjGEOM_LINE, 2.5, a, b, colour)


def _connect(scene: mujoco.MjvScene, kind: mujoco.mjtGeom, width: float, a: Array, b: Array, rgba: Array) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), rgba.astype(np.float32))
    mujoco.mjv_connector(geom, kind, width, a, b)
    # lines have no surface: without this the light would wash their colour out
    geom.specular = 0.0
    scene.ngeom += 1
