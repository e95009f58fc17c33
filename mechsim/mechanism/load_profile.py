"""A load as a function of crank angle or time: constant, table or function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError, several
from mechsim.mechanism.expressions import Instruction, Table
from mechsim.numerics.arrays import HUGE, REVOLUTION, Array
from mechsim.numerics.differences import extrapolated_derivative

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Over = Literal["angle", "time"]
# largest error of the span of a table, which is then stretched, relative to it: half a unit of six digits
PERIOD_TOLERANCE = 5e-6


@dataclass(frozen=True, slots=True)
class LoadProfile:
    """A load as a function of crank angle or time; made by `constant`, `table` or `function`.

    Attributes:
        over: independent variable: "angle" in [rad], "time" in [s]; None for a constant.
        value: values of that variable (n,) -> loads (n,) or (n, 3).
        width: number of components, 1 or 3.
    """

    over: Over | None
    value: Callable[[Array], Array]
    width: int

    @property
    def instructions(self) -> tuple[tuple[Instruction, ...] | None, ...]:
        """The evaluation of each component; None for a function in Python."""
        return getattr(self.value, "instructions", (None,) * self.width)

    def evaluate(self, angle: ArrayLike, time: ArrayLike | None = None) -> Array:
        """Return the values at crank angles in [rad] and times in [s], (n,) or (n, 3).

        Complex steps of the angles are propagated.

        Raises:
            InputError: outside the range of a table; for a function of time if the time is unknown; if a
                function returns anything but finite numbers.
        """
        if self.over == "time" and time is None:
            raise InputError(
                "a load over time needs times, and only crank angles are known; give the motion its time"
            )
        argument: Any = np.atleast_1d(np.asarray(time if self.over == "time" else angle))
        if np.iscomplexobj(argument):

            def difference(step: float) -> Array:
                ends = (self.evaluate(argument.real + sign * step, time) for sign in (1.0, -1.0))
                return np.subtract(*ends) / (2.0 * step)

            derivatives, _ = extrapolated_derivative(difference)
            derivatives *= argument.imag if self.width == 1 else argument.imag[:, None]
            return self.evaluate(argument.real, time) + 1j * derivatives
        positions = np.asarray(argument, dtype=np.float64)
        values = np.asarray(self.value(positions), dtype=np.float64)
        shape = (len(positions),) if self.width == 1 else (len(positions), self.width)
        if values.shape != shape:
            raise InputError(
                f"a load over {self.over} gives values of shape {values.shape} at {len(positions)} instants; "
                f"give them in shape {shape}"
            )
        finite = np.isfinite(values).reshape(len(positions), -1).all(1)
        if not finite.all():
            where = f"{positions[~finite][0]:.6g} {'s' if self.over == 'time' else 'rad'}"
            raise InputError(
                f"a load over {self.over} is not a finite number at {where}; correct the function"
            )
        return values


def constant(value: ArrayLike) -> LoadProfile:
    """Return a constant load: a number, or a vector of three components."""
    kept = np.asarray(value, dtype=np.float64)
    if kept.shape not in ((), (3,)) or not np.isfinite(kept).all():
        raise InputError(f"constant load is {value}; give a finite number or three")
    return LoadProfile(
        None, lambda position: np.broadcast_to(kept, position.shape + kept.shape).copy(), kept.size
    )


def function(call: Callable[[Array], Array], *, over: Over = "angle", width: int = 1) -> LoadProfile:
    """Return a load given by a function of arrays, (n,) -> (n,) or (n, width)."""
    if over not in ("angle", "time"):
        raise InputError(f"a load is over {over!r}; it can be over 'angle' or 'time'")
    if width not in (1, 3):
        raise InputError(f"a load has {width} components; it can have 1 or 3")
    return LoadProfile(over, call, width)


def whole_revolutions(span: float) -> int:
    """Return how many revolutions an angle in [rad] is, 0 if they are not whole."""
    number = round(span / REVOLUTION)
    return number if abs(span - number * REVOLUTION) <= PERIOD_TOLERANCE * abs(span) else 0


def table(
    positions_given: ArrayLike,
    values: ArrayLike,
    *,
    over: Over = "angle",
    periodic: bool | None = None,
    smooth: bool = False,
) -> LoadProfile:
    """Return a load that interpolates a table.

    A table over two revolutions repeats after them, as the gas force of a four-stroke engine.

    Args:
        positions_given: crank angles in [rad] or times in [s], increasing, (m,).
        values: (m,) or (m, 3).
        over: variable of the table, "angle" or "time".
        periodic: whether the table repeats: its last row equals the first, and angles span whole revolutions.
            The default is True for angles and False for times.
        smooth: interpolates by a cubic spline with two continuous derivatives instead of straight lines.

    Raises:
        InputError: for a table that does not increase, does not span whole revolutions, or is not periodic.
    """
    from scipy.interpolate import make_interp_spline

    x, y = np.asarray(positions_given, dtype=np.float64), np.asarray(values, dtype=np.float64)
    repeats = over == "angle" if periodic is None else periodic
    _require_table(x, y, over)
    if repeats:
        span, jump = float(x[-1] - x[0]), float(np.abs(y[-1] - y[0]).max())
        period = REVOLUTION * whole_revolutions(span) if over == "angle" else span
        if not period:
            raise InputError(
                f"load table does not span one revolution: it goes from {x[0]:.8g} to {x[-1]:.8g} rad, "
                f"{span:.8g} of {REVOLUTION:.8g}; give whole revolutions, both ends included"
            )
        if jump > 1e-9 * float(np.abs(y).max()):
            raise InputError(
                f"load table is not periodic: its last row differs from its first by {jump:.6g}; "
                "end it with the values of its first row"
            )
        x = x[0] + (x - x[0]) * (period / span)
        y = np.concatenate([y[:-1], y[:1]])
    least = 4 if smooth else 2
    if len(x) < least:
        raise InputError(f"load table has {several(len(x), 'row')}; give {least} or more")
    ends: str | None = None if not smooth else "periodic" if repeats else "natural"
    spline = make_interp_spline(x, y, k=3 if smooth else 1, bc_type=ends)
    value = Interpolated(over, float(x[0]), float(x[-1]), bool(repeats), spline)
    return function(value, over=over, width=1 if y.ndim == 1 else 3)


@dataclass(frozen=True, slots=True)
class Interpolated:
    """The values of a load table.

    Attributes:
        over: its variable.
        first: its first position.
        last: its last position.
        repeats: whether it repeats.
        spline: its B-spline.
    """

    over: Over
    first: float
    last: float
    repeats: bool
    spline: BSpline

    def __call__(self, positions: Array) -> Array:
        """Return the values at positions (n,), (n,) or (n, 3)."""
        first, last = self.first, self.last
        if self.repeats:
            return self.spline(first + np.mod(positions - first, last - first))
        slack = 1e-9 * (last - first)
        outside = (positions < first - slack) | (positions > last + slack)
        if outside.any():
            remedy = ", or let it span whole revolutions, 6.283185 rad each, after which it repeats"
            raise InputError(
                f"load table covers {self.over} {first:.8g} to {last:.8g}, but the motion needs "
                f"{positions[outside][0]:.6g}; make the table longer{remedy if self.over == 'angle' else ''}"
            )
        return self.spline(np.clip(positions, first, last))

    @property
    def instructions(self) -> tuple[tuple[Instruction, ...], ...]:
        """The evaluation of each component."""
        from scipy.interpolate import PPoly

        t, c, k = self.spline.tck
        columns = np.reshape(c, (len(c), -1)).T
        beyond = "repeated" if self.repeats else "undefined"
        polynomials = [PPoly.from_spline((t, column, k)) for column in columns]
        # knots of a B-spline lie beyond its ends
        inner = [PPoly(p.c[:, k:-k], p.x[k:-k]) for p in polynomials]
        return tuple(Table(polynomial, beyond).instructions for polynomial in inner)


def _require_table(x: Array, y: Array, over: str) -> None:
    if x.ndim != 1 or y.shape not in ((len(x),), (len(x), 3)) or len(x) < 2:
        raise InputError(
            f"load table has {over}s of shape {x.shape} and values of shape {y.shape}; "
            "give two rows or more, with one value or three each"
        )
    if not (np.isfinite(x).all() and (np.abs(y) < HUGE).all()):
        raise InputError(
            f"load table has an entry that is not a finite number below {HUGE:g}; correct the row"
        )
    rises = np.diff(x) > 0.0
    if not rises.all():
        row = int(np.argmin(rises)) + 1
        raise InputError(
            f"load table does not increase: {over} {x[row]:.6g} in row {row + 1} follows {x[row - 1]:.6g}; "
            f"sort the rows and give each {over} once"
        )
