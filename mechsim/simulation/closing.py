"""States with closed loops, by Newton's method with the crank or other degrees of freedom locked."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import least_norm
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops

# closure error, in characteristic lengths or [rad], that counts as rounding: a few times what Newton's method
# leaves in a well-conditioned loop
CLOSED = 1e-14
NEWTON = NewtonSettings(max_iterations=50, tolerance=CLOSED, rounding=1e-11)


@dataclass(frozen=True)
class LinearisedClosure:
    """Loop equations about n states: dimensionless residuals, and Jacobians on demand."""

    rhs: Array
    derivative: Callable[[], Array]

    @property
    def matrix(self) -> Array:
        """Jacobians of the residuals in their units, (n, m, nv)."""
        return self.derivative()


@dataclass(frozen=True)
class LoopEquations:
    """The loop equations of a model as a `numerics.newton.ConstraintSystem`."""

    loops: ModelLoops

    def linearise(self, q: Array, /) -> LinearisedClosure:
        """Return the equations about n states, (n, nq)."""
        residual, derivative = self.loops.residual_and_derivative(q)
        return LinearisedClosure(residual * self.loops.scale, derivative)

    def retract(self, q: Array, step: Array, /) -> Array:
        """Return states displaced by steps in the DOFs, (n, nq)."""
        return self.loops.displaced(q, step)


def close(loops: ModelLoops, qpos: Array, locked: NDArray[np.int64] | None = None) -> Array:
    """Return n states with closed loops and unchanged crank angles, by Newton's method.

    Args:
        loops: of the model.
        qpos: initial guesses, (n, nq).
        locked: as in `close_each`.

    Raises:
        AssemblyError: where a loop does not close.
    """
    states, error = close_each(loops, qpos, locked)
    worst = int(np.argmax(error))
    if not error.max(initial=0.0) < NEWTON.rounding:
        angle = float(states[worst, loops.crank_address])
        raise AssemblyError(
            f"{loops.name}: the loops do not close at {loops.driver_text(angle)}: a gap of "
            f"{error[worst]:.3g} of the longest link is left; change the dimensions, "
            f"{'the crank angle' if loops.drivers is None else 'where the drivers are'} or the start"
        )
    return states


def close_if_possible(loops: ModelLoops, qpos: Array) -> Array | None:
    """Return n states with closed loops, as `close` does; None where a loop does not close."""
    try:
        return close(loops, qpos)
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None


def close_each(
    loops: ModelLoops, qpos: Array, locked: NDArray[np.int64] | None = None
) -> tuple[Array, Array]:
    """Return n states after Newton's method with the crank locked, and their closure errors, (n,).

    A state has converged if its closure error, in characteristic lengths or [rad], is below
    `NEWTON.rounding`; the error is that of the returned state, not of the iteration.

    Args:
        loops: of the model.
        qpos: initial guesses, (n, nq).
        locked: indices of the DOFs that keep their values instead of the crank; the others move least.
    """
    if locked is None:
        step = partial(_crank_locked_step, loops)
    else:
        step = partial(_least_step, loops, np.setdiff1d(np.arange(loops.model.nv), locked))
    try:
        states = newton(LoopEquations(loops), qpos, NEWTON, step).q
    except np.linalg.LinAlgError:
        states = qpos
    error = loops.closure_error(loops.residual(states))
    return states, np.where(np.isfinite(error), error, np.inf)


def _crank_locked_step(loops: ModelLoops, jacobian: Array, scaled_residual: Array) -> Array:
    return -loop_jacobian.newton_step(loops, scaled_residual / loops.scale, jacobian)[0]


def _least_step(loops: ModelLoops, free: NDArray[np.int64], jacobian: Array, scaled_residual: Array) -> Array:
    step = np.zeros((len(jacobian), loops.model.nv))
    matrix = jacobian[:, :, free] * loops.scale[..., None] * loops.units[free]
    step[:, free] = loops.units[free] * least_norm(matrix, scaled_residual)
    return step
