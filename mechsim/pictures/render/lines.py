"""Lines in space as chains of thin square rods, which take the light as solids do."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.numerics.arrays import Array

BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)


@dataclass(frozen=True, slots=True)
class Chain:
    """Rods between the points of a path, ready to be put into a scene.

    Attributes:
        centres: (k, 3) in [m].
        frames: rotation matrices row by row, (k, 9).
        sizes: half edges, (k, 3) in [m].
        rgba: colour, (4,).
    """

    centres: Array
    frames: Array
    sizes: Array
    rgba: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.centres)

    def put(self, scene: mujoco.MjvScene, start: int = 0, stop: int | None = None) -> None:
        """Add some of the rods to a scene, as many as it has room for."""
        geoms, ngeom = scene.geoms, scene.ngeom
        stop = len(self) if stop is None else min(stop, len(self))
        stop = min(stop, start + scene.maxgeom - ngeom)
        for i in range(start, stop):
            geom = geoms[ngeom]
            mujoco.mjv_initGeom(geom, BOX, self.sizes[i], self.centres[i], self.frames[i], self.rgba)
            # some light of their own, so that a path reads the same in light and shade; decoration
            # throws no shadow
            geom.specular, geom.emission, geom.category = 0.0, 0.15, DECOR
            ngeom += 1
        scene.ngeom = ngeom


def chain(path: Array, width: float, rgba: ArrayLike) -> Chain:
    """Return the rods along a path, (m, 3), `width` across."""
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.where(lengths[:, None] > 0.0, steps / np.maximum(lengths, 1e-300)[:, None], [1.0, 0.0, 0.0])
    least = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    x = np.cross(least, along)
    x /= np.linalg.norm(x, axis=1)[:, None]
    frames = np.stack([x, np.cross(along, x), along], axis=-1).reshape(-1, 9)
    sizes = np.full((len(steps), 3), width / 2.0)
    # half a width longer at each end closes the outer side of a bend
    sizes[:, 2] = (lengths + 0.5 * width) / 2.0
    return Chain((path[:-1] + path[1:]) / 2.0, frames, sizes, np.asarray(rgba, dtype=np.float32))
