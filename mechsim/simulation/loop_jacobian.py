"""The loop Jacobian with the crank locked: states with closed loops by Newton steps, rates."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics import rank as numerical_rank
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, significant
from mechsim.simulation.model_loops import ModelLoops

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices

# closure error, in characteristic lengths or [rad], that counts as rounding: a few times the error of
# Newton's method for a well-conditioned loop
CLOSED_ERROR = 1e-14
NEWTON = NewtonSettings(max_iterations=50, tolerance=CLOSED_ERROR, rounding=1e-11)

# Jacobians of n states, (n, m, nv), sparse for many DOFs
Jacobian: TypeAlias = "Array | SparseMatrices"
# Jacobians and dimensionless residuals (n, m) -> what is subtracted from the DOFs, (n, nv)
Step = Callable[[Jacobian, Array], Array]


@dataclass(frozen=True)
class LinearisedClosure:
    """Loop equations about n states: dimensionless residuals, and Jacobians on demand."""

    rhs: Array
    derivative: Callable[[], Array]
    equations: "LoopEquations"

    @property
    def matrix(self) -> Any:
        """Jacobians of the residuals in their units, (n, m, nv); sparse for many degrees of freedom."""
        return self.equations.loops.jacobian(self.derivative())

    def solution(self, right: Array, /) -> Array:
        """Return what is subtracted from the DOFs, (n, nv), for dimensionless residuals (n, m)."""
        return self.equations.step(self.matrix, right)


@dataclass(frozen=True)
class LoopEquations:
    """The loop equations of a model as a `numerics.newton.ConstraintSystem`, and steps that close them."""

    loops: ModelLoops
    step: Step

    def linearise(self, q: Array, /) -> LinearisedClosure:
        """Return the equations about n states, (n, nq)."""
        residual, derivative = self.loops.residual_and_derivative(q)
        return LinearisedClosure(residual * self.loops.scale, derivative, self)

    def retract(self, q: Array, step: Array, /) -> Array:
        """Return states displaced by steps in the DOFs, (n, nq)."""
        return self.loops.displaced(q, step)


def close(loops: ModelLoops, qpos: Array, step: Step | None = None) -> Array:
    """Return n states with closed loops and unchanged crank angles, by Newton's method.

    Args:
        loops: loops of the model.
        qpos: initial guesses, (n, nq).
        step: as in `close_each`.

    Raises:
        AssemblyError: if a loop does not close.
    """
    states, error = close_each(loops, qpos, step)
    worst = int(np.argmax(error))
    if not error.max(initial=0.0) < NEWTON.rounding:
        angle = float(states[worst, loops.crank_address])
        raise AssemblyError(
            f"{loops.name}: the loops do not close at {loops.drivers.text(angle)}: a closure error of "
            f"{error[worst]:.3g} of the longest link remains; change the dimensions, "
            f"{'the crank angle' if loops.drivers.crank else 'the driver positions'} or the start"
        )
    return states


def close_each(loops: ModelLoops, qpos: Array, step: Step | None = None) -> tuple[Array, Array]:
    """Return n states after Newton's method with the crank locked, and their closure errors, (n,).

    A state has converged if its closure error, in characteristic lengths or [rad], is below
    `NEWTON.rounding`; the error is that of the returned state, not of the iteration.

    Args:
        loops: loops of the model.
        qpos: initial guesses, (n, nq).
        step: the steps of all DOFs; None for those with the crank locked.
    """

    def locked(jacobian: Jacobian, right: Array) -> Array:
        return -newton_step(loops, right / loops.scale, jacobian)

    try:
        states = newton(LoopEquations(loops, step or locked), qpos, NEWTON).q
    except np.linalg.LinAlgError:
        states = qpos
    error = loops.closure_error(loops.residual(states))
    return states, np.where(np.isfinite(error), error, np.inf)


def nearest_steps(
    loops: ModelLoops,
    dofs: NDArray[np.int64],
    weights: Array | None = None,
    tolerance: float = RANK_TOLERANCE,
) -> Step:
    """Return steps that move some DOFs least, for `close`; the others keep their values.

    Args:
        loops: loops of the model.
        dofs: the DOFs, (k,).
        weights: those with small ones move least, (k,) in the units of the DOFs; by default the units.
        tolerance: singular values below this fraction of the largest are zero.
    """
    weights = loops.units[dofs] if weights is None else weights

    def step(jacobian: Jacobian, right: Array) -> Array:
        result = np.zeros((len(right), loops.model.nv))
        if isinstance(jacobian, np.ndarray):
            matrix = jacobian[:, :, dofs] * loops.scale[:, None] * weights
            result[:, dofs] = weights * numerical_rank.least_norm(matrix, right, tolerance)
            return result
        own = jacobian.restricted(dofs).scaled(loops.scale, weights)

        def dense(which: NDArray[np.intp]) -> Array:
            return numerical_rank.least_norm(own.whole(which), right[which], tolerance)

        result[:, dofs] = weights * own.least_norm(right, loops.bands, dense, regular=True)
        return result

    return step


def of_dofs(jacobian: Jacobian, dofs: NDArray[np.integer[Any]]) -> Jacobian:
    """Return the columns of some DOFs."""
    return jacobian[:, :, dofs] if isinstance(jacobian, np.ndarray) else jacobian.restricted(dofs)


def products(jacobian: Jacobian, rates: Array) -> Array:
    """Return the rates of residuals, (n, m), at rates of the DOFs, (n, k)."""
    if isinstance(jacobian, np.ndarray):
        return (jacobian @ rates[..., None])[..., 0]
    return jacobian.times(rates.T).T


def rounding(loops: ModelLoops) -> float:
    """Return the largest Jacobian entry that counts as rounding, in [m] or [rad] per [m] or [rad]."""
    return FLOOR * max(1.0, loops.characteristic_length)


def constrained_jacobian(loops: ModelLoops, jacobian: Array) -> Array:
    """Return the Jacobian without the crank's column, (n, m, nv - 1); zero if all entries are rounding."""
    matrix = jacobian[:, :, loops.free]
    if np.abs(matrix).max(initial=0.0) <= rounding(loops):
        matrix[:] = 0.0
    return matrix


