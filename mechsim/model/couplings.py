"""Couplings: coordinates of joints that are functions of others, as gears, racks and polynomials."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import number

# the highest degree, that of MJCF's joint equality
MAX_DEGREE = 4

Terms = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Gear:
    """Coordinate of joint `driven` = ratio * coordinate of joint `driver` + phase.

    Attributes:
        driver: name of a revolute joint.
        driven: name of another revolute joint.
        ratio: turns of `driven` per turn of `driver`; negative for outside meshing.
        phase: angle of `driven` where `driver` is at zero, in [rad].
        pressure_angle: of the teeth, in [rad]; 0 leaves the tooth force tangential.
    """

    driver: str
    driven: str
    ratio: float
    phase: float = 0.0
    pressure_angle: float = 0.0

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{self.driver}-{self.driven}"


@dataclass(frozen=True, slots=True)
class Coupling:
    """left - zeros[0] = p(right - zeros[1]), where left and right are weighted sums of coordinates.

    Attributes:
        name: of the coupling.
        left: name of a coordinate, or coordinate -> weight.
        right: likewise; empty where the left side is held.
        coefficients: of the polynomial p from the constant up, in SI, five at the most.
        zeros: from which either side is counted, in the coordinates' own units.
        turns: whether whole turns between both sides do not count, as of gears.
        pressure_angle: of the teeth of a gear pair or a rack and pinion, in [rad]; 0 leaves the tooth force
            tangential. None for what has no teeth: an ideal transmission.
    """

    name: str
    left: str | Terms
    right: str | Terms
    coefficients: tuple[float, ...]
    zeros: tuple[float, float] = (0.0, 0.0)
    turns: bool = False
    pressure_angle: float | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.coefficients) <= MAX_DEGREE + 1:
            raise InputError(
                f"coupling {self.name!r} has {len(self.coefficients)} coefficients; "
                f"give 1 to {MAX_DEGREE + 1}, from the constant up"
            )
        numbers = [*self.coefficients, *self.zeros, *self.left_terms.values(), *self.right_terms.values()]
        if not np.isfinite([number(value) for value in numbers]).all():
            raise InputError(f"coupling {self.name!r} holds {numbers}; give finite numbers")
        if not self.left_terms:
            raise InputError(f"coupling {self.name!r} couples nothing; name a coordinate on its left side")

    @property
    def left_terms(self) -> Terms:
        """Coordinate -> weight on the left side."""
        return {self.left: 1.0} if isinstance(self.left, str) else self.left

    @property
    def right_terms(self) -> Terms:
        """Coordinate -> weight on the right side."""
        return {self.right: 1.0} if isinstance(self.right, str) else self.right

    @property
    def coordinates(self) -> tuple[str, ...]:
        """All coordinates it names."""
        return (*self.left_terms, *self.right_terms)

    @property
    def ratio(self) -> float:
        """The coefficient of the first power: of gears, the ratio."""
        return self.coefficients[1] if len(self.coefficients) > 1 else 0.0

    @property
    def label(self) -> str:
        """Both sides in words."""
        return f"{'+'.join(self.right_terms) or 'nothing'}-{'+'.join(self.left_terms)}"

    def polynomial(self, right: Array) -> tuple[Array, Array, Array]:
        """Return p, p' and p'' at values of the right side."""
        p = np.polynomial.Polynomial(self.coefficients)
        offset = right - self.zeros[1]
        return p(offset), p.deriv(1)(offset), p.deriv(2)(offset)
