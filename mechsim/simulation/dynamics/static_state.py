"""MuJoCo at rest in a configuration: accelerations under the loads, and the eigenvalues of small motions."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.forces import Forces
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion
from mechsim.numerics.arrays import EPS, Array
from mechsim.numerics.differences import FIRST, extrapolated_derivative
from mechsim.numerics.rank import null_space
from mechsim.simulation import loop_jacobian
from mechsim.simulation.dynamics.applied_controls import AppliedControls, dofs_of, prepared
from mechsim.simulation.dynamics.forward_run import (
    FREE,
    ITERATIONS,
    NO_LINKS,
    closed_near,
    free_model,
    set_rotations,
    without_cuts,
)
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.state import mass_matrix

# time step that scales MuJoCo's constraints, in [s]; the model is not stepped
TIMESTEP = 1e-3
# compliances of its loops. With 1e-8 a lift under 2000 N, whose table weighs 0.001 kg, had frequencies 1e-6
# too high, with 1e-10 1e-8. But stiff loops round more: with 1e-10 a frequency of planar_3rrr was 2 % off,
# with 1e-8 less than 1e-5. The change between two of them shows both errors
COMPLIANCES = 10.0 ** -np.arange(6.0, 11.0)
# deviation of y' x from 1 above which y is no left vector of an eigenvalue; rounding is 1e-15
SINGLE = 1e-6


@dataclass(frozen=True, slots=True)
class StaticState:
    """A configuration in MuJoCo, at rest.

    Attributes:
        accelerations: along the independent directions, (dof,) in [rad or characteristic lengths /s2].
        stiffness: largest singular value of their derivative by displacements, in [1/s2].
        unconstrained: largest acceleration without the loops in these units, 0 without loops.
        eigenvalues: of small motions, (2 dof,) in [1/s].
        errors: bounds of their errors from the differences, (2 dof,) in [1/s].
    """

    accelerations: Array
    stiffness: float
    unconstrained: float
    eigenvalues: NDArray[np.complex128]
    errors: Array


class StaticModel:
    """A mechanism under its loads in MuJoCo, at rest in any of its configurations.

    Dry friction is left out; time-dependent loads have their values at time zero.

    Args:
        mechanism: links without an inertia are rods.
        forces: applied forces.
    """

    @quiet()
    def __init__(self, mechanism: Mechanism, forces: Forces) -> None:
        smooth = tuple(friction.smooth for friction in forces.friction)
        self.model = free_model(mechanism, replace(forces, friction=smooth), set())
        self.solved = [
            _Accelerations(self.model, compliance)
            for compliance in (COMPLIANCES if len(self.model.loops.scale) else COMPLIANCES[-1:])
        ]

    @quiet()
    def state(
        self,
        coordinates: Mapping[str, float],
        links: Mapping[str, LinkMotion] = NO_LINKS,
        others: Mapping[str, float] | None = None,
    ) -> StaticState:
        """Return MuJoCo's accelerations from rest and the eigenvalues of small motions, by differences.

        Args:
            coordinates: of all joints with one degree of freedom, in [m] or [rad], not wrapped.
            links: link -> its motion, whose first instant gives the rotations of spherical joints.
            others: coordinates from which those move that are not determined, such as MuJoCo's own in loops.

        Raises:
            AssemblyError: if MuJoCo's loops do not close at these coordinates.
        """
        model, loops = self.model, self.model.loops
        values, start = without_cuts(model, coordinates), without_cuts(model, others or {})
        qpos = model.qpos.copy()
        set_rotations(model.model, qpos, links)
        qpos[dofs_of(model, start)[0]] = [*start.values()]
        qpos = closed_near(model, loops, qpos, *dofs_of(model, values), np.array([*values.values()]))
        jacobian = loops.linearise(qpos[None])[1][0] * loops.scale[:, None] * loops.units
        basis = null_space(jacobian).T if len(jacobian) else np.eye(model.model.nv)
        rest, dof = np.zeros(model.model.nv), basis.shape[1]
        directions = (loops.units[:, None] * basis).T

        @cache
        def moved(step: float) -> Array:
            """Return the nearest closed states after steps forwards and backwards along each, (2 dof, nq)."""
            steps = step * np.repeat(directions, 2, 0) * np.tile([1.0, -1.0], dof)[:, None]
            states = loops.displaced(np.repeat(qpos[None], 2 * dof, 0), steps)
            every = np.arange(model.model.nv)
            return loop_jacobian.close(loops, states, loop_jacobian.nearest_steps(loops, every))

        def differences(solved: _Accelerations, step: float) -> Array:
            """Return the central differences by displacements, then by rates, (dof, 2 dof)."""
            states = [(each, rest) for each in moved(step)]
            states += [(qpos, sign * step * along) for along in directions for sign in (1, -1)]
            values = np.array([basis.T @ solved.accelerations(*state) for state in states])
            values = values.reshape(2 * dof, 2, dof)
            return (values[:, 0] - values[:, 1]).T / (2.0 * step)

        measured = [extrapolated_derivative(partial(differences, solved)) for solved in self.solved]
        errors = [error + np.abs(after - before) for (before, _), (after, error) in pairwise(measured)]
        errors = errors or [measured[0][1]]
        best = min(range(-len(errors), 0), key=lambda k: errors[k].max(initial=0.0))
        derivatives, error, data = measured[best][0], errors[best], self.solved[best].data
        at_rest = basis.T @ self.solved[best].accelerations(qpos, rest)
        mass = directions @ mass_matrix(data) @ directions.T
        rounding = EPS * (np.linalg.cond(mass) if dof else 0.0)
        without_loops = data.qacc_smooth / loops.units if len(jacobian) else rest
        unconstrained = float(np.abs(without_loops).max(initial=0.0))
        # loops cancel accelerations, also where no force remains along a family of equilibria
        largest = max(unconstrained, np.abs(differences(self.solved[best], FIRST)).max(initial=0.0) * FIRST)
        error = error + rounding * np.abs(derivatives).max(initial=0.0) + EPS * largest / FIRST
        eigenvalues, errors = _eigenvalues(derivatives, error)
        stiffness = float(np.linalg.norm(derivatives[:, :dof], 2)) if dof else 0.0
        return StaticState(at_rest, stiffness, unconstrained, eigenvalues, errors)


def _eigenvalues(derivatives: Array, error: Array) -> tuple[NDArray[np.complex128], Array]:
    """Return the eigenvalues of x' = A x and bounds of their errors, (2 dof,), from the lower half of A.

    A simple eigenvalue with left and right vectors y' x = 1 changes by up to |y|' |dA| |x|, a double one by
    the square root of the change of A.
    """
    dof = len(derivatives)
    matrix = np.concatenate([np.eye(dof, 2 * dof, dof), derivatives])
    values, right = np.linalg.eig(matrix)
    change = np.concatenate([np.zeros((dof, 2 * dof)), error])
    change += EPS * np.abs(matrix).max(initial=0.0)
    left = np.linalg.pinv(right, rcond=1e-15)
    simple = np.einsum("ki,ij,jk->k", np.abs(left), change, np.abs(right))
    # no left vector of a double eigenvalue with one right vector has y' x = 1
    simple[np.abs(np.einsum("ki,ik->k", left, right) - 1.0) > SINGLE] = np.inf
    double = np.sqrt(np.linalg.norm(error[:, :dof])) + np.linalg.norm(error[:, dof:])
    return values.astype(np.complex128), np.fmin(simple, double)


class _Accelerations:
    """MuJoCo's accelerations under its own constraint forces."""

    def __init__(self, model: LoadedModel, compliance: float) -> None:
        loops = prepared(model, replace(FREE, compliance=compliance), TIMESTEP, ITERATIONS)
        self.units = model.loops.units
        self.prepared_model, self.controls = loops.model, AppliedControls(model, loops)
        self.data = mujoco.MjData(loops.model)
        acting = enumerate(model.forces.actuators, model.actuators.actuators.start)
        self.stated = [(k, actuator) for k, actuator in acting if actuator.inflow is not None]

    def accelerations(self, qpos: Array, qvel: Array) -> Array:
        """Return the accelerations at a state, (nv,) in [rad or characteristic lengths /s2]."""
        data = self.data
        data.qpos[:], data.qvel[:], data.time = qpos, qvel, 0.0
        mujoco.mj_fwdPosition(self.prepared_model, data)
        mujoco.mj_fwdVelocity(self.prepared_model, data)
        for i, (k, actuator) in enumerate(self.stated):
            length, speed = data.actuator_length[[k]], data.actuator_velocity[[k]]
            data.act[i] = actuator.steady_state(np.zeros(1), length, speed)[0]
        with self.controls.installed(data) as expand:
            expand()
            mujoco.mj_forward(self.prepared_model, data)
        return np.asarray(data.qacc / self.units, dtype=np.float64)
