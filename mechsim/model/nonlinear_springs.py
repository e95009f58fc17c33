"""Nonlinear springs and stops: a tension by a law of length l and rate v, between two points or in a joint.

In a joint the length is a coordinate: a tension F is the force -F on link b along it.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.model.links import Vector
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE, number

# phases of a stop: without penetration, under pressure, and left behind by a joint that retreats faster
OPEN, PRESSED, RELAXED = range(3)


@dataclass(frozen=True, slots=True)
class SoftStop:
    """A spring and damper behind a limit, which never pull.

    With the penetration p = side (l - limit) > 0 the stop presses with max(0, k p + d p'); it stores
    k p^2 / 2, and loses max(d p', -k p) p', which is never negative. It is open for p <= 0.

    Source: B. Brogliato, Nonsmooth Mechanics (2016), chapter 2 (compliant contact of Kelvin and Voigt, cut
    off at zero force).

    Attributes:
        limit: in [m] or [rad].
        side: +1 for an upper limit, -1 for a lower one.
        stiffness: k in [N/m] or [N m/rad], above 0.
        damping: d in [N s/m] or [N m s/rad], 0 or more.
    """

    limit: float
    side: float
    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < number(self.stiffness) < HUGE:
            raise InputError(f"stiffness of a stop is {self.stiffness}; give a number above 0")
        if not 0.0 <= number(self.damping) < HUGE:
            raise InputError(f"damping of a stop is {self.damping}; give a number, 0 or more")

    @property
    def reference(self) -> float:
        """Angle within half a revolution of which angles are taken that are known up to revolutions."""
        return self.limit

    def _penetration(self, length: Array, rate: Array) -> tuple[Array, Array]:
        """Return p and p + d p' / k, whose product with k is the force without cut-off."""
        depth = self.side * (length - self.limit)
        return depth, depth + (self.damping / self.stiffness) * self.side * rate

    def phase(self, length: float, rate: float) -> int:
        """Return the phase at a length and a rate."""
        depth, pressure = self._penetration(np.array(length), np.array(rate))
        return OPEN if depth <= 0.0 else PRESSED if pressure > 0.0 else RELAXED

    def remaining(self, phase: int, length: Array, rate: Array) -> Array:
        """Return lengths that fall through zero where a phase ends, (n,)."""
        depth, pressure = self._penetration(length, rate)
        if phase == OPEN:
            return -depth
        return np.minimum(depth, pressure if phase == PRESSED else -pressure)

    def tension(self, length: Array, rate: Array, phase: int | None = None) -> Array:
        """Return the tension, (n,), smooth within a given phase; complex steps are propagated."""
        depth, pressure = self._penetration(length, rate)
        pressed = (np.real(depth) > 0.0) & (np.real(pressure) > 0.0) if phase is None else phase == PRESSED
        return self.side * self.stiffness * np.where(pressed, pressure, 0.0)

    def elastic(self, length: Array, phase: int | None = None) -> Array:
        """Return the tension of the spring, (n,): the derivative of `energy`."""
        depth, _ = self._penetration(length, 0.0 * length)
        pressed = np.real(depth) > 0.0 if phase is None else phase != OPEN
        return self.side * self.stiffness * np.where(pressed, depth, 0.0)

    def energy(self, length: Array) -> Array:
        """Return the stored energy, (n,) in [J]."""
        return 0.5 * (length - self.limit) * self.elastic(length)


@dataclass(frozen=True, slots=True)
class NonlinearSpring:
    """A spring with a law of its own.

    Attributes:
        ends: two points, or a joint coordinate.
        law: tension by length and rate.
    """

    ends: tuple[str | tuple[str, Vector], str | tuple[str, Vector]] | str
    law: SoftStop


def phases_of(springs: tuple[NonlinearSpring, ...], lengths: Array, rates: Array) -> tuple[int, ...]:
    """Return the phase of each spring at lengths and rates, (springs,)."""
    return tuple(
        spring.law.phase(float(length), float(rate))
        for spring, length, rate in zip(springs, lengths, rates, strict=True)
    )


Phases = tuple[int, ...]
