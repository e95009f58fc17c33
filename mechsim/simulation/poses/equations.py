"""The loop equations of a compiled model for numerical continuation along its crank angle."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.state import BALL, FREE, SCALAR, cross_matrices, quaternion_addresses

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices

# displacement, in [rad] or characteristic lengths, of the pose at which DOFs without effect on the equations
# are detected; not a round number, so that no effect vanishes in that pose alone
PROBE = 0.2137


@dataclass(frozen=True, slots=True)
class ModelStates:
    """Positions of a model, (n, nq)."""

    qpos: Array

    def __len__(self) -> int:
        return len(self.qpos)

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "ModelStates":
        """Return the selected states."""
        return ModelStates(self.qpos[which])

    def repeated(self, times: int) -> "ModelStates":
        """Return all states, repeated one after another."""
        return ModelStates(np.tile(self.qpos, (times, 1)))


@dataclass(frozen=True)
class ModelEquations:
    """The equality constraints of a model as `numerics.loop_solver.DrivenEquations` in its DOFs.

    Attributes:
        closure: the constraints.
        start: closed state, (nq,).
    """

    closure: ModelLoops
    start: Array

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.closure.name

    @property
    def count(self) -> int:
        """Number of degrees of freedom."""
        return self.closure.model.nv

    @property
    def driven(self) -> tuple[int, ...]:
        """The crank, or the joint of the path parameter."""
        return (self.closure.crank,)

    @cached_property
    def rows(self) -> int:
        """Number of equations."""
        return len(self.closure.scale)

    @cached_property
    def units(self) -> Array:
        """Units of the DOFs, (nv,): 1 rad or the characteristic length."""
        return self.closure.units

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """DOFs that have an effect on the equations; a model may have thousands that have none."""
        step = np.full((self.count, 1), PROBE)
        probed = self.displaced(ModelStates(self.start[None]), step).qpos
        _, jacobian, _ = self.linearise(ModelStates(np.stack([self.start, probed[0]])))
        effective = (jacobian != 0.0).any((0, 2))
        effective[self.closure.crank] = False
        return np.flatnonzero(effective)

    def linearise(self, q: ModelStates) -> tuple[Array, Array, None]:
        """Return residuals (rows, n) and Jacobians (rows, nv, n), both without units."""
        residual, jacobian = self.closure.linearise(q.qpos)
        scale = self.closure.scale
        return (residual * scale).T, (jacobian * scale[:, None] * self.units).transpose(1, 2, 0), None

    def sparse(self, q: ModelStates) -> "tuple[Array, SparseMatrices, None]":
        """Return residuals and Jacobians as `linearise`."""
        residual, jacobian = self.closure.sparse(q.qpos)
        return (residual * self.closure.scale).T, jacobian.scaled(self.closure.scale, self.units), None

    def displaced(self, q: ModelStates, step: Array) -> ModelStates:
        """Return states displaced by a step (nv, n) in the units of the DOFs."""
        return ModelStates(self.closure.displaced(q.qpos, step.T * self.units))

    def flat(self, q: ModelStates) -> Array:
        """Return states as rows of numbers without units, (n, nq)."""
        return q.qpos / self._position_units

    def unflat(self, rows: Array, driven: Array) -> ModelStates:
        """Return states from approximate rows of numbers, and crank angles, (1, n).

        Extrapolation adds rounding errors to positions that the equations do not determine, and no equation
        corrects them. These positions keep their values at the start.
        """
        qpos = np.where(self._determined, rows * self._position_units, self.start)
        for first, _ in self._quaternions:
            quaternion = qpos[:, first : first + 4]
            quaternion /= np.sqrt((quaternion**2).sum(1, keepdims=True))
        qpos[:, self.closure.crank_address] = driven[0]
        return ModelStates(qpos)

    def along(self, q: ModelStates, reference: ModelStates, directions: Array) -> tuple[Array, Array]:
        """Return displacements along directions (k, u) from a reference, (n, k), and their derivatives."""
        addresses, dofs = self._scalar_entries
        whole = np.zeros((len(directions), self.count))
        whole[:, self.unknown] = directions
        scalar = (q.qpos[:, addresses] - reference.qpos[:, addresses]) / self.units[dofs]
        offsets = scalar @ whole[:, dofs].T
        derivative = np.repeat(whole[None], len(q), 0)
        for address, dof in self._quaternions:
            quaternion = slice(address, address + 4)
            w, v = _relative(reference.qpos[:, quaternion], q.qpos[:, quaternion])
            rotation = whole[:, dof : dof + 3]
            # twice the vector part of a relative rotation: the angle to third order
            offsets += 2.0 * v @ rotation.T
            derivative[..., dof : dof + 3] = rotation @ (w[:, None, None] * np.eye(3) + cross_matrices(v))
        return offsets, derivative[..., self.unknown]

    @cached_property
    def _quaternions(self) -> list[tuple[int, int]]:
        """Address of each quaternion in qpos, and its first DOF."""
        model = self.closure.model
        first = model.jnt_dofadr[np.isin(model.jnt_type, (FREE, BALL))]
        dofs = first + np.where(model.jnt_type[model.dof_jntid[first]] == FREE, 3, 0)
        return list(zip(quaternion_addresses(model), dofs.tolist(), strict=True))

    @cached_property
    def _scalar_entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Addresses in qpos and DOFs of the angles and displacements."""
        model = self.closure.model
        order = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
        kinds = model.jnt_type[model.dof_jntid]
        dofs = np.flatnonzero(np.isin(kinds, SCALAR) | ((kinds == FREE) & (order < 3)))
        return (model.jnt_qposadr[model.dof_jntid] + order)[dofs].astype(np.intp), dofs

    @cached_property
    def _determined(self) -> NDArray[np.bool_]:
        """Which entries of qpos the equations determine, (nq,)."""
        model = self.closure.model
        determined = np.zeros(model.nq, dtype=np.bool_)
        addresses, dofs = self._scalar_entries
        determined[addresses] = np.isin(dofs, self.unknown)
        for address, dof in self._quaternions:
            determined[address : address + 4] = dof in self.unknown
        return determined

    @cached_property
    def _position_units(self) -> Array:
        """Units of the entries of qpos, (nq,)."""
        units = np.ones(self.closure.model.nq)
        addresses, dofs = self._scalar_entries
        units[addresses] = self.units[dofs]
        return units


def _relative(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the scalars (n,) and vectors (n, 3) of the rotations from a to b, quaternions (n, 4), in a."""
    w, u, v = (a * b).sum(1), a[:, 1:], b[:, 1:]
    vector = a[:, :1] * v - b[:, :1] * u - (cross_matrices(u) @ v[..., None])[..., 0]
    sign = np.where(w < 0.0, -1.0, 1.0)
    return sign * w, sign[:, None] * vector
