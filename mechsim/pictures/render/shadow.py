"""Soft shadows on the backdrop: every solid once more, pressed flat onto the wall along the light.

Shadow maps cost more than all the rest of a picture where the processor draws, and their edges are
ragged. A geom's matrix need not be a rotation: with the shear that carries every point along the light
to the wall, MuJoCo draws the shadow itself. A few layers, each darker and smaller than the one below,
make the edge soft; solids high above the wall have softer ones, as under a lamp of some width.
"""

from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.render import scenery

if TYPE_CHECKING:
    from mechsim.pictures.render.drawn_model import DrawnModel

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)

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

    def __init__(self, drawn: "DrawnModel"):
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
        lit, unlit = scenery.brightness(drawn.camera, wall.normal, drawn.missed(wall))
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
            places = flat + (layer + 1) * step * self.normal
            sizes = np.maximum(self.sizes + wider * above, 0.1 * self.sizes)
            solids = zip(self.types, self.meshes, sizes, places, matrices, strict=True)
            for kind, mesh, size, place, matrix in solids:
                if ngeom >= scene.maxgeom:
                    break
                geom = geoms[ngeom]
                mujoco.mjv_initGeom(geom, kind, size, place, matrix, self.colours[layer])
                geom.specular, geom.emission, geom.category = 0.0, GLOW, DECOR
                if kind == MESH:
                    geom.dataid = mesh
                ngeom += 1
        scene.ngeom = ngeom
