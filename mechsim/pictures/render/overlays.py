"""Overlays of a picture: shadow, paths, projections, arrows, the rotation arrow of the crank."""

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.render import scenery
from mechsim.pictures.render.arrows import DECOR, Chain, chain
from mechsim.pictures.render.drawn_model import DrawnModel
from mechsim.shapes import point_colours

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
MESH = int(mujoco.mjtGeom.mjGEOM_MESH)

# arrows stand so many rod radii before the solid links, see `drawn_model.BEHIND`
BEFORE = 6.0
LAYERS = 3
# half the width of a soft edge for each metre above the wall
SPREAD = 0.018
# distance between layers in units of the picture's height: far below a pixel, and more than depths can tell
STEP = 2e-4
# left over of a solid's thickness and height, so that no matrix is singular; less than a layer
FLAT = 1e-4
# a colour that shines by itself takes no light: flat solids have no sides to be shaded
GLOW = 99.0


class Shadow:
    """The shadow of a drawn model's solids on its first wall."""

    def __init__(self, drawn: DrawnModel):
        model, wall = drawn.model, drawn.walls[0]
        self.drawn, self.point, self.normal = drawn, wall.point, wall.normal
        # a ghost is transparent and throws none
        solid = (model.geom_type != PLANE) & (model.geom_rgba[:, 3] == 1.0)
        self.geoms = np.flatnonzero(solid)
        self.types = [int(kind) for kind in model.geom_type[self.geoms]]
        # the scene counts each mesh twice, for its hull
        self.meshes = [2 * int(mesh) for mesh in model.geom_dataid[self.geoms]]
        self.sizes: Array = model.geom_size[self.geoms].copy()
        light = scenery.light_direction(drawn.camera, wall.normal)
        along = np.outer(light, wall.normal) / float(light @ wall.normal)
        self.press = np.eye(3) - along + FLAT * np.outer(wall.normal, wall.normal)
        lit, unlit = scenery.brightness(drawn.camera, wall.normal, drawn.missing_light(wall))
        shares = np.arange(1, LAYERS + 1) / LAYERS
        tones = np.multiply.outer(np.minimum(lit + shares * (unlit - lit), 1.0), scenery.PAPER)
        self.colours = np.column_stack([tones / (1.0 + GLOW), np.ones(LAYERS)]).astype(np.float32)

    def put(self, scene: mujoco.MjvScene) -> None:
        """Add the shadow of the present pose to a scene, as much as it has room for."""
        data = self.drawn.data
        off = data.geom_xpos[self.geoms] - self.point
        matrices = (self.press @ data.geom_xmat[self.geoms].reshape(-1, 3, 3)).reshape(-1, 9)
        above = np.maximum(off @ self.normal, 0.0)[:, None]
        flat = self.point + off @ self.press.T
        geoms, ngeom, step = scene.geoms, scene.ngeom, STEP * self.drawn.camera.height
        # the uppermost layer first, so that what it hides of the others is not drawn at all
        for layer in reversed(range(LAYERS)):
            wider = SPREAD * (1.0 - 2.0 * layer / (LAYERS - 1))
            positions = flat + (layer + 1) * step * self.normal
            sizes = np.maximum(self.sizes + wider * above, 0.1 * self.sizes)
            solids = zip(self.types, self.meshes, sizes, positions, matrices, strict=True)
            for kind, mesh, half_size, position, matrix in solids:
                if ngeom >= scene.maxgeom:
                    break
                geom = geoms[ngeom]
                mujoco.mjv_initGeom(geom, kind, half_size, position, matrix, self.colours[layer])
                geom.specular, geom.emission, geom.category = 0.0, GLOW, DECOR
                if kind == MESH:
                    geom.dataid = mesh
                ngeom += 1
        scene.ngeom = ngeom


class Trace:
    """Overlays that are added to the scene of a drawn model in every frame."""

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
        if look.direction:
            self.fixed.extend(self._rotation_arrow())

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
        passed = int(now.passed[frame])
        for name, path in self.paths.items():
            start = 0
            if trace == "tail":
                length = len(path) // 4
                start = max(0, passed - 1 - length)
                if now.closed and passed - 1 < length:
                    path.put(scene, len(path) + passed - 1 - length)
            path.put(scene, start, passed - 1)
            reached, current = now.paths[name][passed - 1], now.points[name][frame]
            if not np.array_equal(reached, current):
                chain(np.array([reached, current]), self.width, path.rgba).put(scene)

    def _rotation_arrow(self) -> list[Chain]:
        """An arrow around the crank shaft, in the direction it turns, on the camera's side."""
        drawn = self.drawn
        end, radius = drawn.mechanism.driven_joints[0].a, drawn.radius
        axis, forward = np.asarray(end.axis), drawn.forward
        lift = 3.0 * radius * axis * np.sign(axis @ drawn.camera.back + 1e-12)
        angle = np.linspace(0.0, 1.5 * np.pi, 49) * (1.0 if forward else -1.0)
        ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(49)]) @ end.frame.T
        arc = np.asarray(end.point) + lift + 5.0 * radius * ring
        tip, ahead = arc[-1], arc[-1] - arc[-2]
        ahead /= np.linalg.norm(ahead)
        ink, width = np.array([0.11, 0.13, 0.16, 1.0]), 0.5 * radius
        barbs = [tip - 1.8 * radius * (ahead + side * 0.7 * ring[-1]) for side in (1.0, -1.0)]
        return [chain(arc, width, ink), chain(np.array([barbs[0], tip, barbs[1]]), width, ink)]
