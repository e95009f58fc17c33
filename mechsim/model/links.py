"""What a link is, and where it stands."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

# a mass beyond this in [kg], or below its inverse, is a slip; Steiner's moments are finite with any other
HEAVIEST = 1e60
# how far moments may miss symmetry and the triangle inequality: rounding of a rotated laminar body
SLACK = 1e-9


def vector(numbers: Array | Sequence[Any]) -> Vector:
    """Return three numbers as a plain tuple."""
    x, y, z = (float(number) for number in numbers)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Rods:
    """The round rods from which an inertia was computed.

    Attributes:
        length: of all together in [m].
        diameter: in [m].
        density: in [kg/m3].
    """

    length: float
    diameter: float
    density: float


@dataclass(frozen=True, slots=True)
class Inertia:
    """How a rigid body resists motion.

    Attributes:
        mass: in [kg], above zero.
        centre: centre of mass in the link's frame, in [m].
        moments: inertia matrix about the centre, along the axes of the link's frame, in [kg m2]:
            symmetric, positive definite, no principal moment larger than the sum of the others.
        rods: from which it was computed; None where it was given.
        negligible: whether it stands for a mass of zero.
    """

    mass: float
    centre: Vector
    moments: Matrix
    rods: Rods | None = field(default=None, compare=False, repr=False)
    negligible: bool = field(default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        mass, centre = float(self.mass), np.asarray(self.centre, dtype=np.float64)
        if not 1.0 / HEAVIEST < mass < HEAVIEST:
            raise InputError(
                f"mass of a link is {self.mass} kg; give a finite mass above 0, "
                f"from {1.0 / HEAVIEST:g} to {HEAVIEST:g} kg"
            )
        if centre.shape != (3,) or not (np.abs(centre) < HUGE).all():
            raise InputError(f"centre of mass {self.centre} m is not three finite numbers; give x, y, z")
        moments = np.asarray(self.moments, dtype=np.float64)
        if moments.shape == (3,):
            moments = np.diag(moments)
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "centre", tuple(centre.tolist()))
        object.__setattr__(self, "moments", _checked(moments))

    @property
    def matrix(self) -> Array:
        """The moments as an array, (3, 3) in [kg m2]."""
        return np.array(self.moments)

    def about(self, point: Vector) -> Array:
        """Return the inertia matrix about another point of the link's frame, (3, 3) in [kg m2]; Steiner."""
        return self.matrix + self.mass * _spread(np.asarray(self.centre) - np.asarray(point))


def combine(inertias: Iterable[Inertia]) -> Inertia:
    """Return the inertia of bodies joined rigidly, all given in the same frame."""
    bodies = list(inertias)
    mass = sum(body.mass for body in bodies)
    centre = sum((body.mass * np.asarray(body.centre) for body in bodies), np.zeros(3)) / mass
    centre_of_mass = (float(centre[0]), float(centre[1]), float(centre[2]))
    moments = sum((body.about(centre_of_mass) for body in bodies), np.zeros((3, 3)))
    return Inertia(mass, centre_of_mass, _rows(moments))


def _spread(arm: Array) -> Array:
    """Return (a.a) 1 - a a', the inertia matrix of a unit mass at `arm`."""
    return float(arm @ arm) * np.eye(3) - np.outer(arm, arm)


def _rows(moments: Array) -> Matrix:
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in moments)
    return a, b, c


def _checked(moments: Array) -> Matrix:
    """Return an inertia matrix made exactly symmetric, or raise InputError if no body has it."""
    if moments.shape != (3, 3) or not (np.abs(moments) < HEAVIEST * HUGE**2).all():
        raise InputError(
            "moments of inertia of a link are not 3 x 3 finite numbers in [kg m2]; "
            "give the matrix about the centre, or its three diagonal elements"
        )
    largest = float(np.abs(moments).max())
    skewed = float(np.abs(moments - moments.T).max())
    if not skewed <= SLACK * largest:
        raise InputError(
            f"inertia matrix of a link differs from its transpose by {skewed:.3g} kg m2 (of {largest:.3g}); "
            "give a symmetric matrix"
        )
    least, middle, most = (float(value) for value in np.linalg.eigvalsh(moments))
    principal = f"principal moments of inertia of a link are {least:.6g}, {middle:.6g}, {most:.6g} kg m2"
    if not least > 0.0:
        raise InputError(f"{principal}; all must be above 0: give a thin body its small thickness")
    if not most <= (least + middle) * (1.0 + SLACK):
        raise InputError(
            f"{principal}; no body has one above the sum of the others, {least + middle:.6g} kg m2: "
            "check units, axes, and that they are about the centre of mass"
        )
    return _rows((moments + moments.T) / 2.0)


GROUND = "ground"
# what names of links begin with that stand for no body: those between several joints of one
VIRTUAL_PREFIX = "~"
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

    def select(self, index: int | slice | NDArray[np.intp]) -> "Pose":
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
    def is_body(self) -> bool:
        """Whether it stands for a body; motions need not say where others are."""
        return not self.name.startswith(VIRTUAL_PREFIX)
