"""The loops of a compiled model: residuals and Jacobians of many states at once, and Newton's method.

MuJoCo computes the kinematics and the Jacobians; the equations are the model's own equality constraints.
No closed form is used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import ChangePointPolicy
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, null_spaces, significant
from mechsim.simulation import equality_rows
from mechsim.simulation.drivers import PARAMETER_JOINT, Drivers
from mechsim.simulation.equality_rows import CouplingConstraint, FramePair, PointPair, constraints
from mechsim.simulation.state import PosedBodies, rotated, rotated_quaternions

FREE, BALL, SLIDE, HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)

# closure error, in characteristic lengths or [rad], that counts as rounding: a few times what Newton's method
# leaves in a well-conditioned loop
CLOSED = 1e-14
NEWTON = NewtonSettings(max_iterations=50, tolerance=CLOSED, rounding=1e-11)


@dataclass(frozen=True, eq=False)
class ModelLoops:
    """The equality constraints of a model with a crank, evaluated and solved in batches.

    With several drivers, or one that is no hinge, the crank is the joint of the path parameter, and the
    motion laws are among the equations. A copy with another field is made by `dataclasses.replace`.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        drivers: the drivers that follow motion laws; None where only a crank is driven.
        pairs, frames, couplings: of the constraints.
        posed: the kinematics of the model, and the fields that differ between states.
        independent: the independent constraints, shared by all copies.
        change_point: policy of a path of poses at change points.
    """

    model: mujoco.MjModel
    crank: int
    drivers: Drivers | None
    pairs: Sequence[PointPair]
    frames: Sequence[FramePair]
    couplings: Sequence[CouplingConstraint]
    posed: PosedBodies
    independent: "_IndependentRows"
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
    def passive(self) -> NDArray[np.int64]:
        """Indices of the degrees of freedom that are neither crank nor driver."""
        return np.setdiff1d(self.free, self.driven_dofs)

    @cached_property
    def angular_dofs(self) -> NDArray[np.bool_]:
        """Whether each DOF is an angle; of the six of a free joint the first three are lengths."""
        kinds = self.model.jnt_type[self.model.dof_jntid]
        order = np.arange(self.model.nv) - self.model.jnt_dofadr[self.model.dof_jntid]
        return (kinds != SLIDE) & ~((kinds == FREE) & (order < 3))

    @cached_property
    def hinges(self) -> NDArray[np.bool_]:
        """Whether each entry of qpos is the angle of a hinge."""
        hinges = np.zeros(self.model.nq, dtype=np.bool_)
        hinges[self.model.jnt_qposadr[self.model.jnt_type == HINGE]] = True
        return hinges

    @cached_property
    def quaternions(self) -> list[int]:
        """Addresses of the quaternions in qpos."""
        kinds = self.model.jnt_type
        first = self.model.jnt_qposadr + np.where(kinds == FREE, 3, 0)
        return first[(kinds == FREE) | (kinds == BALL)].tolist()

    @property
    def in_quaternion(self) -> NDArray[np.bool_]:
        """Whether each entry of qpos belongs to a quaternion."""
        return np.isin(np.arange(self.model.nq), np.add.outer(self.quaternions, np.arange(4)))

    @cached_property
    def characteristic_lengths(self) -> Array:
        """Characteristic length of the model, in [m], (n,); (1,) where states share its fields."""
        bodies = np.atleast_3d(self.posed.fields.get("body_pos", self.model.body_pos[None]))
        offsets = [np.linalg.norm(bodies[:, 1:], axis=2).max(1, initial=0.0)]
        offsets += [
            np.linalg.norm(local, axis=1 if local.ndim > 1 else None)
            for pair in self.pairs
            for local in pair.local
        ]
        length = np.max(np.broadcast_arrays(*offsets), axis=0)
        return length if self.posed.fields else np.where(length > 0.0, length, _extent(self.model))

    @cached_property
    def scale(self) -> Array:
        """Factors that make residuals dimensionless, (m,); (n, m) where states have fields."""
        if self.posed.fields:
            return np.repeat(1.0 / self.characteristic_lengths[:, None], 3 * len(self.pairs), 1)
        factor = 1.0 / self.characteristic_length
        coupled = [1.0 if self.angular_dofs[row.left.dofs].all() else factor for row in self.couplings]
        driven = [] if self.drivers is None else np.where(self.drivers.slides, factor, 1.0)
        lengths = np.full(3 * len(self.pairs), factor)
        return np.concatenate([lengths, np.ones(3 * len(self.frames)), coupled, driven])

    @property
    def characteristic_length(self) -> float:
        """Characteristic length of the model, in [m], where all states share its fields."""
        (length,) = self.characteristic_lengths.tolist()
        return length

    @property
    def units(self) -> Array:
        """Scales of the DOFs, (nv,): 1 for angles in [rad], the characteristic length for displacements."""
        return np.where(self.angular_dofs, 1.0, self.characteristic_length)

    @property
    def rounding(self) -> float:
        """Jacobian entries below this, in [m] or [rad] per [m] or [rad], are rounding."""
        return FLOOR * max(1.0, float(self.characteristic_lengths.max()))

    @property
    def frame_rows(self) -> slice:
        """The residuals of parallel frames."""
        return slice(3 * len(self.pairs), 3 * (len(self.pairs) + len(self.frames)))

    @property
    def coupled_rows(self) -> slice:
        """The residuals of coupled coordinates."""
        first = self.frame_rows.stop
        return slice(first, first + len(self.couplings))

    @property
    def driven_rows(self) -> slice:
        """The residuals of the motion laws, which are the last."""
        first = self.coupled_rows.stop
        return slice(first, first + (0 if self.drivers is None else len(self.drivers.dofs)))

    @cached_property
    def followers(self) -> list[CouplingConstraint]:
        """The nonlinear couplings of coordinates that depend on the drivers only."""
        return [row for row in self._chain if row.nonlinear]

    @property
    def driven_dofs(self) -> NDArray[np.int64]:
        """The crank or all drivers."""
        return np.array(self._driven, dtype=np.int64)

    @cached_property
    def actuated_dofs(self) -> NDArray[np.int64]:
        """The DOFs that forces move in a stepped run: the crank or all drivers, then nonlinear followers."""
        nonlinear = [int(row.left.dofs[0]) for row in self.followers]
        return np.array([*self._driven, *nonlinear], dtype=np.int64)

    def actuated_rates(self, angle: Array, speed: Array) -> Array:
        """Return the rates of `actuated_dofs`, (n, k), at angles and speeds of the crank, (n,)."""
        values, speeds = {self.crank_address: angle}, {self.crank: speed}
        if self.drivers is not None:
            value, rate, _ = self.drivers.law(angle)
            values |= dict(zip(self.drivers.addresses.tolist(), value, strict=True))
            speeds |= dict(zip(self.drivers.dofs.tolist(), rate * speed, strict=True))
        rates = equality_rows.rates(self._chain, values, speeds)
        return np.stack([rates[int(dof)] for dof in self.actuated_dofs], 1)

    @property
    def _driven(self) -> list[int]:
        return [self.crank] if self.drivers is None else self.drivers.dofs.tolist()

    @cached_property
    def _chain(self) -> list[CouplingConstraint]:
        return equality_rows.chained(self.couplings, self._driven)

    def driver_text(self, angle: float) -> str:
        """Return the crank angle or the driver values as text."""
        return f"crank angle {angle:.6g} rad" if self.drivers is None else self.drivers.text(angle)

    def with_fields(self, fields: Mapping[str, Array]) -> "ModelLoops":
        """Return the loops of n states with different model fields, name -> (n, ...).

        Its methods then take n states. All loops must be closed by site points; the independent constraint
        rows are those of the model itself.
        """
        sites = fields["site_pos"]
        closing = zip(self.pairs, self.model.eq_obj1id, self.model.eq_obj2id, strict=True)
        pairs = [replace(pair, local=(sites[:, a], sites[:, b])) for pair, a, b in closing]
        independent = _IndependentRows(self.independent.basis)
        return replace(self, pairs=pairs, posed=PosedBodies(self.model, fields), independent=independent)

    def residual(self, qpos: Array) -> Array:
        """Return the constraint residuals, (n, m) in [m] or [rad]."""
        return self.residual_and_derivative(qpos)[0]

    def linearise(self, qpos: Array) -> tuple[Array, Array]:
        """Return the constraint residuals, (n, m) in [m] or [rad], and their Jacobian, (n, m, nv)."""
        residual, jacobian = self.residual_and_derivative(qpos)
        return residual, jacobian()

    def residual_and_derivative(self, qpos: Array) -> tuple[Array, Callable[[], Array]]:
        """Return the residuals and a function for their Jacobian, valid until the next evaluation."""
        position, rotation, point_jacobian = self.posed.poses(qpos)
        n, nv = len(qpos), self.model.nv
        ends = [
            [(body, position[:, body] + rotated(rotation[:, body], local)) for body, local in pair.ends]
            for pair in self.pairs
        ]
        errors = [pair.rotation_error(*(rotation[:, body] for body in pair.bodies)) for pair in self.frames]
        coupled = [coupling.residual(qpos)[:, None] for coupling in self.couplings]
        drivers, law = self.drivers, None
        if drivers is not None:
            law = drivers.law(qpos[:, self.crank_address])
            coupled.append(qpos[:, drivers.addresses] - law[0].T)
        chunks = [
            np.zeros((n, 0)),
            *(a[1] - b[1] for a, b in ends),
            *(apart for apart, _ in errors),
            *coupled,
        ]

        def jacobian() -> Array:
            chunks = [np.zeros((n, 0, nv))]
            fixed = np.zeros((n, 3, nv))
            for points in ends:
                a, b = (point_jacobian(body, point)[0] if body else fixed for body, point in points)
                chunks.append(a - b)
            for pair, (_, rate) in zip(self.frames, errors, strict=True):
                a, b = (point_jacobian(body, position[:, body])[1] if body else fixed for body in pair.bodies)
                chunks.append(rate @ (a - b))
            chunks += [coupling.jacobian(qpos, nv)[:, None] for coupling in self.couplings]
            if drivers is not None and law is not None:
                rows = np.zeros((n, len(drivers.dofs), nv))
                rows[:, np.arange(len(drivers.dofs)), drivers.dofs] = 1.0
                rows[:, :, self.crank] = -law[1].T
                chunks.append(rows)
            return np.concatenate(chunks, 1)

        return np.concatenate(chunks, 1), jacobian

    def body_poses(self, qpos: Array) -> tuple[Array, Array]:
        """Return positions and rotations of all bodies at n states, (n, nbody, 3) and (n, nbody, 3, 3)."""
        position, rotation, _ = self.posed.batch_poses(qpos)
        return position.copy(), rotation.copy()

    def site_positions(self, qpos: Array) -> Array:
        """Return the positions of all sites at n states, (n, nsite, 3) in [m]."""
        position, rotation, _ = self.posed.batch_poses(qpos)
        bodies, local = self.model.site_bodyid, self.posed.fields.get("site_pos", self.model.site_pos)
        return position[:, bodies] + (rotation[:, bodies] @ local[..., None])[..., 0]

    def centres(self, qpos: Array) -> Array:
        """Return the centres of mass of all bodies at n states, (n, nbody, 3) in [m]."""
        position, rotation, _ = self.posed.batch_poses(qpos)
        return position + (rotation @ self.model.body_ipos[..., None])[..., 0]

    def point_positions(self, qpos: Array) -> Array:
        """Return the positions of all sites and loop-closing points at n states, (n, k, 3) in [m]."""
        position, rotation, _ = self.posed.batch_poses(qpos)
        ends = [end for pair in self.pairs for end in pair.ends]
        points = [position[:, body] + rotation[:, body] @ local for body, local in ends]
        return np.concatenate(
            [np.stack(points, 1) if points else position[:, :0], self.site_positions(qpos)], 1
        )

    def closure_error(self, residual: Array) -> Array:
        """Return the largest loop-closure error of each state, in characteristic lengths or [rad], (n,)."""
        return np.abs(residual * self.scale).max(1, initial=0.0)

    def constrained_jacobian(self, jacobian: Array) -> Array:
        """Return the Jacobian without the crank's column, (n, m, nv - 1); zero where all is rounding."""
        matrix = jacobian[:, :, self.free]
        if np.abs(matrix).max(initial=0.0) <= self.rounding:
            matrix[:] = 0.0
        return matrix

    def null_space(self, jacobian: Array) -> Array:
        """Return the directions that the loops of one state, (1, m, nv), leave free, (k, nv)."""
        return self._with_crank_rate(null_spaces(self.constrained_jacobian(jacobian)[0], floor=0.0)[1], 0.0)

    def solve(self, jacobian: Array, right: Array) -> Array:
        """Return the minimum-norm x (n, nv - 1, k) of J x = right (n, m, k) in all DOFs but the crank."""
        matrix = self.constrained_jacobian(jacobian)
        rows = self.independent.basis_of(matrix)
        if rows is None:
            return np.linalg.pinv(matrix, rcond=RANK_TOLERANCE) @ right
        if rows.shape[1] < rows.shape[0]:
            matrix, right = rows.T @ matrix, rows.T @ right
        if matrix.shape[1] == matrix.shape[2]:
            return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        transposed = np.swapaxes(matrix, -1, -2)
        return transposed @ np.linalg.solve(matrix @ transposed, right)

    @property
    def has_undetermined_dofs(self) -> bool:
        """Whether the loops leave DOFs other than the crank undetermined, as of the last solution."""
        return self.independent.basis is not None and len(self.independent.row_space) < len(self.free)

    def determinant_sign(self, jacobian: Array) -> Array:
        """Return the sign of the Jacobian's determinant with the crank locked, (n,): +1 or -1; 0 if unknown.

        Two assemblies that coincide at a dead centre have opposite signs; between dead centres the sign is
        constant.
        """
        matrix = self.constrained_jacobian(jacobian)
        rows = self.independent.basis_of(matrix)
        return (
            np.zeros(len(matrix))
            if rows is None
            else np.linalg.slogdet(self.independent.square(matrix, rows))[0]
        )

    def sign_changed(self, before: Array, beyond: Array) -> NDArray[np.bool_]:
        """Return whether the determinant's sign changed from states to states near them, (n,).

        Where the independent constraints change with the pose, those of the states before are used.

        Args:
            before, beyond: Jacobians, (n, m, nv).
        """
        sides = self.determinant_sign(before) * self.determinant_sign(beyond)
        for i in np.flatnonzero(sides == 0.0):
            sides[i] = self.determinant(np.stack([before[i], beyond[i]]))[1]
        return sides < 0.0

    def determinant(self, jacobian: Array) -> Array:
        """Return the determinant of the Jacobian with the crank locked, (n,), with a common scale.

        Where the independent constraints change with the pose, it is that of the first state's constraints
        and positive there; signs are then comparable within one call only.
        """
        matrix, independent, sign = self.constrained_jacobian(jacobian), self.independent, 1.0
        rows = independent.basis_of(matrix)
        if rows is None:
            rows = np.linalg.svd(matrix[0], full_matrices=False)[0][:, : len(independent.row_space)]
            sign = np.linalg.slogdet(independent.square(matrix[:1], rows))[0]
        signs, log_values = np.linalg.slogdet(independent.square(matrix, rows))
        if independent.log_scale is None:
            independent.log_scale = float(log_values[0]) if np.isfinite(log_values[0]) else 0.0
        return sign * signs * np.exp(np.minimum(log_values - independent.log_scale, 300.0))

    def least_constrained_direction(self, jacobian: Array) -> Array:
        """Return the direction that the loops of one state, (1, m, nv), constrain least, (nv,).

        The crank is locked; unconstrained DOFs do not contribute.
        """
        matrix = self.constrained_jacobian(jacobian)
        self.independent.basis_of(matrix)
        row_space = self.independent.row_space
        direction = np.linalg.svd(matrix @ row_space.T)[2][:, len(row_space) - 1] @ row_space
        return self._with_crank_rate(direction, 0.0)[0]

    def conditioning(self, jacobian: Array) -> Array:
        """Return the distance of states from singular ones with the crank locked, (n,), 0 to about 1.

        It is the smallest singular value of the scaled Jacobian, without those that are zero at every state
        because of redundant constraints or unconstrained DOFs.
        """
        lengths = self.characteristic_lengths[:, None, None]
        matrix = jacobian[:, :, self.passive] * np.where(self.angular_dofs[self.passive], 1.0, lengths)
        matrix *= self.scale[..., None]
        values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=False)
        if not values.size:
            return np.ones(len(matrix))
        rank = int(significant(values).sum(1).max())
        return values[:, rank - 1] if rank else np.ones(len(matrix))

    def max_rate(self, rates: Array) -> float:
        """Return the largest of rates (n, nv), in [rad] or in characteristic lengths."""
        return float(np.abs(rates / self.units).max(initial=0.0))

    def tangent(self, jacobian: Array) -> Array:
        """Return the rates of all DOFs per radian of the crank, (n, nv), that keep the loops closed."""
        driven = -jacobian[:, :, [self.crank]]
        rates = self.solve(jacobian, driven)
        # normal equations square the condition number; one refinement step corrects that
        rates += self.solve(jacobian, driven - jacobian[:, :, self.free] @ rates)
        return self._with_crank_rate(rates[..., 0], 1.0)

    def newton_step(self, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """Return the Newton step of the loops with the crank locked, and the tangent, (n, nv) each."""
        both = self.solve(jacobian, np.stack([-residual, -jacobian[:, :, self.crank]], -1))
        step = both[..., 0]
        # a rotation of more than half a radian is beyond the linear model
        longest = np.abs(step).max(1, initial=0.0, where=self.angular_dofs[self.free])
        step *= (0.5 / np.maximum(0.5, longest))[:, None]
        return self._with_crank_rate(step, 0.0), self._with_crank_rate(both[..., 1], 1.0)

    def _with_crank_rate(self, matrix: Array, crank: float) -> Array:
        """Return rates of all DOFs from those of all but the crank."""
        rates = np.empty((len(matrix), self.model.nv))
        rates[:, self.crank], rates[:, self.free] = crank, matrix
        return rates

    def close(self, qpos: Array) -> Array:
        """Return n states with closed loops and unchanged crank angles, by Newton's method.

        Args:
            qpos: initial guesses, (n, nq).

        Raises:
            AssemblyError: where a loop does not close.
        """
        states, error = self.close_each(qpos)
        worst = int(np.argmax(error))
        if not error.max(initial=0.0) < NEWTON.rounding:
            angle = float(states[worst, self.crank_address])
            raise AssemblyError(
                f"{self.name}: the loops do not close at {self.driver_text(angle)}: a gap of "
                f"{error[worst]:.3g} of the longest link is left; change the dimensions, "
                f"{'the crank angle' if self.drivers is None else 'where the drivers are'} or the start"
            )
        return states

    def close_each(self, qpos: Array) -> tuple[Array, Array]:
        """Return n states after Newton's method with the crank locked, and their closure errors, (n,).

        A state has converged if its closure error, in characteristic lengths or [rad], is below
        `NEWTON.rounding`; the error is that of the returned state, not of the iteration.
        """
        try:
            states = newton(_Equations(self), qpos, NEWTON, self._scaled_step).q
        except np.linalg.LinAlgError:
            states = qpos
        error = self.closure_error(self.residual(states))
        return states, np.where(np.isfinite(error), error, np.inf)

    def _scaled_step(self, jacobian: Array, scaled_residual: Array) -> Array:
        return -self.newton_step(scaled_residual / self.scale, jacobian)[0]

    def displaced(self, qpos: Array, step: Array) -> Array:
        """Return states displaced by a step in the DOFs, (n, nq): mj_integratePos in batches."""
        model, out = self.model, qpos.copy()
        if len(out) == 1:
            mujoco.mj_integratePos(model, out[0], step[0], 1.0)
            return out
        for kind, address, dof in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
            if kind in (HINGE, SLIDE):
                out[:, address] += step[:, dof]
                continue
            if kind == FREE:
                out[:, address : address + 3] += step[:, dof : dof + 3]
                address, dof = address + 3, dof + 3
            quaternion = out[:, address : address + 4]
            out[:, address : address + 4] = rotated_quaternions(quaternion, step[:, dof : dof + 3])
        return out


@dataclass(frozen=True)
class _Linearised:
    """Loop equations about n states, for `numerics.newton`: scaled residuals, and Jacobians on demand."""

    rhs: Array
    derivative: Callable[[], Array]

    @property
    def matrix(self) -> Array:
        return self.derivative()


@dataclass(frozen=True)
class _Equations:
    """The loop equations of a model, with the crank locked, as a `numerics.newton.ConstraintSystem`."""

    loops: ModelLoops

    def linearise(self, q: Array, /) -> _Linearised:
        residual, derivative = self.loops.residual_and_derivative(q)
        return _Linearised(residual * self.loops.scale, derivative)

    def retract(self, q: Array, step: Array, /) -> Array:
        return self.loops.displaced(q, step)


class _IndependentRows:
    """The independent constraints of a model, as of the first Jacobian that is asked for.

    The third equation of a planar loop is redundant in every pose. In an overconstrained loop such as
    Bennett's, which equations are redundant changes from pose to pose.

    Attributes:
        basis: of the independent constraints (m, rank), of the redundant ones, and of the row space, which
            leaves out unconstrained DOFs, (rank, nv - 1); None before the first Jacobian.
        log_scale: natural logarithm of the scale of determinants; None before the first one.
    """

    def __init__(self, basis: tuple[Array, Array, Array] | None = None):
        self.basis = basis
        self.log_scale: float | None = None

    @property
    def row_space(self) -> Array:
        """A basis of the row space, (rank, nv - 1)."""
        assert self.basis is not None
        return self.basis[2]

    def basis_of(self, matrix: Array) -> Array | None:
        """Return the basis of independent constraints, (m, rank); None if it changes with the pose."""
        if self.basis is None:
            # a model may have thousands of unconstrained DOFs, of which no basis is needed
            u, values, vh = np.linalg.svd(matrix[0], full_matrices=matrix.shape[1] > matrix.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self.basis = u[:, :rank], u[:, rank:], vh[:rank]
        rows, redundant, _ = self.basis
        ignored = np.abs(redundant.T @ matrix).max(initial=0.0)
        return None if ignored > RANK_TOLERANCE * np.abs(matrix).max(initial=0.0) else rows

    def square(self, matrix: Array, rows: Array) -> Array:
        """Return the square Jacobian of independent constraints, (n, rank, rank)."""
        return (rows.T @ matrix) @ self.row_space.T


def read_loops(
    model: mujoco.MjModel, crank: str = "crank", drivers: Drivers | None = None, *, any_joint: bool = False
) -> ModelLoops:
    """Return the loops of a compiled model with a crank, or with drivers under motion laws.

    With `any_joint` the crank may be a slide too: a model that moves freely has no crank of its own.

    Raises:
        InputError: where the model has no hinge of the crank's name.
    """
    crank = crank if drivers is None else PARAMETER_JOINT
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, crank)
    kinds = (HINGE, SLIDE) if any_joint else (HINGE,)
    if joint < 0 or model.jnt_type[joint] not in kinds:
        names = [model.joint(i).name for i in range(model.njnt)]
        raise InputError(
            f"the model has no hinge joint called {crank!r} (it has {', '.join(names) or 'none'}); "
            f"name the driven hinge {crank!r}"
        )
    return loops_with_crank(model, int(model.jnt_dofadr[joint]), drivers)


def loops_with_crank(model: mujoco.MjModel, dof: int, drivers: Drivers | None = None) -> ModelLoops:
    """Return the loops of a compiled model whose crank is a degree of freedom."""
    pairs, frames, couplings = constraints(model)
    return ModelLoops(model, dof, drivers, pairs, frames, couplings, PosedBodies(model), _IndependentRows())


def _extent(model: mujoco.MjModel) -> float:
    """Return the largest distance of sites, joints and centres of mass from their bodies' origins, or 1 m."""
    positions = np.concatenate([model.site_pos, model.jnt_pos, model.body_ipos])
    return float(np.linalg.norm(positions, axis=1).max(initial=0.0)) or 1.0
