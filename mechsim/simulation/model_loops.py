"""The loops of a compiled model: residuals and Jacobians of many states at once, and Newton's method.

MuJoCo computes the kinematics and the Jacobians; the equations are the model's own equality constraints.
No closed form is used.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import ChangePointPolicy
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, significant
from mechsim.simulation import equality_rows
from mechsim.simulation.drivers import PARAMETER_JOINT, Drivers, Law
from mechsim.simulation.equality_rows import CouplingConstraint, constraints
from mechsim.simulation.state import PosedBodies, rotated

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


class ModelLoops:
    """The equality constraints of a model with a crank, evaluated and solved in batches.

    With several drivers, or one that is no hinge, the crank is the joint of the path parameter, and the
    motion laws are among the equations.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        crank_address: its index in qpos.
        drivers: the drivers that follow motion laws; None where only a crank is driven.
        free: indices of all degrees of freedom but the crank.
        passive: indices of those that are neither crank nor driver.
        change_point: policy of a path of poses at change points.
        characteristic_lengths: of the model, in [m], (n,); (1,) where states share its fields.
        hinges: whether each entry of qpos is the angle of a hinge.
        quaternions: addresses of the quaternions in qpos.
        in_quaternion: whether each entry of qpos belongs to a quaternion.
        posed: the kinematics of the model, and the fields that differ between states.
    """

    def __init__(self, model: mujoco.MjModel, crank: str = "crank", drivers: Drivers | None = None):
        self.model = model
        self.posed = PosedBodies(model)
        crank = crank if drivers is None else PARAMETER_JOINT
        joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, crank)
        if joint < 0 or model.jnt_type[joint] != HINGE:
            names = [model.joint(i).name for i in range(model.njnt)]
            raise InputError(
                f"the model has no hinge joint called {crank!r} (it has {', '.join(names) or 'none'}); "
                f"name the driven hinge {crank!r}"
            )
        self.crank = int(model.jnt_dofadr[joint])
        self.crank_address = int(model.jnt_qposadr[joint])
        self.drivers = drivers
        self.change_point: ChangePointPolicy = "smooth"
        rows = constraints(model)
        self.pairs, self.frames, self.couplings = rows.pairs, rows.frames, rows.couplings
        self.name = model.names.partition(b"\0")[0].decode() or "model"
        self.free = np.array([i for i in range(model.nv) if i != self.crank], dtype=np.int64)
        self.passive = np.array([i for i in self.free if i not in self._driven], dtype=np.int64)
        self._angles = _angle_dofs(model)
        self.angular = self._angles[self.free]
        reach = [np.linalg.norm(local) for pair in self.pairs for local in pair.local]
        steps = np.linalg.norm(model.body_pos[1:], axis=1)
        self.characteristic_lengths = np.array([max([*reach, *steps], default=0.0) or _extent(model)])
        self.scale = self._scale()
        self.quaternions = [
            int(address) + (3 if kind == FREE else 0)
            for kind, address in zip(model.jnt_type, model.jnt_qposadr, strict=True)
            if kind in (BALL, FREE)
        ]
        self.in_quaternion = np.zeros(model.nq, dtype=np.bool_)
        for address in self.quaternions:
            self.in_quaternion[address : address + 4] = True
        self.hinges = np.zeros(model.nq, dtype=np.bool_)
        self.hinges[model.jnt_qposadr[model.jnt_type == HINGE]] = True
        self._basis: tuple[Array, Array, Array] | None = None
        self._log_scale: float | None = None

    def _scale(self) -> Array:
        """Return the factors that make residuals dimensionless, (m,); (n, m) where states have fields."""
        if self.posed.fields:
            return np.repeat(1.0 / self.characteristic_lengths[:, None], 3 * len(self.pairs), 1)
        coupled = [
            1.0 if self._angles[one.left.dofs].all() else 1.0 / self.characteristic_length
            for one in self.couplings
        ]
        driven = (
            []
            if self.drivers is None
            else np.where(self.drivers.slides, 1.0 / self.characteristic_length, 1.0)
        )
        lengths = np.full(3 * len(self.pairs), 1.0 / self.characteristic_length)
        return np.concatenate([lengths, np.ones(3 * len(self.frames)), coupled, driven])

    @property
    def characteristic_length(self) -> float:
        """Characteristic length of the model, in [m], where all states share its fields."""
        (size,) = self.characteristic_lengths.tolist()
        return size

    @property
    def units(self) -> Array:
        """Scales of the DOFs, (nv,): 1 for angles in [rad], the characteristic length for displacements."""
        return np.where(self._angles, 1.0, self.characteristic_length)

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
        return [one for one in self._chain if one.nonlinear]

    @property
    def driven_dofs(self) -> NDArray[np.int64]:
        """The crank or all drivers."""
        return np.array(self._driven, dtype=np.int64)

    @cached_property
    def actuated_dofs(self) -> NDArray[np.int64]:
        """The DOFs that forces move in a stepped run: the crank or all drivers, then nonlinear followers."""
        nonlinear = [int(one.left.dofs[0]) for one in self.followers]
        return np.array([*self._driven, *nonlinear], dtype=np.int64)

    def actuated_rates(self, angle: Array, speed: Array) -> Array:
        """Return the rates of `actuated_dofs`, (n, k), at angles and speeds of the crank, (n,)."""
        values, speeds = {self.crank_address: angle}, {self.crank: speed}
        if self.drivers is not None:
            value, jacobian, _ = self.drivers.law(angle)
            values |= dict(zip(self.drivers.addresses.tolist(), value, strict=True))
            speeds |= dict(zip(self.drivers.dofs.tolist(), jacobian * speed, strict=True))
        rates = equality_rows.rates(self._chain, values, speeds)
        return np.stack([rates[int(dof)] for dof in self.actuated_dofs], 1)

    @property
    def _driven(self) -> list[int]:
        return [self.crank] if self.drivers is None else self.drivers.dofs.tolist()

    @cached_property
    def _chain(self) -> list[CouplingConstraint]:
        return equality_rows.chained(self.couplings, self._driven)

    def with_law(self, law: Law, text: Callable[[float], str]) -> "ModelLoops":
        """Return the same loops with another motion law."""
        assert self.drivers is not None
        other = copy.copy(self)
        other.drivers = self.drivers.with_law(law, text)
        return other

    def with_drivers_locked(self, values: Array) -> "ModelLoops":
        """Return the same loops with the drivers locked at values, (k,) or (k, n) for n states."""
        assert self.drivers is not None
        other = copy.copy(self)
        other.drivers = self.drivers.locked_at(values)
        return other

    def driver_text(self, angle: float) -> str:
        """Return the crank angle or the driver values as text."""
        return f"crank angle {angle:.6g} rad" if self.drivers is None else self.drivers.text(angle)

    def with_fields(self, fields: Mapping[str, Array]) -> "ModelLoops":
        """Return the loops of n states with different model fields, name -> (n, ...).

        Its methods then take n states. All loops must be closed by site points; the independent constraint
        rows are those of the model itself.
        """
        other = copy.copy(self)
        other.posed, other._log_scale = PosedBodies(self.model, fields), None
        sites = fields["site_pos"]
        closing = zip(self.pairs, self.model.eq_obj1id, self.model.eq_obj2id, strict=True)
        other.pairs = [replace(pair, local=(sites[:, a], sites[:, b])) for pair, a, b in closing]
        reach = [np.linalg.norm(local, axis=1) for pair in other.pairs for local in pair.local]
        steps = np.linalg.norm(fields["body_pos"][:, 1:], axis=2).T
        other.characteristic_lengths = np.max([*reach, *steps], axis=0)
        other.scale = other._scale()
        return other

    def with_model_copy(self) -> "ModelLoops":
        """Return the same loops with a copy of the model that may be set up for stepping."""
        other = copy.copy(self)
        other.model = copy.copy(self.model)
        return other

    def residual(self, qpos: Array) -> Array:
        """Return the constraint residuals, (n, m) in [m] or [rad]."""
        return self._evaluate(qpos)[0]

    def linearise(self, qpos: Array) -> tuple[Array, Array]:
        """Return the constraint residuals, (n, m) in [m] or [rad], and their Jacobian, (n, m, nv)."""
        residual, jacobian = self._evaluate(qpos)
        return residual, jacobian()

    def _evaluate(self, qpos: Array) -> tuple[Array, Callable[[], Array]]:
        """Return the residuals and a function for their Jacobian, valid until the next evaluation."""
        position, rotation, slope = self.posed.poses(qpos)
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
            none = np.zeros((n, 3, nv))
            for (a, at_a), (b, at_b) in ends:
                chunks.append((slope(a, at_a)[0] if a else 0.0) - (slope(b, at_b)[0] if b else none))
            for pair, (_, rate) in zip(self.frames, errors, strict=True):
                a, b = (slope(body, position[:, body])[1] if body else none for body in pair.bodies)
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

    def solve(self, jacobian: Array, right: Array) -> Array:
        """Return the minimum-norm x (n, nv - 1, k) of J x = right (n, m, k) in all DOFs but the crank."""
        matrix = self.constrained_jacobian(jacobian)
        rows = self._independent(matrix)
        if rows is None:
            return np.linalg.pinv(matrix, rcond=RANK_TOLERANCE) @ right
        if rows.shape[1] < rows.shape[0]:
            matrix, right = rows.T @ matrix, rows.T @ right
        if matrix.shape[1] == matrix.shape[2]:
            return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        transposed = np.swapaxes(matrix, -1, -2)
        return transposed @ np.linalg.solve(matrix @ transposed, right)

    def _independent(self, matrix: Array) -> Array | None:
        """Return a basis, (m, rank), of the independent constraints; None if it changes with the pose.

        The third equation of a planar loop is redundant in every pose. In an overconstrained loop such as
        Bennett's, which equations are redundant changes from pose to pose.
        """
        if self._basis is None:
            # a model may have thousands of unconstrained DOFs, of which no basis is needed
            left, values, right = np.linalg.svd(matrix[0], full_matrices=matrix.shape[1] > matrix.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self._basis = left[:, :rank], left[:, rank:], right[:rank]
        rows, idle, _ = self._basis
        ignored = np.abs(idle.T @ matrix).max(initial=0.0)
        if ignored > RANK_TOLERANCE * np.abs(matrix).max(initial=0.0):
            return None
        return rows

    @property
    def has_undetermined_dofs(self) -> bool:
        """Whether the loops leave DOFs other than the crank undetermined, as of the last solution."""
        return self._basis is not None and len(self._basis[2]) < len(self.free)

    def determinant_sign(self, jacobian: Array) -> Array:
        """Return the sign of the Jacobian's determinant with the crank locked, (n,): +1 or -1; 0 if unknown.

        Two assemblies that coincide at a dead centre have opposite signs; between dead centres the sign is
        constant.
        """
        matrix = self.constrained_jacobian(jacobian)
        rows = self._independent(matrix)
        return (
            np.zeros(len(matrix))
            if rows is None
            else np.linalg.slogdet(self._square_jacobian(matrix, rows))[0]
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
        matrix = self.constrained_jacobian(jacobian)
        rows = self._independent(matrix)
        sign = 1.0
        if rows is None:
            assert self._basis is not None
            rows = np.linalg.svd(matrix[0], full_matrices=False)[0][:, : len(self._basis[2])]
            sign = np.linalg.slogdet(self._square_jacobian(matrix[:1], rows))[0]
        signs, log_values = np.linalg.slogdet(self._square_jacobian(matrix, rows))
        if self._log_scale is None:
            self._log_scale = float(log_values[0]) if np.isfinite(log_values[0]) else 0.0
        return sign * signs * np.exp(np.minimum(log_values - self._log_scale, 300.0))

    def least_constrained_direction(self, jacobian: Array) -> Array:
        """Return the direction that the loops of one state, (1, m, nv), constrain least, (nv,).

        The crank is locked; unconstrained DOFs do not contribute.
        """
        matrix = self.constrained_jacobian(jacobian)
        self._independent(matrix)
        assert self._basis is not None
        row_space = self._basis[2]
        return self._with_crank_rate(
            np.linalg.svd(matrix @ row_space.T)[2][:, len(row_space) - 1] @ row_space, 0.0
        )[0]

    def _square_jacobian(self, matrix: Array, rows: Array) -> Array:
        # unconstrained DOFs (a passive spin) are left out: they would not change the determinant
        assert self._basis is not None
        return (rows.T @ matrix) @ self._basis[2].T

    def conditioning(self, jacobian: Array) -> Array:
        """Return the distance of states from singular ones with the crank locked, (n,), 0 to about 1.

        It is the smallest singular value of the scaled Jacobian, without those that are zero at every state
        because of redundant constraints or unconstrained DOFs.
        """
        lengths = self.characteristic_lengths[:, None, None]
        matrix = jacobian[:, :, self.passive] * np.where(self._angles[self.passive], 1.0, lengths)
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
        longest = np.abs(step).max(1, initial=0.0, where=self.angular)
        step *= (0.5 / np.maximum(0.5, longest))[:, None]
        return self._with_crank_rate(step, 0.0), self._with_crank_rate(both[..., 1], 1.0)

    def _with_crank_rate(self, matrix: Array, crank: float) -> Array:
        """Return rates of all DOFs from those of all but the crank."""
        rates = np.empty((len(matrix), self.model.nv))
        rates[:, self.crank], rates[:, self.free] = crank, matrix
        return rates

    def close(self, qpos: Array, *, most_steps: int = 50) -> Array:
        """Return n states with closed loops and unchanged crank angles, by Newton's method.

        Args:
            qpos: initial guesses, (n, nq).
            most_steps: Newton steps before giving up.

        Raises:
            AssemblyError: where a loop does not close.
        """
        return self.close_with_jacobian(qpos, most_steps)[0]

    def close_with_jacobian(self, qpos: Array, most_steps: int = 50) -> tuple[Array, Array | None]:
        """Return n states closed as by `close`, and the Jacobian of the last Newton step, (n, m, nv).

        The Jacobian is None where the given states were closed.
        """
        qpos, before, slope = qpos.copy(), np.inf, None
        gap = np.full(len(qpos), np.inf)
        for _ in range(most_steps):
            residual, jacobian = self._evaluate(qpos)
            gap = self.closure_error(residual)
            worst = gap.max(initial=0.0)
            # stop at rounding: below the tolerance, or no better than the step before
            if worst <= CLOSED or (worst < 1e-11 and worst >= 0.5 * before):
                return qpos, slope
            before, slope = worst, jacobian()
            try:
                step, _ = self.newton_step(residual, slope)
            except np.linalg.LinAlgError:
                break
            qpos = self.displaced(qpos, step)
            if not np.isfinite(qpos).all():
                break
        worst = int(np.argmax(gap))
        raise AssemblyError(
            f"{self.name}: the loops do not close at "
            f"{self.driver_text(float(qpos[worst, self.crank_address]))}: a gap of "
            f"{gap[worst]:.3g} of the longest link is left; change the dimensions, "
            f"{'the crank angle' if self.drivers is None else 'where the drivers are'} or the start"
        )

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
            turned = _rotated_quaternions(out[:, address : address + 4], step[:, dof : dof + 3])
            out[:, address : address + 4] = turned
        return out


def _extent(model: mujoco.MjModel) -> float:
    """Return the largest distance of sites, joints and centres of mass from their bodies' origins, or 1 m."""
    positions = np.concatenate([model.site_pos, model.jnt_pos, model.body_ipos])
    return float(np.linalg.norm(positions, axis=1).max(initial=0.0)) or 1.0


def _rotated_quaternions(quaternion: Array, vector: Array) -> Array:
    """Return unit quaternions rotated by rotation vectors in their own frames, (n, 4)."""
    angle = np.sqrt((vector * vector).sum(1))
    half = 0.5 * angle
    factor = np.where(angle > 1e-8, np.sin(half) / np.where(angle > 1e-8, angle, 1.0), 0.5)
    w, x, y, z = quaternion.T
    a, (b, c, d) = np.cos(half), (factor[:, None] * vector).T
    turned = np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        1,
    )
    return turned / np.sqrt((turned * turned).sum(1))[:, None]


def _angle_dofs(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each DOF is an angle; of the six of a free joint the first three are lengths."""
    kinds = model.jnt_type[model.dof_jntid]
    order = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    return (kinds != SLIDE) & ~((kinds == FREE) & (order < 3))
