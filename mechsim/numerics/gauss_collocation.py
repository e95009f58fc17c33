"""Initial value problems by Gauss-Legendre collocation: all nodes of a step are evaluated in one call.

The polynomial of a step satisfies the differential equation at its nodes; fixed-point iteration determines
it, or Newton's method with the Jacobians at the predicted nodes if the equation is stiff. A vectorised
right-hand side costs little more at all nodes than at one, and a step is ten times as long as that of a
Runge-Kutta method of order 8.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.7,
and II (1996), section IV.8 (simplified Newton iterations); X. Bai, J. L. Junkins, Modified Chebyshev-Picard
iteration methods for orbit propagation, Journal of the Astronautical Sciences 58 (2011) 583-613.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.polynomial import legendre

from mechsim.numerics.arrays import Array

# (times (n,), states (n, size)) -> derivatives (n, size); NaN where they are undefined
Derivatives = Callable[[Array, Array], Array]
# (times (n,), states (n, size)) -> derivatives of these by the states, (n, size, size)
Jacobians = Callable[[Array, Array], Array]

# nodes of a step; 16 need a fifth more time, and the iteration limits 32 and more (four-bar, 1e-13)
NODES = 24
# nodes of a step of a stiff equation: with more, the rounding of the last coefficients limits the growth of
# the steps after a transient
STIFF_NODES = 12
# degree of the polynomial that extrapolates the derivative: higher degrees amplify rounding
DEGREE = 10
# largest number of iterations of a step; if more are needed, a shorter step takes less time
ITERATIONS = 20
# ratio of successive changes above which a change is rounding
SHRINKING = 0.5
# multiple of the tolerance up to which a change may be rounding
ROUNDING = 30.0
# the same for a stiff equation, whose derivative multiplies the rounding of a state by its fastest decay
STIFF_ROUNDING = 1e6
# number of last coefficients of the derivative whose largest is the error of a step
TAIL = 3
# next step: fraction of the longest that satisfies the tolerance; smallest and largest ratio to the last step
SAFETY, LEAST, LARGEST = 0.85, 0.2, 3.0
# change of the state in a first step, relative to its scale
FIRST_CHANGE = 0.1
# shortest step, relative to the spacing of floating-point numbers at its time
SPACINGS = 10.0


@dataclass(frozen=True, slots=True)
class GaussRule:
    """Nodes on [-1, 1], (n,), and matrices that act on a derivative's values at the nodes, (n, size).

    Attributes:
        nodes: Gauss-Legendre nodes.
        to_nodes: matrix of the integrals from -1 to each node, (n, n).
        to_end: vector of the integral from -1 to 1, (n,).
        to_series: matrix of the Legendre coefficients, (n, n).
        to_integral: matrix of the Legendre coefficients of the integral from -1, (n + 1, n).
        to_fit: matrix of the coefficients of the least-squares polynomial of `DEGREE`.
    """

    nodes: Array
    to_nodes: Array
    to_end: Array
    to_series: Array
    to_integral: Array
    to_fit: Array


@cache
def rule(count: int) -> GaussRule:
    """Return the rule with a number of nodes."""
    nodes, weights = legendre.leggauss(count)
    # by the discrete orthogonality of Legendre polynomials
    to_series = ((np.arange(count) + 0.5) * weights[:, None] * legendre.legvander(nodes, count - 1)).T
    to_integral = legendre.legint(to_series, lbnd=-1.0).astype(np.float64)
    to_fit = np.linalg.pinv(legendre.legvander(nodes, min(DEGREE, count - 1))).astype(np.float64)
    return GaussRule(
        nodes, legendre.legvander(nodes, count) @ to_integral, weights, to_series, to_integral, to_fit
    )


@dataclass(frozen=True, slots=True)
class StepSolution:
    """The polynomial solution of one step.

    Attributes:
        start: start of the step in [s].
        duration: duration of the step in [s].
        state: state at the start, (size,).
        derivative: derivatives at the nodes, (n, size).
        series: Legendre coefficients of the integrated derivative on [-1, 1], (n + 1, size).
    """

    start: float
    duration: float
    state: Array
    derivative: Array
    series: Array

    @classmethod
    def constant(cls, time: float, state: Array) -> "StepSolution":
        """Return the solution that stays in a state from a time in [s] on."""
        return cls(time, 1.0, state.copy(), np.zeros((1, len(state))), np.zeros((2, len(state))))

    @property
    def end(self) -> Array:
        """State at the end, (size,)."""
        return self.state + 0.5 * self.duration * (rule(len(self.derivative)).to_end @ self.derivative)

    def __call__(self, time: float | Array) -> Array:
        """Return the state (size,) at a time in [s] within the step, or the states (n, size) at n times."""
        x = 2.0 * (np.asarray(time) - self.start) / self.duration - 1.0
        return self.state + 0.5 * self.duration * legendre.legval(x, self.series).T

    def beyond(self, times: Array) -> Array:
        """Return states (n, size) at times (n,) in [s] after the step, by a polynomial of low degree."""
        fit = legendre.legint(rule(len(self.derivative)).to_fit @ self.derivative, lbnd=1.0)
        x = 2.0 * (times - self.start) / self.duration - 1.0
        return self.end + 0.5 * self.duration * legendre.legval(x, fit).T


def node_times(start: float, duration: float, count: int = NODES) -> Array:
    """Return the nodes of a step, (n,) in [s]."""
    return start + 0.5 * duration * (1.0 + rule(count).nodes)


def collocated(
    derivatives: Derivatives,
    start: float,
    state: Array,
    duration: float,
    guess: Array,
    tolerance: Array,
    rounding: float = ROUNDING,
    jacobians: Jacobians | None = None,
) -> tuple[StepSolution, float] | None:
    """Return the solution of one step and its last change relative to the tolerance; None without a solution.

    Args:
        derivatives: right-hand side.
        start: start of the step in [s].
        state: state at the start, (size,).
        duration: duration of the step in [s].
        guess: states at the nodes, (n, size); n is the number of nodes.
        tolerance: change of the states at which the iteration has converged, (size,).
        rounding: multiple of the tolerance up to which changes may be rounding.
        jacobians: of a stiff right-hand side, for Newton's method; None iterates a fixed point.
    """
    table, half, states = rule(len(guess)), 0.5 * duration, guess
    times, before = node_times(start, duration, len(guess)), np.inf
    solve = None if jacobians is None else _newton_solve(half * table.to_nodes, jacobians(times, guess))
    for _ in range(ITERATIONS):
        # a step that is far too long diverges and is rejected
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            derivative = derivatives(times, states)
            step = state + half * (table.to_nodes @ derivative) - states
            step = step if solve is None else solve(step)
            change = float((np.abs(step) / tolerance).max())
        states = states + step
        if not np.isfinite(change):
            return None
        if change < 1.0 or SHRINKING * before < change < rounding:
            if solve is not None:
                # of the states at the nodes: a stiff right-hand side multiplies their rounding
                derivative = np.linalg.solve(half * table.to_nodes, states - state).astype(np.float64)
            series = table.to_integral @ derivative
            return StepSolution(start, duration, state, derivative, series), change
        before = change
    return None


def _newton_solve(integrals: Array, jacobian: Array) -> Callable[[Array], Array]:
    """Return the function that solves (I - integrals x jacobian) step = residual, (n, size) each.

    Args:
        integrals: matrix of the integrals to each node, (n, n).
        jacobian: Jacobians at the nodes, (n, size, size).
    """
    from scipy.linalg import lu_factor, lu_solve

    count = jacobian.shape[0] * jacobian.shape[1]
    coupled = np.einsum("ij,jkl->ikjl", integrals, jacobian).reshape(count, count)
    if not np.isfinite(coupled).all():
        return lambda residual: np.full_like(residual, np.nan)
    factors = lu_factor(np.eye(count) - coupled)
    # a residual that is not finite rejects the step
    return lambda residual: lu_solve(factors, residual.ravel(), check_finite=False).reshape(residual.shape)


class GaussCollocation:
    """Successive steps of an initial value problem, with the interface of `scipy.integrate.OdeSolver`.

    Args:
        derivatives: right-hand side.
        t0: start in [s].
        y0: state at the start, (size,).
        t_bound: latest end in [s].
        rtol: error of a step relative to the displacement of the state and its scale.
        scale: scale of the state's components, (size,).
        origin: state from which displacements count, (size,).
        max_step: longest step in [s].
        jacobians: of a stiff right-hand side, for implicit steps.

    Attributes:
        t: time in [s].
        y: state, (size,); may be replaced between steps by a nearby state.
        status: "running", "finished" or "failed".
    """

    def __init__(
        self,
        derivatives: Derivatives,
        t0: float,
        y0: Array,
        t_bound: float,
        rtol: float,
        scale: Array,
        origin: Array,
        max_step: float = np.inf,
        jacobians: Jacobians | None = None,
    ) -> None:
        self.jacobians = jacobians
        self.rounding = ROUNDING if jacobians is None else STIFF_ROUNDING
        self.nodes = NODES if jacobians is None else STIFF_NODES
        self.derivatives, self.t, self.y, self.t_bound = derivatives, t0, y0, t_bound
        self.rtol, self.scale, self.origin, self.max_step = rtol, scale, origin, max_step
        self.status: Literal["running", "finished", "failed"] = "running"
        self._first = derivatives(np.array([t0]), y0[None])[0]
        change = float((np.abs(self._first) / scale).max())
        self._length = min(t_bound - t0, FIRST_CHANGE / change) if change > 0.0 else t_bound - t0
        self._solution: StepSolution | None = None

    def step(self) -> str:
        """Take one step; return a message if it fails, else an empty text."""
        tolerance = self.rtol * (self.scale + np.abs(self.y - self.origin))
        while self._length > SPACINGS * np.spacing(abs(self.t)):
            remaining, self._length = self.t_bound - self.t, min(self._length, self.max_step)
            # avoids a last step that is much shorter than the others
            length = remaining if self._length > 0.99 * remaining else min(self._length, 0.5 * remaining)
            result = collocated(
                self.derivatives,
                self.t,
                self.y,
                length,
                self._guess(length),
                tolerance,
                self.rounding,
                self.jacobians,
            )
            if result is None:
                self._length = 0.5 * length
                continue
            solution, change = result
            error = self._error(solution, tolerance)
            ratio = SAFETY * max(error, 1e-16) ** (-1.0 / self.nodes)
            # a shorter step does not reduce rounding
            ratio = 1.0 if 1.0 < error <= change else min(max(ratio, LEAST), LARGEST)
            self._length = length * ratio
            # the remaining change of the iteration is rounding
            if error <= max(1.0, change):
                self._accept(solution)
                return ""
            # the error may decrease less than the method's order predicts, as over a kink
            self._length = min(self._length, 0.5 * length)
        self.status = "failed"
        return "the step is shorter than the spacing of floating-point numbers"

    def dense_output(self) -> StepSolution:
        """Return the solution of the last step."""
        assert self._solution is not None
        return self._solution

    def _accept(self, solution: StepSolution) -> None:
        end = solution.start + solution.duration
        self._solution, self.y = solution, solution.end
        self.t = self.t_bound if solution.duration == self.t_bound - self.t else end
        if self.t >= self.t_bound:
            self.status = "finished"

    def _guess(self, length: float) -> Array:
        """Return extrapolated states at the nodes of the next step."""
        times = node_times(self.t, length, self.nodes)
        if self._solution is None:
            return self.y + (times - self.t)[:, None] * self._first
        states = self._solution.beyond(np.append(self.t, times))
        return self.y + states[1:] - states[0]

    def _error(self, solution: StepSolution, tolerance: Array) -> float:
        """Return the magnitude of the last coefficients of the derivative relative to the tolerance.

        A jump of the derivative before the first node or after the last one is in no coefficient: between
        them and the ends of the step, that of the polynomial's derivative from the true one counts. The
        coefficients of a stiff solution count instead: its derivative has the larger rounding.
        """
        half = 0.5 * solution.duration
        if self.jacobians is not None:
            return float((half * np.abs(solution.series[-TAIL:]).max(0) / tolerance).max())
        series = rule(self.nodes).to_series @ solution.derivative
        errors = half * np.abs(series[-TAIL:]).max(0) / tolerance
        if errors.max() <= 1.0:
            ends = np.array([solution.start, solution.start + solution.duration])
            exact = self.derivatives(ends, np.array([solution.state, solution.end]))
            jumps = np.nan_to_num(np.abs(exact - legendre.legval([-1.0, 1.0], series).T), nan=np.inf).max(0)
            errors = np.maximum(errors, half * (1.0 + rule(self.nodes).nodes[0]) * jumps / tolerance)
        return float(errors.max())
