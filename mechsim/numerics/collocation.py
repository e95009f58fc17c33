"""Polynomials through Chebyshev nodes: nodes, values, derivatives, integrals and error estimates.

Columns of values are interpolated together. Source: L. N. Trefethen, Approximation theory and approximation
practice (2013), chapters 3 to 5 for nodes and barycentric weights.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array, numbers, unique

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

    from mechsim.numerics.balls import Ball

# smallest number of rows for a quintic spline
MIN_ROWS = 6
# bound of the rounding errors of a spline's values, relative to its largest local coefficient: sums of six
# products by de Boor's recursion of depth five, about 60 roundings
SPLINE_ERROR = 1e-14


def quintic_spline(
    what: str, time: ArrayLike, value: ArrayLike
) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Return the quintic spline through a table, as times (n,) -> value, rate and acceleration, (n,) each.

    Args:
        what: name of the table, for messages.
        time: increasing, (n,) in [s], at least `MIN_ROWS` values.
        value: (n,).

    Returns:
        The spline; for times that are balls it returns balls.

    Raises:
        InputError: for columns of different length, too few rows, numbers that are not finite, or times that
            do not increase.
    """
    from scipy.interpolate import make_interp_spline

    time, value = numbers(time), numbers(value)
    if time.shape != value.shape or time.ndim != 1 or len(time) < MIN_ROWS:
        raise InputError(
            f"{what} has {time.shape} times and {value.shape} values; give two columns of equal length, "
            f"at least {MIN_ROWS} rows"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all() and (np.diff(time) > 0.0).all()):
        raise InputError(
            f"{what} has numbers that are not finite, or times that do not increase; correct the table"
        )
    spline = make_interp_spline(time, value, k=5)
    derivatives = [spline, *(spline.derivative(k) for k in (1, 2, 3))]

    def state(t: Any) -> Any:
        if isinstance(t, np.ndarray | float):
            return tuple(derivative(t) for derivative in derivatives[:3])
        from mechsim.numerics.balls import OUTWARD, Ball

        bounds = [_spline_bound(derivative, t) for derivative in derivatives]
        return tuple(
            Ball(derivatives[k](t.mid), (t.rad * bounds[k + 1] + SPLINE_ERROR * bounds[k]) * OUTWARD)
            for k in range(3)
        )

    return state


def _spline_bound(spline: "BSpline", t: "Ball") -> Array:
    """Return bounds of a spline's values over balls, from its local coefficients."""
    from mechsim.numerics.balls import OUTWARD

    first, last = (
        np.clip(np.searchsorted(spline.t, end, "right") - 1, spline.k, len(spline.t) - spline.k - 2)
        for end in (t.mid - t.rad * OUTWARD, t.mid + t.rad * OUTWARD)
    )
    sizes = np.abs(spline.c)
    pairs = zip(first - spline.k, last + 1, strict=True)
    return np.array([sizes[low:high].max() for low, high in pairs]) * (1.0 + SPLINE_ERROR)


@dataclass(frozen=True)
class Interpolant:
    """A polynomial through values at nodes.

    Attributes:
        nodes: parameters, (k,).
        states: values at the nodes, (k, w).
        weights: barycentric weights, (k,).
    """

    nodes: Array
    states: Array
    weights: Array

    @property
    def low(self) -> float:
        """Its lowest parameter."""
        return float(min(self.nodes[0], self.nodes[-1]))

    @property
    def high(self) -> float:
        """Its highest parameter."""
        return float(max(self.nodes[0], self.nodes[-1]))

    @property
    def length(self) -> float:
        """The range of the parameter."""
        return abs(float(self.nodes[-1] - self.nodes[0]))

    def evaluate(self, s: Array) -> Array:
        """Return the polynomial at parameters (n,), (n, w)."""
        return self.weights_at(s) @ self.states

    def weights_at(self, s: Array) -> Array:
        """Return the weights of the states at the nodes, (n, k), in the polynomial at parameters (n,)."""
        distance = s[:, None] - self.nodes
        at_node = distance == 0.0
        weights = np.where(at_node.any(1)[:, None], at_node, self.weights / np.where(at_node, 1.0, distance))
        total = weights.sum(1, keepdims=True)
        # far beyond the nodes the weights cancel: use the nearest node
        cancelled = total[:, 0] == 0.0
        if cancelled.any():
            weights[cancelled] = np.eye(len(self.nodes))[np.abs(distance[cancelled]).argmin(1)]
            total[cancelled] = 1.0
        return weights / total

    def value_at(self, s: float) -> Array:
        """Return the polynomial at one parameter, (w,)."""
        return self.evaluate(np.array([s]))[0]

    def derivative(self) -> Self:
        """Return the polynomial's derivative, through the same nodes."""
        distance = self.nodes[:, None] - self.nodes
        np.fill_diagonal(distance, 1.0)
        matrix = self.weights / self.weights[:, None] / distance
        np.fill_diagonal(matrix, 0.0)
        np.fill_diagonal(matrix, -matrix.sum(1))
        return replace(self, states=matrix @ self.states)

    def restricted(self, low: float, high: float) -> Self:
        """Return the same polynomial with nodes from one parameter to another."""
        nodes, weights = nodes_between(low, high, len(self.nodes))
        return replace(self, nodes=nodes, states=self.evaluate(nodes), weights=weights)

    def truncation_error(self) -> float:
        """Return the truncation error, estimated from the last three Chebyshev coefficients."""
        middle, reach = 0.5 * (self.nodes[0] + self.nodes[-1]), 0.5 * (self.nodes[-1] - self.nodes[0])
        basis = np.polynomial.chebyshev.chebvander((self.nodes - middle) / reach, len(self.nodes) - 1)
        return float(np.abs(np.linalg.solve(basis, self.states)[-3:]).max())


