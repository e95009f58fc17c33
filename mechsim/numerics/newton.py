"""Newton's method for many configurations at once, and Brent's method for one real root."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

Q = TypeVar("Q")

# reduction of the residual in a step below which Newton's method has stagnated
STAGNATION = 0.25


class Linearisation(Protocol):
    """Equations linearised about n configurations."""

    @property
    def rhs(self) -> Array:
        """Residuals, (n, m)."""
        ...

    @property
    def matrix(self) -> Array:
        """Jacobians by the unknowns, (n, m, k)."""
        ...

    def solution(self, right: Array, /) -> Array:
        """Return the unknowns (n, k) that give right sides (n, m) of square systems."""
        ...


@dataclass(frozen=True, slots=True)
class LinearEquations:
    """Equations linearised about n configurations, if nothing but residuals and Jacobians is needed.

    Attributes:
        rhs: residuals, (n, m).
        matrix: Jacobians by the unknowns, (n, m, k).
    """

    rhs: Array
    matrix: Array

    def solution(self, right: Array, /) -> Array:
        """Return the unknowns (n, k) that give right sides (n, m) of square systems."""
        return square_solution(self.matrix, right)


L = TypeVar("L", bound=Linearisation)
L_co = TypeVar("L_co", bound=Linearisation, covariant=True)


class ConstraintSystem(Protocol[Q, L_co]):
    """Equations whose configurations are displaced by vectors of the unknowns."""

    def linearise(self, q: Q, /) -> L_co:
        """Return the equations linearised about n configurations."""
        ...

    def retract(self, q: Q, step: Array, /) -> Q:
        """Return configurations displaced by steps of the unknowns, (n, k)."""
        ...


@dataclass(frozen=True, slots=True)
class NewtonSettings:
    """Settings of Newton's method. The length of a step is its largest component, in the unknowns' units.

    Attributes:
        max_iterations: limit of the number of steps.
        tolerance: the iteration ends once no residual exceeds it.
        rounding: residual below which a configuration has converged once a step reduces it by less than
            `STAGNATION`.
        last_step: a shorter step is the last one: with quadratic convergence only rounding remains.
        max_step: longer steps are shortened to this length.
        max_displacement: limit of the sum of the steps; a configuration above it is abandoned, since it may
            converge to another solution.
        verify: False omits the linearisation after a last step whose square is below the tolerance. For a
            close guess this saves a third of the time.
    """

    max_iterations: int = 8
    tolerance: float = 0.0
    rounding: float = 1e-13
    last_step: float = 1e-9
    max_step: float = np.inf
    max_displacement: float = np.inf
    verify: bool = True


@dataclass(frozen=True, slots=True)
class NewtonResult(Generic[Q, L]):
    """Configurations after Newton's method. The caller checks their residuals for convergence.

    Attributes:
        q: configurations.
        linearised: the equations about them.
        displacement: sum of the lengths of the steps, (n,); infinite where abandoned.
        unverified: last step, (n, k), if `linearised` is about the configurations before it.
    """

    q: Q
    linearised: L
    displacement: Array
    unverified: Array | None = None

    @property
    def residual(self) -> Array:
        """Largest residual of each configuration, (n,)."""
        return _largest(self.linearised.rhs)


# a state that a polynomial predicts beyond a dead centre can be so far away that its residual is infinite
@np.errstate(over="ignore", invalid="ignore")
def newton(
    system: ConstraintSystem[Q, L],
    q: Q,
    settings: NewtonSettings,
    solve: Callable[[Array, Array], Array] | None = None,
) -> NewtonResult[Q, L]:
    """Return configurations corrected by Newton's method until each has converged or is abandoned.

    Args:
        system: the equations.
        q: n configurations near solutions.
        settings: stopping criteria.
        solve: (n, m, k) and (n, m) -> solutions (n, k); the default solves square systems.

    Raises:
        LinAlgError: if a square system is singular.
    """
    linearised = system.linearise(q)
    residual = _largest(linearised.rhs)
    displacement, previous = np.zeros(len(residual)), np.full(len(residual), np.inf)
    active: NDArray[np.bool_] = np.ones(len(residual), dtype=np.bool_)
    for _ in range(settings.max_iterations):
        active &= ~((residual < settings.rounding) & (residual > STAGNATION * previous))
        # residuals below the tolerance are corrected too, down to rounding
        if not (active & (residual > settings.tolerance)).any():
            break
        right = linearised.rhs
        step = -(linearised.solution(right) if solve is None else solve(linearised.matrix, right))
        length = _largest(step)
        if settings.max_step < np.inf:
            step *= (settings.max_step / np.maximum(settings.max_step, length))[:, None]
        displacement += np.where(active, np.minimum(length, settings.max_step), 0.0)
        abandoned = active & ~(displacement < settings.max_displacement)
        displacement[abandoned] = np.inf
        active &= ~abandoned
        step = np.where(active[:, None], step, 0.0)
        q = system.retract(q, step)
        if not settings.verify and np.abs(step).sum(1).max() ** 2 < settings.tolerance:
            return NewtonResult(q, linearised, displacement, step)
        linearised = system.linearise(q)
        previous, residual = residual, _largest(linearised.rhs)
        active &= length >= settings.last_step
    return NewtonResult(q, linearised, displacement)


def square_solution(matrix: Array, right: Array) -> Array:
    """Return the solutions (n, k) of square systems (n, k, k) x = (n, k)."""
    solutions: Any = np.linalg.solve(matrix, right[..., None])
    return solutions[..., 0]


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of a function between two arguments with values of opposite sign, to rounding.

    Source: Brent's method, scipy.optimize.brentq.
    """
    from scipy import optimize

    brent: Any = optimize.brentq
    # a root of multiplicity three needs more than brentq's default of 100 iterations
    return float(brent(function, low, high, xtol=1e-300, rtol=1e-15, maxiter=1000))


def roots(function: Callable[..., Array], low: Array, high: Array, *others: NDArray[Any]) -> Array:
    """Return the roots (n,) of a function between arguments (n,) with values of opposite sign, to rounding.

    All are found at once: the function has arrays of rising arguments if `low` rises, and the elements of
    other arrays (n,) that belong to them.

    Source: Chandrupatla's method, scipy.optimize.elementwise.find_root.
    """
    if not len(low):
        return low
    from scipy.optimize import elementwise

    find: Any = elementwise.find_root
    return np.asarray(find(function, (low, high), args=others).x)


def _largest(values: Array) -> Array:
    return np.abs(values).max(1, initial=0.0)
