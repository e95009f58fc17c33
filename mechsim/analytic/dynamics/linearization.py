"""Linear dynamics about a configuration: natural frequencies, damping, mode shapes, frequency response.

In independent coordinates u along a basis N of the constraint null space the motion is u'' = a(u, u'). Its
derivatives are eighth-order central differences of the exact accelerations on the closed loops.

Source: K. Ogata, Modern Control Engineering (2010), chapter 9 (state space); B. Fornberg, Generation of
finite difference formulas on arbitrarily spaced grids, Mathematics of Computation 51 (1988) 699-706.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.start import CLOSED, close_nearest
from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm, null_spaces, significant

# displacements of the eighth-order central difference in steps, and their weights
MULTIPLES = np.array([1.0, 2.0, 3.0, 4.0, -1.0, -2.0, -3.0, -4.0])
WEIGHTS = np.sign(MULTIPLES) * np.tile([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0], 2)
# its step in [rad] or characteristic lengths: the truncation error is about STEP**8, rounding 1e-15 / STEP
STEP = 0.01
# eigenvalues below this fraction of the largest are zero: motions without restoring force; differences of the
# accelerations have an error of 1e-10 of the largest stiffness
NEUTRAL = 3e-5

Complex = NDArray[np.complex128]
# a function of n states with values (n,)
Quantity = Callable[[Kinematics], Array]


@dataclass(frozen=True, slots=True)
class Mode:
    """A mode of free vibration.

    Attributes:
        frequency: undamped natural frequency |s| / 2 pi of the eigenvalue s, in [Hz].
        damping_ratio: -Re s / |s|; 1 for a mode that decays without oscillation.
        eigenvalue: s in [1/s].
        shape: joint coordinate -> complex amplitude in [m] or [rad]; the largest, in characteristic lengths
            and radians, is 1.
    """

    frequency: float
    damping_ratio: float
    eigenvalue: complex
    shape: Mapping[str, complex]


@dataclass(frozen=True)
class LinearModel:
    """The linear equations x' = A x about a configuration, x = (u, u').

    Attributes:
        equations: equations of motion.
        q: the configuration.
        basis: basis of the null space of the loop constraints in the free coordinates in units, (free, dof).
        matrix: A, (2 dof, 2 dof).
        mass: reduced mass matrix, (dof, dof).
    """

    equations: EquationsOfMotion
    q: Coordinates
    basis: Array
    matrix: Array
    mass: Array

    @property
    def stable(self) -> bool:
        """Whether no eigenvalue has a positive real part beyond rounding."""
        values = np.linalg.eigvals(self.matrix)
        return bool(values.real.max(initial=-np.inf) <= NEUTRAL * np.abs(values).max(initial=0.0))

    def modes(self) -> tuple[Mode, ...]:
        """Return the modes by increasing frequency.

        A complex pair of eigenvalues is one mode, and so is a displacement without restoring force, whose
        eigenvalue 0 is double without damping.
        """
        eigenvalues, vectors = np.linalg.eig(self.matrix)
        values = np.asarray(eigenvalues, np.complex128)
        dof = self.basis.shape[1]
        _, neutral = null_spaces(self.matrix[dof:, :dof], NEUTRAL**2)
        pairs = [(0j, displacement.astype(np.complex128)) for displacement in neutral]
        for i in np.argsort(np.abs(values)):
            if values[i].imag >= 0.0 and abs(values[i]) > NEUTRAL * np.abs(values).max():
                pairs.append((complex(values[i]), vectors[:dof, i]))
        modes: list[Mode] = []
        for value, displacement in pairs:
            magnitude = abs(value)
            scaled: Complex = self.basis @ displacement
            scaled = scaled / scaled[np.argmax(np.abs(scaled))]
            ratio = float(-value.real / magnitude + 0.0) if magnitude > 0.0 else 0.0
            modes.append(Mode(float(magnitude / (2.0 * np.pi)), ratio, complex(value), self._by_name(scaled)))
        return tuple(modes)

    def _by_name(self, scaled: Complex) -> dict[str, complex]:
        loops, free = self.equations.loops, self.equations.free
        amplitude = np.zeros(loops.tree.count, np.complex128)
        amplitude[free] = scaled * loops.units[free]
        return {name: complex(amplitude[i]) for name, i in loops.tree.index_of.items()}

    def response(self, load: Quantity, output: Quantity, frequencies: ArrayLike) -> Complex:
        """Return the complex frequency response from a unit load to an output, (n,).

        Args:
            load: displacement on which the load does work: the coordinate of a joint for its torque, the
                component of a point for a force; its gradient is the load's generalised force.
            output: the quantity of the response.
            frequencies: (n,) in [Hz].
        """
        dof = self.basis.shape[1]
        forces, readings = (
            gradient(self.equations, self.q, self.basis, quantity) for quantity in (load, output)
        )
        entry = np.concatenate([np.zeros(dof), np.linalg.solve(self.mass, forces)])
        reading = np.concatenate([readings, np.zeros(dof)])
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
        resolvent = s[:, None, None] * np.eye(2 * dof) - self.matrix
        return np.linalg.solve(resolvent, entry.astype(np.complex128)[:, None])[..., 0] @ reading


def linear_model(
    equations: EquationsOfMotion, q: Coordinates, rates: Array | None = None, time: float = 0.0
) -> LinearModel:
    """Return the linear model about a configuration, at rest or with constant rates in units, (count, 1).

    Coulomb friction is ignored: it has no derivative at rest.
    """
    basis = independent_rates(equations, q)
    dof = basis.shape[1]
    steady = np.zeros(dof) if rates is None else basis.T @ rates[equations.free, 0]
    rate = max(1.0, float(np.abs(steady).max(initial=0.0)))
    offsets = _offsets(dof)
    none = np.zeros_like(offsets)
    u, du = np.concatenate([offsets, none]), np.concatenate([none, rate * offsets])
    state = states_about(equations, q, basis, u, steady + du)
    frictionless = np.zeros(len(equations.frictions))
    result = equations.accelerate(state, np.full(len(u), time), frictionless).acceleration
    by_displacement, by_rate = np.split(result[equations.free].T @ basis, 2)
    matrix = np.zeros((2 * dof, 2 * dof))
    matrix[:dof, dof:] = np.eye(dof)
    matrix[dof:, :dof] = _derivatives(by_displacement, dof).T
    matrix[dof:, dof:] = _derivatives(by_rate, dof).T / rate
    state = equations.kinematics(q, np.zeros((equations.loops.tree.count, 1)))
    mass = basis.T @ equations.mass(state)[0] @ basis
    return LinearModel(equations, q, basis, matrix, mass)


def independent_rates(equations: EquationsOfMotion, q: Coordinates) -> Array:
    """Return an orthonormal basis of the free coordinates' rates that satisfy the loops, (free, dof)."""
    jacobian = equations.loops.linearise(q)[1][:, equations.free, 0]
    if not jacobian.size:
        return np.eye(len(equations.free))
    _, values, right = np.linalg.svd(jacobian)
    return right[int(significant(values).sum()) :].T


