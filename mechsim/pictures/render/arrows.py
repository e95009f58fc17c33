"""Lines and arrows of a picture: chains of thin square rods, and vectors on one round scale for each kind."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed
from mechsim.shapes.camera import nice

DECOR = int(mujoco.mjtCatBit.mjCAT_DECOR)

ARROW = mujoco.mjtGeom.mjGEOM_ARROW

UNITS = {"velocity": "m/s", "acceleration": "m/s²", "force": "N", "moment": "N m"}
COLOURS = {
    "velocity": (0.05, 0.25, 0.75, 1.0),
    "acceleration": (0.72, 0.05, 0.35, 1.0),
    "force": (0.10, 0.10, 0.10, 1.0),
    "moment": (0.42, 0.16, 0.60, 1.0),
}
# the longest arrow of a kind may be so long, and is no shorter than two fifths of it: in units of the
# mechanism's largest extent
MAX_ARROW = 0.34
# a moment has a second head behind the first, at this part of its length
SECOND_HEAD = 0.84


@dataclass(frozen=True, slots=True)
class Arrows:
    """Arrows of one kind.

    Attributes:
        kind: "velocity", "acceleration", "force" or "moment".
        vectors: point or joint -> vectors frame by frame, (n, 3) in the kind's unit.
        largest: length of the longest vector of the whole motion, in that unit.
        length: a round length in [m]...
        stands_for: ...and the round number of units that an arrow of that length stands for.
    """

    kind: str
    vectors: Mapping[str, Array]
    largest: float
    length: float
    stands_for: float

    @property
    def scale(self) -> float:
        """Metres drawn for one unit."""
        return self.length / self.stands_for

    @property
    def legend(self) -> tuple[str, tuple[int, int, int]]:
        """What a picture says about them, and their colour, 0 to 255."""
        red, green, blue, _ = (round(255.0 * channel) for channel in COLOURS[self.kind])
        if self.largest == 0.0:
            return f"{self.kind}: none", (red, green, blue)
        unit = UNITS[self.kind]
        scale_text = f"{prefixed(self.length, 'm')} = {prefixed(self.stands_for, unit)}"
        return f"{self.kind}: {scale_text}, at most {prefixed(self.largest, unit)}", (red, green, blue)

    def tips(self, starts: Mapping[str, Array]) -> Array:
        """Return where the arrows end in every frame, (k, 3) in [m]."""
        return np.vstack([starts[name] + self.scale * vector for name, vector in self.vectors.items()])

    def put(self, scene: mujoco.MjvScene, starts: Mapping[str, Array], frame: int, width: float) -> None:
        """Add the arrows of a frame to a scene, from their starts, as many as it has room for."""
        for name, vectors in self.vectors.items():
            arrow = self.scale * vectors[frame]
            # one shorter than it is thick is no arrow
            if float(np.linalg.norm(arrow)) < 2.0 * width:
                continue
            for share in (1.0, SECOND_HEAD) if self.kind == "moment" else (1.0,):
                if scene.ngeom < scene.maxgeom:
                    self._put(scene, starts[name], share * arrow, width)

    def _put(self, scene: mujoco.MjvScene, start: Array, arrow: Array, width: float) -> None:
        geom = scene.geoms[scene.ngeom]
        rgba = np.array(COLOURS[self.kind], dtype=np.float32)
        mujoco.mjv_initGeom(geom, ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
        # MuJoCo draws an arrow of half the length that it is given
        mujoco.mjv_connector(geom, ARROW, width, start, start + 2.0 * arrow)
        geom.specular, geom.emission = 0.1, 0.3
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1


def arrows(kind: str, vectors: Mapping[str, Array], extent: float) -> Arrows:
    """Return arrows of a kind for a mechanism of some extent in [m], the longest of a readable length."""
    lengths = (np.sqrt((vector**2).sum(1)).max() for vector in vectors.values())
    largest, length = float(max(lengths, default=0.0)), nice(extent / 5.0)
    # the round number above: 1, 2 and 5 are the inverses of 1, 0.5 and 0.2
    least = largest * length / (MAX_ARROW * extent)
    return Arrows(kind, dict(vectors), largest, length, 1.0 / nice(1.0 / least) if least > 0.0 else 1.0)


BOX = int(mujoco.mjtGeom.mjGEOM_BOX)


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