# distance below a junction within which a parameter belongs to the next polynomial
JUNCTION = 1e-12
S_co = TypeVar("S_co", bound=Interpolant, covariant=True)


@dataclass(frozen=True)
class Piecewise(Generic[S_co]):
    """Consecutive polynomials along a parameter.

    Attributes:
        segments: polynomials by increasing parameter.
    """

    segments: Sequence[S_co]

    @cached_property
    def _lows(self) -> Array:
        return np.array([segment.low for segment in self.segments])

    def groups(self, s: Array) -> Iterator[tuple[S_co, NDArray[np.intp]]]:
        """Yield polynomials, and the indices of the parameters (n,) in each."""
        owner = np.searchsorted(self._lows, s + JUNCTION, side="right") - 1
        owner = np.clip(owner, 0, len(self.segments) - 1)
        for i in unique(owner).tolist():
            yield self.segments[i], np.flatnonzero(owner == i)

    def segment_at(self, s: float) -> S_co:
        """Return the polynomial of a parameter."""
        return self.segments[max(int(np.searchsorted(self._lows, s + JUNCTION, side="right")) - 1, 0)]

    def evaluate(self, s: Array) -> Array:
        """Return the polynomials at parameters (n,), (n, w)."""
        values = np.empty((len(s), self.segments[0].states.shape[1]))
        for segment, index in self.groups(s):
            values[index] = segment.evaluate(s[index])
        return values

    def components(self, s: Array, columns: NDArray[np.intp]) -> Array:
        """Return one component of the polynomials, of index (n,), at each of the parameters (n,): (n,)."""
        values = np.empty(len(s))
        for segment, index in self.groups(s):
            weights = segment.weights_at(s[index])
            values[index] = np.einsum("nk,kn->n", weights, segment.states[:, columns[index]])
        return values

    def derivative(self) -> "Piecewise[S_co]":
        """Return their derivatives."""
        return Piecewise([segment.derivative() for segment in self.segments])


def nodes_between(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Return Chebyshev points of the second kind from one end to the other, and their barycentric weights."""
    cosines, weights = _chebyshev(count)
    nodes = 0.5 * (low + high) + 0.5 * (low - high) * cosines
    nodes[0], nodes[-1] = low, high
    return nodes, weights


def interpolation_error(states: Array) -> Array:
    """Return the error at odd nodes of the polynomial through even nodes, for columns (k, w): (w,)."""
    return np.abs(error_matrix(len(states)) @ states).max(0)


@cache
def error_matrix(count: int) -> Array:
    """Return the matrix of the errors at odd nodes of the polynomial through even nodes, (odd, count)."""
    nodes, half = nodes_between(0.0, 1.0, count)[0], nodes_between(0.0, 1.0, count // 2 + 1)
    weights, matrix = half[1] / (nodes[1::2, None] - half[0]), np.zeros((count // 2, count))
    matrix[:, ::2], matrix[:, 1::2] = weights / weights.sum(1, keepdims=True), -np.eye(count // 2)
    return matrix


@cache
def _chebyshev(count: int) -> tuple[Array, Array]:
    weights = np.where(np.arange(count) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    return np.cos(np.pi * np.arange(count) / (count - 1)), weights


def through(nodes: Array, states: Array) -> Interpolant:
    """Return the polynomial through values (k, w) at any nodes (k,)."""
    distance = 4.0 * (nodes[:, None] - nodes) / np.ptp(nodes)
    np.fill_diagonal(distance, 1.0)
    return Interpolant(nodes, states, 1.0 / distance.prod(1))


def extrapolated(x: Array, values: Array, degree: int, points: Array) -> Array:
    """Return least-squares polynomials of values (n, w) at x (n,) in [-1, 1], evaluated at points: (m, w)."""
    coefficients = np.linalg.lstsq(chebyshev.chebvander(x, degree), values)[0]
    return np.asarray(chebyshev.chebval(points, coefficients), dtype=np.float64).T


def integral(x: Array, values: Array) -> Array:
    """Return the integral from x[0] to each x (n,), increasing, of the polynomial through values (n,).

    Raises:
        LinAlgError: if two x coincide.
    """
    half = 0.5 * (x[-1] - x[0])
    scaled = (x - x[0]) / half - 1.0
    coefficients = np.linalg.solve(chebyshev.chebvander(scaled, len(x) - 1), values)
    return half * np.asarray(chebyshev.chebval(scaled, chebyshev.chebint(coefficients, lbnd=-1.0)))