def displaced_states(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array, rates: Array
) -> tuple[Kinematics, NDArray[np.bool_]]:
    """Return states at independent displacements and rates from n configurations, and which are closed.

    Args:
        equations: equations of motion.
        q: n configurations.
        basis: bases of their independent coordinates, (n, free, dof).
        u: displacements, (n, dof).
        rates: rates, (n, dof).
    """
    loops, free, n = equations.loops, equations.free, len(u)
    step = np.zeros((loops.tree.count, n))
    step[free] = (basis @ u[..., None])[..., 0].T
    moved, gap = close_nearest(loops, loops.displaced(q, step))
    jacobian = loops.linearise(moved)[1][:, free].transpose(2, 0, 1)
    rows = np.concatenate([jacobian, np.swapaxes(basis, 1, 2)], 1)
    velocity = np.zeros((loops.tree.count, n))
    velocity[free] = least_norm(rows, np.concatenate([np.zeros((n, loops.rows)), rates], 1)).T
    return equations.kinematics(moved, velocity), gap <= CLOSED


def states_about(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array, rates: Array
) -> Kinematics:
    """Return the closed states at independent displacements and rates, (n, dof) each, from one configuration.

    Raises:
        AssemblyError: if the loops of a state do not close.
    """
    bases = np.broadcast_to(basis, (len(u), *basis.shape))
    state, closed = displaced_states(equations, q.repeated(len(u)), bases, u, rates)
    if not closed.all():
        name = equations.model.mechanism.name
        raise AssemblyError(f"{name}: the loops do not close next to the equilibrium")
    return state


def gradient(equations: EquationsOfMotion, q: Coordinates, basis: Array, quantity: Quantity) -> Array:
    """Return the derivative of a quantity of the state by the independent coordinates, (dof,)."""
    dof = basis.shape[1]
    offsets = _offsets(dof)
    state = states_about(equations, q, basis, offsets, np.zeros_like(offsets))
    return _derivatives(quantity(state)[:, None], dof)[:, 0]


def _offsets(dof: int) -> Array:
    """Return the displacements of the central differences along each coordinate, (8 dof, dof)."""
    return (np.eye(dof)[:, None] * (STEP * MULTIPLES)[:, None]).reshape(-1, dof)


def _derivatives(values: Array, dof: int) -> Array:
    """Return the derivatives, (dof, k), from values (8 dof, k) at the displacements of `_offsets`."""
    differences: Array = np.einsum("dwk,w->dk", values.reshape(dof, len(WEIGHTS), -1), WEIGHTS)
    return differences / STEP
