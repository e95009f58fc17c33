"""What a link is, and where it stands."""

from dataclasses import dataclass

import numpy as np

from mechsim.model.inertia import Inertia
from mechsim.numerics.arrays import Array

Vector = tuple[float, float, float]

GROUND = "ground"
# what names of links begin with that stand for no body: those between several joints of one
UNSEEN = "~"
ORIGIN: Vector = (0.0, 0.0, 0.0)
EX: Vector = (1.0, 0.0, 0.0)
EY: Vector = (0.0, 1.0, 0.0)
EZ: Vector = (0.0, 0.0, 1.0)
# what is farther away has no square that is a finite number, in [m]
FARTHEST = 1e100


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where links are: position of the origin, (..., 3) in [m], and rotation matrix, (..., 3, 3)."""

    position: Array
    rotation: Array

    def __eq__(self, other: object) -> bool:
        """Whether the other stands at the same places, to the last bit."""
        return (
            isinstance(other, Pose)
            and np.array_equal(self.position, other.position)
            and np.array_equal(self.rotation, other.rotation)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def point(self, local: Vector) -> Array:
        """Return the place of a point given in the link's frame, (..., 3) in [m]."""
        return self.position + self.rotation @ np.asarray(local)

    def at(self, index: int | slice) -> "Pose":
        """Return the pose or poses at an index of the leading axis."""
        return Pose(self.position[index], self.rotation[index])


IDENTITY = Pose(np.zeros(3), np.eye(3))


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link.

    Attributes:
        name: unique in the mechanism.
        outline: points of the link's own frame, in [m], that a picture joins up; joint points are
            added by themselves, so this is for what no joint touches.
        inertia: mass, centre and moments; None leaves them to `rods.with_inertia`.
    """

    name: str
    outline: tuple[Vector, ...] = ()
    inertia: Inertia | None = None

    @property
    def seen(self) -> bool:
        """Whether it stands for a body; motions need not say where others are."""
        return not self.name.startswith(UNSEEN)
