"""Arrows at points and joints: velocity, acceleration, force, moment; one round scale for each kind."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed
from mechsim.shapes.camera import nice

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
LONGEST = 0.34
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
        red, green, blue, _ = (round(255.0 * part) for part in COLOURS[self.kind])
        if self.largest == 0.0:
            return f"{self.kind}: none", (red, green, blue)
        unit = UNITS[self.kind]
        said = f"{prefixed(self.length, 'm')} = {prefixed(self.stands_for, unit)}"
        return f"{self.kind}: {said}, at most {prefixed(self.largest, unit)}", (red, green, blue)

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
        # MuJoCo draws an arrow half as long as it was told
        mujoco.mjv_connector(geom, ARROW, width, start, start + 2.0 * arrow)
        geom.specular, geom.emission = 0.1, 0.3
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        scene.ngeom += 1


def arrows(kind: str, vectors: Mapping[str, Array], extent: float) -> Arrows:
    """Return arrows of a kind for a mechanism of some extent in [m], the longest of a readable length."""
    lengths = (np.sqrt((vector**2).sum(1)).max() for vector in vectors.values())
    largest, length = float(max(lengths, default=0.0)), nice(extent / 5.0)
    # the round number above: 1, 2 and 5 are the inverses of 1, 0.5 and 0.2
    least = largest * length / (LONGEST * extent)
    return Arrows(kind, dict(vectors), largest, length, 1.0 / nice(1.0 / least) if least > 0.0 else 1.0)
