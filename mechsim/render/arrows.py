"""Arrows at points: velocity, acceleration, force; one length scale for each kind over the whole motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARROW = mujoco.mjtGeom.mjGEOM_ARROW

UNITS = {"velocity": "m/s", "acceleration": "m/s²", "force": "N"}
COLOURS = {
    "velocity": (0.05, 0.25, 0.75, 1.0),
    "acceleration": (0.72, 0.05, 0.35, 1.0),
    "force": (0.10, 0.10, 0.10, 1.0),
}
# the longest arrow of a kind, in units of the mechanism's largest extent
LONGEST = 0.28


@dataclass(frozen=True, slots=True)
class Arrows:
    """Arrows of one kind.

    Attributes:
        kind: "velocity", "acceleration" or "force".
        vectors: point -> vectors frame by frame, (n, 3) in the kind's unit.
        largest: length of the longest vector of the whole motion, in that unit.
        scale: metres drawn for one unit.
    """

    kind: str
    vectors: Mapping[str, Array]
    largest: float
    scale: float

    @property
    def legend(self) -> tuple[str, tuple[int, int, int]]:
        """What a picture says about them, and their colour, 0 to 255."""
        red, green, blue, _ = (round(255.0 * part) for part in COLOURS[self.kind])
        return f"{self.kind}, up to {self.largest:.3g} {UNITS[self.kind]}", (red, green, blue)

    def tips(self, points: Mapping[str, Array]) -> Array:
        """Return where the arrows end in every frame, (k, 3) in [m]."""
        return np.vstack([points[name] + self.scale * vector for name, vector in self.vectors.items()])

    def put(self, scene: mujoco.MjvScene, starts: Mapping[str, Array], frame: int, width: float) -> None:
        """Add the arrows of a frame to a scene, from their starts, as many as it has room for."""
        for name, vectors in self.vectors.items():
            start = starts[name]
            end = start + self.scale * vectors[frame]
            # one shorter than it is thick is no arrow
            if scene.ngeom >= scene.maxgeom or float(np.linalg.norm(end - start)) < 2.0 * width:
                continue
            geom = scene.geoms[scene.ngeom]
            rgba = np.array(COLOURS[self.kind], dtype=np.float32)
            mujoco.mjv_initGeom(geom, ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), rgba)
            mujoco.mjv_connector(geom, ARROW, width, start, end)
            geom.specular, geom.emission = 0.1, 0.3
            geom.category = mujoco.mjtCatBit.mjCAT_DECOR
            scene.ngeom += 1


def arrows(kind: str, vectors: Mapping[str, Array], extent: float) -> Arrows:
    """Return arrows of a kind for a mechanism of some extent in [m], the longest of a readable length."""
    lengths = (np.sqrt((vector**2).sum(1)).max() for vector in vectors.values())
    largest = float(max(lengths, default=0.0))
    return Arrows(kind, dict(vectors), largest, LONGEST * extent / largest if largest > 0.0 else 0.0)
