"""Nonlinear springs, stops and bushings: tensions by laws of length l and rate v, and mounts between frames.

In a joint the length is a coordinate: a tension F is the force -F on link b along it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.coupling_functions import TabledFunction
from mechsim.mechanism.expressions import Expression, Instruction, compiled
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import Vector
from mechsim.numerics.arrays import HUGE, Array, at_least_zero, number, numbers

# phases of a stop: without penetration, under pressure, and, below zero, left behind by a joint that retreats
# faster. The magnitude of the others is the approach rate v0 if the law depends on it
OPEN, PRESSED = 0.0, 1.0


@dataclass(frozen=True, slots=True)
class SoftStop:
    """A spring and damper behind a limit, which never pull.

    With the penetration p = side (l - limit) > 0 the stop presses with

        max(0, k p^n (1 + h p' / v0) + d p'),

    where v0 is the rate p' at which it closed. It stores k p^(n+1) / (n+1), and loses the rest. It is open
    for p <= 0. A run that starts in contact has no v0, and h is then without effect.

    Source: B. Brogliato, Nonsmooth Mechanics (2016), chapter 2 (compliant contact of Kelvin and Voigt, cut
    off at zero force); H. M. Lankarani and P. E. Nikravesh, A contact force model with hysteresis damping
    for impact analysis of multibody systems, Journal of Mechanical Design 112 (1990) 369-376 (n = 3/2, d = 0,
    h by `clearances.LAWS`).

    Attributes:
        limit: in [m] or [rad].
        side: +1 for an upper limit, -1 for a lower one.
        stiffness: k in [N/m^n] or [N m/rad^n], above 0.
        damping: d in [N s/m] or [N m s/rad], 0 or more.
        exponent: n, 1 or more.
        hysteresis: h, 0 or more.
    """

    limit: float
    side: float
    stiffness: float
    damping: float = 0.0
    exponent: float = 1.0
    hysteresis: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < number(self.stiffness) < HUGE:
            raise InputError(f"stiffness of a stop is {self.stiffness}; give a number above 0")
        at_least_zero("damping of a stop", self.damping)

    @property
    def reference(self) -> float:
        """Angle within half a revolution of which angles are taken that are known up to revolutions."""
        return self.limit

    def _penetration(self, length: Array, rate: Array, phase: float | None) -> tuple[Array, Array]:
        """Return p and p^n (1 + h p' / v0) + d p' / k, whose product with k is the force without cut-off.

        Beyond its phase, within a step, p^n is continued as an odd function.
        """
        depth = self.side * (length - self.limit)
        sign = np.where(np.real(depth) < 0.0, -1.0, 1.0)
        power = sign * (sign * depth) ** self.exponent
        loss = self.hysteresis / abs(phase) * power if phase and self.hysteresis else 0.0
        return depth, power + (loss + self.damping / self.stiffness) * self.side * rate

    def phase(self, length: float, rate: float, before: float = OPEN) -> float:
        """Return the phase at a length and a rate, after another phase."""
        # of no approach rate v0: infinite, without hysteresis
        closing = (self.side * rate if self.side * rate > 0.0 else np.inf) if self.hysteresis else PRESSED
        pressed = abs(before) or closing
        depth, pressure = self._penetration(np.array(length), np.array(rate), pressed)
        return OPEN if depth <= 0.0 else pressed if pressure > 0.0 else -pressed

    def remaining(self, phase: float, length: Array, rate: Array) -> Array:
        """Return lengths that fall through zero where a phase ends, (n,)."""
        depth, pressure = self._penetration(length, rate, phase)
        return np.minimum(depth, np.sign(phase) * pressure) if phase else -depth

    def tension(self, length: Array, rate: Array, phase: float | None = None) -> Array:
        """Return the tension, (n,), smooth within a given phase; complex steps are propagated."""
        depth, pressure = self._penetration(length, rate, phase)
        pressed = (np.real(depth) > 0.0) & (np.real(pressure) > 0.0) if phase is None else phase > OPEN
        return self.side * self.stiffness * np.where(pressed, pressure, 0.0)

    def elastic(self, length: Array, phase: float | None = None) -> Array:
        """Return the tension of the spring, (n,): the derivative of `energy`."""
        depth, power = self._penetration(length, 0.0 * length, phase)
        pressed = np.real(depth) > 0.0 if phase is None else phase != OPEN
        return self.side * self.stiffness * np.where(pressed, power, 0.0)

    def unstored(self, length: Array) -> Array:
        """Return zero: the spring stores all that its damper does not lose."""
        return np.zeros_like(length)

    def beyond(self, length: Array, rate: Array) -> str:
        """Return nothing: the law holds at every length."""
        return ""

    def energy(self, length: Array) -> Array:
        """Return the stored energy, (n,) in [J]."""
        return (length - self.limit) * self.elastic(length) / (self.exponent + 1.0)


@dataclass(frozen=True)
class SpringLaw:
    """The tension k (l - rest) + d v + preload + f of a spring with a damper.

    f is an expression of l and v, or a cubic spline through a table over one of them (de Boor, A Practical
    Guide to Splines, chapter 4). An expression stores no energy: f at rest does work, as a load does, and the
    rest of it is lost.

    Attributes:
        stiffness: k in [N/m] or [N m/rad].
        rest: length at which the linear spring is unloaded, in [m] or [rad].
        damping: d in [N s/m] or [N m s/rad], 0 or more.
        preload: constant tension in [N] or [N m].
        text: the expression, in SI; empty for none.
        names: names of its parameters.
        values: their values.
        table: the table.
        over: what it is over, the length or its rate.
    """

    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    preload: float = 0.0
    text: str = ""
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    table: TabledFunction | None = None
    over: Literal["l", "v"] = "l"

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping"):
            at_least_zero(f"{name} of a spring", getattr(self, name))
        for name in ("rest", "preload"):
            if not abs(number(getattr(self, name))) < HUGE:
                raise InputError(f"{name} of a spring is {getattr(self, name)}; give a finite number")
        # rejects text that is no expression
        _ = self.instructions

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """The evaluation of its expression of l and v; empty for none."""
        return self._expression.instructions if self.text else ()

    @cached_property
    def _expression(self) -> Expression:
        return compiled(self.text, ("l", "v", *self.names))

    @property
    def reference(self) -> float:
        """As that of a stop."""
        return self.rest

    def phase(self, length: float, rate: float, before: float = OPEN) -> float:
        """Return the only phase."""
        return PRESSED

    def remaining(self, phase: float, length: Array, rate: Array) -> Array:
        """Return the distance to the end of the table, (n,); 1 without a table."""
        if self.table is None:
            return np.ones_like(length)
        (low, high), position = self.table.interval, length if self.over == "l" else rate
        return np.minimum(position - low, high - position)

    def tension(self, length: Array, rate: Array, phase: float | None = None) -> Array:
        """Return the tension, (n,); complex steps are propagated."""
        value = self.stiffness * (length - self.rest) + self.damping * rate + self.preload
        return value + self._tabled(length if self.over == "l" else rate) + self._written(length, rate)

    def elastic(self, length: Array, phase: float | None = None) -> Array:
        """Return the derivative of `energy` by the length, (n,)."""
        value = self.stiffness * (length - self.rest) + self.preload
        return value + self._tabled(length) if self.over == "l" else value

    def unstored(self, length: Array) -> Array:
        """Return the tension of the expression at rest, (n,)."""
        return self._written(length, 0.0 * length)

    def energy(self, length: Array) -> Array:
        """Return the stored energy, (n,) in [J]."""
        stretch = length - self.rest
        value = (0.5 * self.stiffness * stretch + self.preload) * stretch
        if self.table is not None and self.over == "l":
            value = value + self.table.spline.antiderivative()(np.real(length), extrapolate=True)
        return value

    def beyond(self, length: Array, rate: Array) -> str:
        """Return what is beyond the table in words; empty if nothing is."""
        if self.table is None:
            return ""
        values, (low, high) = np.real(length if self.over == "l" else rate), self.table.interval
        if ((values >= low) & (values <= high)).all():
            return ""
        return f"{self.over} leaves its range from {low:.6g} to {high:.6g} in table {self.table.text!r}"

    def _tabled(self, position: Array) -> Any:
        """Return the value of the table, (n,); its last polynomial beyond it, where no result is kept."""
        if self.table is None:
            return 0.0
        value = self.table.spline(np.real(position), extrapolate=True)
        if not np.iscomplexobj(position):
            return value
        return value + 1j * self.table.spline(np.real(position), 1, extrapolate=True) * np.imag(position)

    def _written(self, length: Array, rate: Array) -> Any:
        """Return the value of the expression, (n,), with complex steps by its derivatives."""
        if not self.text:
            return 0.0
        values: dict[str, Any] = {**dict(zip(self.names, self.values, strict=True)), "l": length, "v": rate}
        return self._expression.stepped(values, len(length))


@dataclass(frozen=True, slots=True)
class NonlinearSpring:
    """A spring with a law of its own.

    Attributes:
        ends: two points, or a joint coordinate.
        law: tension by length and rate.
        name: its name in a file; empty for a stop.
    """

    ends: tuple[str | tuple[str, Vector], str | tuple[str, Vector]] | str
    law: SoftStop | SpringLaw
    name: str = ""


Phases = tuple[float, ...]


def phases_of(
    springs: Sequence[NonlinearSpring], lengths: Array, rates: Array, before: Phases = ()
) -> Phases:
    """Return the phase of each spring at lengths and rates, (springs,), after other phases."""
    rows = zip(springs, lengths, rates, before or (OPEN,) * len(springs), strict=True)
    return tuple(spring.law.phase(float(q), float(v), phase) for spring, q, v, phase in rows)


# relative asymmetry, and relative negative eigenvalue, that are rounding of a file
ROUNDED = 1e-9


@dataclass(frozen=True, slots=True)
class Bushing:
    """A stiffness and a damping in six directions between frames on two links.

    In the frame of side a, d is the position of side b's origin and theta the rotation vector of side b,
    shorter than pi. The deflection x = (d, theta) stores x' K x / 2. With the rates y = (d', w) and the
    relative angular velocity w, side a exerts on side b, at b's origin,

        (f, m) = -K x,  force f,  moment J^-T m,  and the damping -C y.

    J is the left Jacobian of SO(3), theta' = J^-1 w; for one stiffness about all axes J^-T m = m. As a spring
    in a revolute joint, it takes the shorter way: at half a revolution theta jumps to the other side.

    Source: MSC Adams, BUSHING (the same with J = 1, for small rotations); Solà, Deray & Atchuthan 2018, "A
    micro Lie theory", eq. (146), for J^-1.

    Attributes:
        name: its name.
        a: frame on the first link: z along the axis, x along the reference.
        b: frame on the second link.
        stiffness: K, 6 x 6, symmetric without negative eigenvalues, in [N/m, N/rad; N, N m/rad].
        damping: C, likewise, per rate.

    Example: `Bushing("mount", End("ground"), End("engine"), diagonal(1e5, 1e5, 2e5, 80, 80, 40))`
    """

    name: str
    a: End
    b: End
    stiffness: tuple[tuple[float, ...], ...]
    damping: tuple[tuple[float, ...], ...] = ((0.0,) * 6,) * 6

    def __post_init__(self) -> None:
        if self.a.link == self.b.link:
            raise InputError(f"bushing {self.name!r} joins link {self.a.link!r} to itself; name two links")
        for what in ("stiffness", "damping"):
            matrix = numbers(getattr(self, what))
            if matrix.shape != (6, 6) or not (np.abs(matrix) < HUGE).all():
                raise InputError(
                    f"{what} of bushing {self.name!r} is not 6 x 6 finite numbers; give 6 rows of 6"
                )
            largest = np.abs(matrix).max()
            if np.abs(matrix - matrix.T).max() > ROUNDED * largest:
                raise InputError(
                    f"{what} of bushing {self.name!r} is not symmetric; give equal values on both sides of "
                    "its diagonal"
                )
            lowest = np.linalg.eigvalsh(matrix)[0]
            if lowest < -ROUNDED * largest:
                raise InputError(
                    f"{what} of bushing {self.name!r} has the negative eigenvalue {lowest:.4g}; give a "
                    "matrix without one"
                )

    @property
    def matrices(self) -> tuple[Array, Array]:
        """K and C."""
        return np.array(self.stiffness), np.array(self.damping)


def diagonal(*values: float) -> tuple[tuple[float, ...], ...]:
    """Return a 6 x 6 matrix from its diagonal."""
    return tuple(tuple(row) for row in np.diag(values).tolist())
