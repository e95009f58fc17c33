"""The equations of the loops of a compiled model: residuals and Jacobians of many states at once.

MuJoCo computes the kinematics and the Jacobians; the equations are the model's own equality constraints.
No closed form is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError, first_names
from mechsim.mechanism.motion import ChangePointPolicy
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE, SPARSE
from mechsim.simulation.drivers import PARAMETER_JOINT, SINGLE_CRANK, Drivers
from mechsim.simulation.equality_rows import CouplingConstraint, FramePair, PointPair, RodPair, constraints
from mechsim.simulation.state import HINGE, PosedBodies, angular_dofs, displaced

if TYPE_CHECKING:
    from mechsim.numerics.banded import Bands, SparseMatrices

# largest number of states evaluated together, and of the entries of their Jacobians: they fit into the cache
CHUNK, CHUNK_NUMBERS = 2048, 2_000_000


class IndependentRows:
    """The independent constraints of a model, determined from the first Jacobian.

    The third equation of a planar loop is redundant in every pose. In an overconstrained loop such as
    Bennett's, the set of redundant equations changes from pose to pose.

    Attributes:
        basis: rows that are not zero, and bases of the independent constraints among them, (m, rank), and of
            the redundant ones; None before the first Jacobian.
    """

    def __init__(self) -> None:
        self.basis: tuple[NDArray[np.bool_], Array, Array] | None = None

    def reduced(self, matrix: Array, right: Array) -> tuple[Array, Array] | None:
        """Return independent equations J x = right, (n, rank, k) each; None if they change with the pose."""
        if self.basis is None:
            # rows out of the plane of a linkage are zero, and their basis takes long for a hundred loops
            rows = matrix[0].any(1)
            # a model may have thousands of unconstrained DOFs, which need no basis
            u, values, _ = np.linalg.svd(matrix[0, rows], full_matrices=rows.sum() > matrix.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self.basis = rows, u[:, :rank], u[:, rank:]
        rows, basis, redundant = self.basis
        largest, others = np.abs(matrix).max(initial=0.0), np.abs(matrix[:, ~rows]).max(initial=0.0)
        if not rows.all():
            matrix, right = matrix[:, rows], right[:, rows]
        ignored = np.abs(redundant.T @ matrix).max(initial=others)
        if ignored > RANK_TOLERANCE * largest:
            return None
        return (basis.T @ matrix, basis.T @ right) if redundant.size else (matrix, right)


@dataclass(frozen=True, eq=False)
class ModelLoops:
    """The equality constraints of a model with a crank, evaluated in batches.

    With several drivers, or a driver that is no hinge, the crank is the joint of the path parameter, and the
    motion laws are among the equations. `dataclasses.replace` makes copies with other fields.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        drivers: the drivers that follow motion laws, or a single crank.
        pairs, rods, frames, couplings: coincident points, points with a constant distance, parallel frames
            and coupled coordinates.
        posed: the kinematics of the model.
        independent: the independent constraints, shared by all copies.
        change_point: policy of a path of poses at change points.
    """

    model: mujoco.MjModel
    crank: int
    drivers: Drivers
    pairs: Sequence[PointPair]
    rods: Sequence[RodPair]
    frames: Sequence[FramePair]
    couplings: Sequence[CouplingConstraint]
    posed: PosedBodies
    independent: IndependentRows
    change_point: ChangePointPolicy = "smooth"

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model.names.partition(b"\0")[0].decode() or "model"

    @cached_property
    def crank_address(self) -> int:
        """Index of the crank in qpos."""
        return int(self.model.jnt_qposadr[self.model.dof_jntid[self.crank]])

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Indices of all degrees of freedom but the crank."""
        return np.delete(np.arange(self.model.nv), self.crank)

    @cached_property
    def angular_dofs(self) -> NDArray[np.bool_]:
        """Whether each DOF is an angle, (nv,)."""
        return angular_dofs(self.model)

    @cached_property
    def characteristic_length(self) -> float:
        """Largest distance of bodies and closing points from the origins of their bodies, in [m].

        Without any it is that of sites, joints and centres of mass, or 1 m.
        """
        model, ends = self.model, [local for pair in (*self.pairs, *self.rods) for local in pair.local]
        for points in (
            [*model.body_pos[1:], *ends],
            np.concatenate([model.site_pos, model.jnt_pos, model.body_ipos]),
        ):
            length = max((float(np.linalg.norm(point)) for point in points), default=0.0)
            if length > 0.0:
                return length
        return 1.0

    @cached_property
    def scale(self) -> Array:
        """Factors that make residuals dimensionless, (m,)."""
        factor = 1.0 / self.characteristic_length
        coupled = [1.0 if self.angular_dofs[row.left.dofs].all() else factor for row in self.couplings]
        driven = np.where(self.drivers.slides, factor, 1.0)
        lengths = np.full(self.point_rows.stop, factor)
        return np.concatenate([lengths, np.ones(3 * len(self.frames)), coupled, driven])

    @property
    def units(self) -> Array:
        """Scales of the DOFs, (nv,): 1 for angles in [rad], the characteristic length for displacements."""
        return np.where(self.angular_dofs, 1.0, self.characteristic_length)

    @property
    def chunk(self) -> int:
        """Number of states whose Jacobians are evaluated together, which limits memory."""
        return max(1, min(CHUNK, CHUNK_NUMBERS // max(1, len(self.scale) * self.model.nv)))

    @property
    def point_rows(self) -> slice:
        """The residuals of coincident points, then of rods, in [m]."""
        return slice(0, 3 * len(self.pairs) + len(self.rods))

    @property
    def rod_rows(self) -> slice:
        """The residuals of rods."""
        return slice(3 * len(self.pairs), self.point_rows.stop)

    @property
    def frame_rows(self) -> slice:
        """The residuals of parallel frames."""
        first = self.point_rows.stop
        return slice(first, first + 3 * len(self.frames))

    @property
    def coupled_rows(self) -> slice:
        """The residuals of coupled coordinates."""
        first = self.frame_rows.stop
        return slice(first, first + len(self.couplings))

    @property
    def driven_rows(self) -> slice:
        """The residuals of the motion laws, which are the last."""
        first = self.coupled_rows.stop
        return slice(first, first + len(self.drivers.dofs))

    @property
    def driven_dofs(self) -> NDArray[np.int64]:
        """The crank or all drivers."""
        return np.array([self.crank]) if self.drivers.crank else self.drivers.dofs.astype(np.int64)

    def residual(self, qpos: Array) -> Array:
        """Return the constraint residuals, (n, m) in [m] or [rad]."""
        return self.residual_and_derivative(qpos)[0]

    def linearise(self, qpos: Array) -> tuple[Array, Array]:
        """Return the constraint residuals, (n, m) in [m] or [rad], and their Jacobian, (n, m, nv)."""
        residual, values = self.residual_and_derivative(qpos)
        return residual, self.whole(values())

    def sparse(self, qpos: Array) -> "tuple[Array, SparseMatrices]":
        """Return the constraint residuals, (n, m) in [m] or [rad], and their sparse Jacobian, (m, nv)."""
        residual, values = self.residual_and_derivative(qpos)
        return residual, self.sparse_matrices(values())

    def linearised(self, qpos: Array) -> "tuple[Array, Array | SparseMatrices]":
        """Return the result of `sparse` for many degrees of freedom, else that of `linearise`."""
        residual, values = self.residual_and_derivative(qpos)
        return residual, self.jacobian(values())

    def jacobian(self, values: Array) -> "Array | SparseMatrices":
        """Return the Jacobian from its `entries`, (n, e), sparse for many degrees of freedom."""
        return self.whole(values) if self.model.nv < SPARSE else self.sparse_matrices(values)

    def sparse_matrices(self, values: Array) -> "SparseMatrices":
        """Return the sparse Jacobian, (m, nv), from its `entries`, (n, e)."""
        from mechsim.numerics.banded import SparseMatrices

        return SparseMatrices(*self.entries, values.T, (len(self.scale), self.model.nv))

    def whole(self, values: Array) -> Array:
        """Return the Jacobian, (n, m, nv), from its `entries`, (n, e)."""
        out = np.zeros((len(values), len(self.scale), self.model.nv))
        out[:, *self.entries] = values
        return out

    def residual_and_derivative(self, qpos: Array) -> tuple[Array, Callable[[], Array]]:
        """Return the residuals and a function for the `entries` of their Jacobian, (n, e).

        The function is valid until the next evaluation.
        """
        position, rotation, _ = self.posed.poses(qpos)
        bodies, local = self._ends
        points = position[:, bodies] + (rotation[:, bodies] @ local[..., None])[..., 0]
        gaps, lengths = points[:, 0] - points[:, 1], np.array([rod.length for rod in self.rods])
        # members of the loops: pairs before the first, rods before the second, then frames
        n, first, second = len(qpos), len(self.pairs), len(self.pairs) + len(self.rods)
        along = gaps[:, first:second] / lengths[:, None]
        errors = [pair.rotation_error(*(rotation[:, body] for body in pair.bodies)) for pair in self.frames]
        coupled = [coupling.residual(qpos)[:, None] for coupling in self.couplings]
        # a model without joints has no crank either
        angle = qpos[:, self.crank_address] if self.model.nv else np.zeros(len(qpos))
        drivers, law = self.drivers, self.drivers.law(angle)
        chunks = [
            gaps[:, :first].reshape(n, 3 * first),
            0.5 * ((along * gaps[:, first:second]).sum(2) - lengths),
            *(apart for apart, _ in errors),
            *coupled,
            qpos[:, drivers.addresses] - law[0].T,
        ]

        def values() -> Array:
            out, number = np.zeros((n, len(self.entries[0]))), self._numbers
            side, member, dofs = self._moving_dofs
            linear, angular = self.posed.rates(bodies[side, member], dofs, points[:, side, member])
            sign = np.where(side, -1.0, 1.0)[:, None]
            linear, angular = sign * linear, sign * angular
            # both sides may move with the same DOF
            for own in (side == 0, side == 1):
                pairs = own & (member < first)
                rows = 3 * member[pairs, None] + np.arange(3)
                out[:, number[rows, dofs[pairs, None]]] += linear[:, pairs]
                if self.rods:
                    rods = own & (member >= first) & (member < second)
                    stretching = (along[:, member[rods] - first] * linear[:, rods]).sum(2)
                    out[:, number[2 * first + member[rods], dofs[rods]]] += stretching
                for i, (_, rate) in enumerate(errors):
                    frame = own & (member == second + i)
                    rows = self.frame_rows.start + 3 * i + np.arange(3)
                    out[:, number[rows, dofs[frame, None]]] += angular[:, frame] @ rate.swapaxes(1, 2)
            for i, coupling in enumerate(self.couplings, self.coupled_rows.start):
                dofs = coupling.dofs
                out[:, number[i, dofs]] = coupling.jacobian(qpos, self.model.nv)[:, dofs]
            for i, (dof, rate) in enumerate(zip(drivers.dofs, law[1], strict=True), self.driven_rows.start):
                out[:, number[i, dof]] = 1.0
                out[:, number[i, self.crank]] = -rate
            return out

        return np.concatenate(chunks, 1), values

    @cached_property
    def _ends(self) -> tuple[NDArray[np.intp], Array]:
        """Bodies of both sides of points and frames, (2, k), and their points, (2, k, 3) in [m]."""
        members = (*self.pairs, *self.rods, *self.frames)
        bodies = np.array([each.bodies for each in members], dtype=np.intp).reshape(-1, 2)
        local = [each.local for each in (*self.pairs, *self.rods)] + [(np.zeros(3),) * 2] * len(self.frames)
        return bodies.T, np.array(local).reshape(-1, 2, 3).swapaxes(0, 1)

    @cached_property
    def _moving_dofs(self) -> NDArray[np.intp]:
        """The DOFs that move points and frames: side, number of the member and DOF of each, (3, e)."""
        moving = [self.posed.moving_dofs(bodies) for bodies in self._ends[0]]
        return np.hstack(
            [(np.full(len(dofs), side), member, dofs) for side, (member, dofs) in enumerate(moving)]
        )

    @cached_property
    def entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of all entries of the Jacobian that are nonzero at some state."""
        nonzero = np.zeros((len(self.scale), self.model.nv), dtype=np.bool_)
        _, member, dofs = self._moving_dofs
        pairs, points = len(self.pairs), len(self.pairs) + len(self.rods)
        for i, dof in zip(member.tolist(), dofs.tolist(), strict=True):
            # the row of a rod, or the three of a pair or a frame
            first = 3 * min(i, pairs) + min(max(i - pairs, 0), points - pairs) + 3 * max(i - points, 0)
            nonzero[first : first + (1 if pairs <= i < points else 3), dof] = True
        for i, coupling in enumerate(self.couplings, self.coupled_rows.start):
            nonzero[i, coupling.dofs] = True
        for i, dof in enumerate(self.drivers.dofs, self.driven_rows.start):
            nonzero[i, [dof, self.crank]] = True
        rows, columns = np.nonzero(nonzero)
        return rows, columns

    @cached_property
    def bands(self) -> "Bands":
        """Orders in which the sparse equations with the crank locked are banded."""
        return {}

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """The number of each entry among `entries`, (m, nv)."""
        numbers = np.zeros((len(self.scale), self.model.nv), dtype=np.intp)
        numbers[self.entries] = np.arange(len(self.entries[0]))
        return numbers

    def displaced(self, qpos: Array, step: Array) -> Array:
        """Return states displaced by a step in the DOFs, (n, nq)."""
        return displaced(self.model, qpos, step)

    def closure_error(self, residual: Array) -> Array:
        """Return the largest loop-closure error of each state, in characteristic lengths or [rad], (n,)."""
        return np.abs(residual * self.scale).max(1, initial=0.0)


def read_loops(model: mujoco.MjModel, crank: str = "crank", drivers: Drivers = SINGLE_CRANK) -> ModelLoops:
    """Return the loops of a compiled model with a crank, or with drivers under motion laws.

    Raises:
        InputError: if the model has no hinge with the crank's name.
    """
    crank = crank if drivers.crank else PARAMETER_JOINT
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, crank)
    if joint < 0 or model.jnt_type[joint] != HINGE:
        names = [model.joint(i).name for i in range(model.njnt)]
        raise InputError(
            f"the model has no hinge joint called {crank!r} (it has {first_names(names) or 'none'}); "
            f"name the driven hinge {crank!r}"
        )
    return loops_with_crank(model, int(model.jnt_dofadr[joint]), drivers)


def loops_with_crank(model: mujoco.MjModel, dof: int, drivers: Drivers = SINGLE_CRANK) -> ModelLoops:
    """Return the loops of a compiled model whose crank is a degree of freedom."""
    closing = constraints(model)
    return ModelLoops(model, dof, drivers, *closing, PosedBodies(model), IndependentRows())
