"""Functions of couplings, with their first two derivatives: an expression of q, or a table."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mechsim.errors import InputError, several
from mechsim.mechanism.expressions import Expression, Instruction, Table, compiled, with_numbers
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# fewest rows of a table: a cubic spline through fewer is a single polynomial
MIN_ROWS = 4


@dataclass(frozen=True)
class WrittenFunction:
    """An expression of the driver's coordinate, in SI.

    Attributes:
        text: the expression.
        names: names of its parameters.
        values: their values in SI.
        variable: name of the coordinate in the text.
    """

    # of q in which an assembly is searched
    interval: ClassVar[tuple[float, float]] = (-np.pi, np.pi)

    text: str
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    variable: str = "q"

    def __post_init__(self) -> None:
        if not all(np.isfinite(entry).all() for entry in self(np.linspace(0.1, 0.9, 3))):
            raise InputError(f"function {self.text!r} has no finite value and derivatives about 0.5")

    @cached_property
    def expression(self) -> Expression:
        """The checked expression."""
        return compiled(self.text, (self.variable, *self.names))

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation at the one variable."""
        return with_numbers(self.expression.instructions, dict(zip(self.names, self.values, strict=True)))

    def __call__(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the value and its first two derivatives at q, exact to rounding; NaN if not finite."""
        q = np.asarray(q)
        result = self._evaluated(Jet(q, np.ones_like(q), np.zeros_like(q)))
        values = np.broadcast_arrays(result.value, result.rate, result.second, q)[:3]
        value, rate, second = (np.where(np.isfinite(entry), entry, np.nan) for entry in values)
        return value, rate, second

    def with_derivative(self, q: Array) -> tuple[Jet, Jet]:
        """Return the function and its derivative, each with two derivatives: a jet whose entries are jets."""
        zero, unit = np.zeros_like(q), np.ones_like(q)
        none: Any = Jet(zero, zero, zero)
        result = self._evaluated(Jet(Jet(q, unit, zero), Jet(unit, zero, zero), none))
        return none + result.value, none + result.rate

    def _evaluated(self, q: Jet) -> Jet:
        with np.errstate(all="ignore"):
            return self.expression.jet({**dict(zip(self.names, self.values, strict=True)), self.variable: q})


@dataclass(frozen=True)
class TabledFunction:
    """A cubic spline through a table, natural or periodic (de Boor, *A Practical Guide to Splines*, ch. 4).

    A periodic one advances in each period by the difference of its last and first value. Outside its table a
    natural one has no value.

    Attributes:
        text: name of its file.
        positions: of the driver's coordinate, rising.
        targets: values of the driven side.
        periodic: whether the last row repeats the first, one period later.
        variable: name of the coordinate, for messages.
    """

    text: str
    positions: tuple[float, ...]
    targets: tuple[float, ...]
    periodic: bool = False
    variable: str = "q"

    def __post_init__(self) -> None:
        positions, table = np.array(self.positions), np.array([self.positions, self.targets])
        if not (len(positions) >= MIN_ROWS and np.isfinite(table).all() and (np.diff(positions) > 0.0).all()):
            raise InputError(
                f"table {self.text!r} has {several(len(positions), 'row')} that are not all finite with "
                f"rising {self.variable}; give {MIN_ROWS} rows or more, sorted by {self.variable}"
            )

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of q in which an assembly is searched: its table."""
        return self.positions[0], self.positions[-1]

    @cached_property
    def advance(self) -> float:
        """Advance in a period, divided by it; 0 if not periodic."""
        span = self.positions[-1] - self.positions[0]
        return (self.targets[-1] - self.targets[0]) / span if self.periodic else 0.0

    @cached_property
    def spline(self) -> "CubicSpline":
        """The spline without its advance."""
        from scipy.interpolate import CubicSpline

        rest = np.array(self.targets) - self.advance * np.array(self.positions)
        if self.periodic:
            rest[-1] = rest[0]
            return CubicSpline(self.positions, rest, bc_type="periodic", extrapolate="periodic")
        return CubicSpline(self.positions, rest, bc_type="natural", extrapolate=False)

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation."""
        return Table(self.spline, "repeated" if self.periodic else "undefined", self.advance).instructions

    def __call__(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the value and its first two derivatives at q; complex steps are propagated."""
        advance, step = self.advance, 1j * np.imag(q) if np.iscomplexobj(q) else 0.0
        value, rate, second, third = (self.spline(np.real(q), order) for order in range(4))
        return value + advance * q + rate * step, rate + advance + second * step, second + third * step

    def with_derivative(self, q: Array) -> tuple[Jet, Jet]:
        """Return the function and its derivative, each with two derivatives."""
        value, rate, second = self(q)
        return Jet(value, rate, second), Jet(rate, second, self.spline(np.real(q), 3))


PlainFunction = WrittenFunction | TabledFunction
