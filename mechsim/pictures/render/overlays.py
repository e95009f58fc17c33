"""What a picture shows beside the solids: shadow, paths, projections, arrows, the sense of the crank."""

import mujoco
import numpy as np

from mechsim.pictures.render.drawn_model import BEFORE, DrawnModel
from mechsim.pictures.render.lines import Chain, chain
from mechsim.pictures.render.shadow import Shadow
from mechsim.shapes import point_colours


class Trace:
    """What is put into the scene of a drawn model frame by frame, beside the solids."""

    def __init__(self, drawn: DrawnModel):
        self.drawn, look = drawn, drawn.look
        self.width = 2.4 * look.size[1] / 480.0 / drawn.camera.scale
        colours = point_colours(drawn.mechanism)
        self.shadow = Shadow(drawn) if drawn.stands_on_wall else None
        self.paths: dict[str, Chain] = {}
        self.fixed: list[Chain] = []
        for name, path in drawn.frames.paths.items():
            colour = np.array(colours[name])
            colour[:3] *= 0.9
            self.paths[name] = chain(path, self.width, colour)
            if name in look.projections:
                thrown = [chain(drawn.thrown(path, wall), self.width, colour) for wall in drawn.walls]
                self.fixed.extend(thrown)
        if look.trace == "whole":
            self.fixed.extend(self.paths.values())
        if look.sense:
            self.fixed.extend(self._sense())

    def put(self, scene: mujoco.MjvScene, frame: int) -> None:
        """Add shadow, lines and arrows of a frame to a scene."""
        now, trace = self.drawn.frames, self.drawn.look.trace
        if self.shadow:
            self.shadow.put(scene)
        for fixed in self.fixed:
            fixed.put(scene)
        nearer = BEFORE * self.drawn.radius * self.drawn.camera.back
        for arrows in self.drawn.arrows:
            starts = {name: path[frame] + nearer for name, path in now.starts.items()}
            arrows.put(scene, starts, frame, 0.45 * self.drawn.radius)
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
        """An arrow around the crank shaft, in the direction it turns, on the camera's side."""
        drawn = self.drawn
        end, radius = drawn.mechanism.driven_joints[0].a, drawn.radius
        axis, forward = np.asarray(end.axis), drawn.forward
        lift = 3.0 * radius * axis * np.sign(axis @ drawn.camera.back + 1e-12)
        turn = np.linspace(0.0, 1.5 * np.pi, 49) * (1.0 if forward else -1.0)
        ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(49)]) @ end.frame.T
        arc = np.asarray(end.point) + lift + 5.0 * radius * ring
        tip, ahead = arc[-1], arc[-1] - arc[-2]
        ahead /= np.linalg.norm(ahead)
        ink, width = np.array([0.11, 0.13, 0.16, 1.0]), 0.5 * radius
        barbs = [tip - 1.8 * radius * (ahead + side * 0.7 * ring[-1]) for side in (1.0, -1.0)]
        return [chain(arc, width, ink), chain(np.array([barbs[0], tip, barbs[1]]), width, ink)]