def null_space(loops: ModelLoops, jacobian: Array) -> Array:
    """Return the directions that the loops of one state, (1, m, nv), leave free, (k, nv)."""
    constrained = constrained_jacobian(loops, jacobian)[0]
    return _with_crank_rate(loops, numerical_rank.null_space(constrained, floor=0.0), 0.0)


def solve(loops: ModelLoops, jacobian: Jacobian, right: Array) -> Array:
    """Return the minimum-norm x (n, nv - 1, k) of J x = right (n, m, k) in all DOFs but the crank.

    With a sparse Jacobian k is 1.
    """
    if not isinstance(jacobian, np.ndarray):

        def dense(which: NDArray[np.intp]) -> Array:
            return solve(loops, jacobian.whole(which), right[which])[..., 0]

        own = jacobian.restricted(loops.free)
        return own.least_norm(right[..., 0], loops.bands, dense, regular=False)[..., None]
    matrix = constrained_jacobian(loops, jacobian)
    reduced = loops.independent.reduced(matrix, right)
    if reduced is None:
        return np.linalg.pinv(matrix, rcond=RANK_TOLERANCE) @ right
    matrix, right = reduced
    if matrix.shape[1] == matrix.shape[2]:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    transposed = np.swapaxes(matrix, -1, -2)
    return transposed @ np.linalg.solve(matrix @ transposed, right)


def conditioning(loops: ModelLoops, jacobian: Jacobian) -> Array:
    """Return the distance of states from singular ones with the crank locked, (n,), 0 to about 1.

    It is the smallest singular value of the scaled Jacobian, without those that are zero at every state
    because of redundant constraints or unconstrained DOFs.
    """
    passive = np.setdiff1d(loops.free, loops.driven_dofs, assume_unique=True)
    if not isinstance(jacobian, np.ndarray):
        scaled = jacobian.scaled(loops.scale, loops.units).restricted(passive)
        if (smallest := scaled.smallest_singular_values()) is not None:
            return smallest
        jacobian = jacobian.whole()
    matrix = jacobian[:, :, passive] * loops.units[passive]
    matrix *= loops.scale[..., None]
    values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=False)
    if not values.size:
        return np.ones(len(matrix))
    rank = int(significant(values).sum(1).max())
    return values[:, rank - 1] if rank else np.ones(len(matrix))


def tangent(loops: ModelLoops, jacobian: Jacobian) -> Array:
    """Return the rates of all DOFs per radian of the crank, (n, nv), that keep the loops closed."""
    n = len(jacobian) if isinstance(jacobian, np.ndarray) else jacobian.values.shape[1]
    rates = _with_crank_rate(loops, np.zeros((n, loops.model.nv - 1)), 1.0)
    # normal equations square the condition number; the second step corrects that
    for _ in range(2):
        rates[:, loops.free] -= solve(loops, jacobian, products(jacobian, rates)[..., None])[..., 0]
    return rates


def newton_step(loops: ModelLoops, residual: Array, jacobian: Jacobian) -> Array:
    """Return the Newton step of the loops with the crank locked, (n, nv)."""
    step = solve(loops, jacobian, -residual[..., None])[..., 0]
    # a rotation of more than half a radian is beyond the linear model
    longest = np.abs(step).max(1, initial=0.0, where=loops.angular_dofs[loops.free])
    step *= (0.5 / np.maximum(0.5, longest))[:, None]
    return _with_crank_rate(loops, step, 0.0)


def _with_crank_rate(loops: ModelLoops, matrix: Array, crank: float) -> Array:
    """Return rates of all DOFs from those of all but the crank."""
    rates = np.empty((len(matrix), loops.model.nv))
    rates[:, loops.crank], rates[:, loops.free] = crank, matrix
    return rates
