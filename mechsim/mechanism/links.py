"""Links: inertia, outline and pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import HUGE, ROUNDING, Array

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

# largest mass in [kg], and inverse of the smallest; more is an input error, and products of moments overflow
MAX_MASS = 1e60


def vector(numbers: Array | Sequence[Any]) -> Vector:
    """Return three numbers as a tuple."""
    x, y, z = (float(number) for number in numbers)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Rods:
    """The round rods from which an inertia was computed.

    Attributes:
        length: total length in [m].
        diameter: diameter in [m].
        density: density in [kg/m3].
        disc: radius of the disc of a cam, which is as thick as a pin is long, in [m]; 0 without one.
    """

    length: float
    diameter: float
    density: float
    disc: float = 0.0


@dataclass(frozen=True, slots=True)
class Inertia:
    """The inertia of a rigid body.

    Attributes:
        mass: in [kg], zero or above.
        centre: centre of mass in the link's frame, in [m].
        moments: inertia matrix about the centre of mass, along the axes of the link's frame, in [kg m2]:
            symmetric, no principal moment below zero or larger than the sum of the others; all zero for a
            point mass.
        rods: rods from which it was computed; None if it was given.
        negligible: whether its mass replaces a mass of zero, which MuJoCo does not accept.
    """

    mass: float
    centre: Vector
    moments: Matrix
    rods: Rods | None = field(default=None, compare=False, repr=False)
    negligible: bool = field(default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        mass, centre = float(self.mass), np.asarray(self.centre, dtype=np.float64)
        if mass != 0.0 and not 1.0 / MAX_MASS < mass < MAX_MASS:
            raise InputError(
                f"mass of a link is {self.mass} kg; give a finite mass, 0 or "
                f"from {1.0 / MAX_MASS:g} to {MAX_MASS:g} kg"
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
        """Return the inertia matrix about another point of the link's frame, (3, 3) in [kg m2] (Steiner)."""
        return self.matrix + self.mass * _spread(np.asarray(self.centre) - np.asarray(point))


def combine(inertias: Iterable[Inertia]) -> Inertia:
    """Return the inertia of bodies that are rigidly joined, all in the same frame."""
    bodies = list(inertias)
    mass = sum(body.mass for body in bodies)
    centre = sum((body.mass * np.asarray(body.centre) for body in bodies), np.zeros(3)) / (mass or 1.0)
    moments = sum((body.about(vector(centre)) for body in bodies), np.zeros((3, 3)))
    return Inertia(mass, vector(centre), rows(moments))


def _spread(arm: Array) -> Array:
    """Return (a.a) 1 - a a', the inertia matrix of a unit mass at `arm`."""
    return float(arm @ arm) * np.eye(3) - np.outer(arm, arm)


def rows(moments: Array) -> Matrix:
    """Return the rows of a matrix (3, 3) as tuples."""
    a, b, c = (vector(row) for row in moments)
    return a, b, c


def _checked(moments: Array) -> Matrix:
    """Return an inertia matrix made exactly symmetric; raise InputError if no body can have it."""
    if moments.shape != (3, 3) or not (np.abs(moments) < MAX_MASS * HUGE**2).all():
        raise InputError(
            "moments of inertia of a link are not 3 x 3 finite numbers in [kg m2]; "
            "give the matrix about the centre, or its three diagonal elements"
        )
    largest = float(np.abs(moments).max())
    skewed = float(np.abs(moments - moments.T).max())
    if not skewed <= ROUNDING * largest:
        raise InputError(
            f"inertia matrix of a link differs from its transpose by {skewed:.3g} kg m2 (of {largest:.3g}); "
            "give a symmetric matrix"
        )
    least, middle, most = (float(value) for value in np.linalg.eigvalsh(moments))
    principal = f"principal moments of inertia of a link are {least:.6g}, {middle:.6g}, {most:.6g} kg m2"
    if not least >= -ROUNDING * most:
        raise InputError(f"{principal}; none can be below 0: correct the matrix")
    if not most - (least + middle) <= ROUNDING * most:
        raise InputError(
            f"{principal}; no body has one above the sum of the others, {least + middle:.6g} kg m2: "
            "check units, axes, and that they are about the centre of mass"
        )
    return rows((moments + moments.T) / 2.0)


GROUND = "ground"
# prefix of names of virtual bodies: links without a body, between the joints that replace one joint
VIRTUAL_PREFIX = "~"
ORIGIN: Vector = (0.0, 0.0, 0.0)
NO_INERTIA = Inertia(0.0, ORIGIN, (ORIGIN, ORIGIN, ORIGIN))
AXES = "xyz"
EX: Vector = (1.0, 0.0, 0.0)
EY: Vector = (0.0, 1.0, 0.0)
EZ: Vector = (0.0, 0.0, 1.0)
# largest coordinate in [m]; squares of larger ones overflow
MAX_COORDINATE = 1e100


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Poses of links: position of the origin, (..., 3) in [m], and rotation matrix, (..., 3, 3)."""

    position: Array
    rotation: Array

    def __eq__(self, other: object) -> bool:
        """Whether the other pose is equal to the last bit."""
        return (
            isinstance(other, Pose)
            and np.array_equal(self.position, other.position)
            and np.array_equal(self.rotation, other.rotation)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def point(self, local: Vector) -> Array:
        """Return the position of a point given in the link's frame, (..., 3) in [m]."""
        return self.position + self.rotation @ np.asarray(local)

    def local(self, position: Array) -> Array:
        """Return a point of the world in the link's frame, (3,) in [m]."""
        return self.rotation.T @ (position - self.position)

    def select(self, index: int | slice | NDArray[np.intp]) -> Pose:
        """Return the pose or poses at an index of the first axis; a single pose is that at every index."""
        return self if self.position.ndim == 1 else Pose(self.position[index], self.rotation[index])


IDENTITY = Pose(np.zeros(3), np.eye(3))


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link.

    Attributes:
        name: unique in the mechanism.
        outline: points in the link's frame, in [m], that pictures connect with its joints.
        inertia: mass, centre and moments; None if `rods.with_inertia` computes them.
        polygon: whether pictures connect the outline in its order to a closed polygon.
    """

    name: str
    outline: tuple[Vector, ...] = ()
    inertia: Inertia | None = None
    polygon: bool = False

    @property
    def is_body(self) -> bool:
        """Whether it is a body; motions need no pose of a virtual body."""
        return not self.name.startswith(VIRTUAL_PREFIX)
