"""The equations of the loops of a compiled model: residuals and Jacobians of many states at once.

MuJoCo computes the kinematics and the Jacobians; the equations are the model's own equality constraints.
No closed form is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.mechanism.motion import ChangePointPolicy
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE
from mechsim.simulation.drivers import PARAMETER_JOINT, Drivers
from mechsim.simulation.equality_rows import CouplingConstraint, FramePair, PointPair, RodPair, constraints
from mechsim.simulation.state import HINGE, PosedBodies, angular_dofs, displaced, rotated


class IndependentRows:
    """The independent constraints of a model, determined from the first Jacobian.

    The third equation of a planar loop is redundant in every pose. In an overconstrained loop such as
    Bennett's, the set of redundant equations changes from pose to pose.

    Attributes:
        basis: bases of the independent constraints, (m, rank), and of the redundant constraints; None before
            the first Jacobian.
    """

    def __init__(self) -> None:
        self.basis: tuple[Array, Array] | None = None

    def basis_of(self, matrix: Array) -> Array | None:
        """Return the basis of independent constraints, (m, rank); None if it changes with the pose."""
        if self.basis is None:
            # a model may have thousands of unconstrained DOFs, which need no basis
            u, values, _ = np.linalg.svd(matrix[0], full_matrices=matrix.shape[1] > matrix.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self.basis = u[:, :rank], u[:, rank:]
        rows, redundant = self.basis
        ignored = np.abs(redundant.T @ matrix).max(initial=0.0)
        return None if ignored > RANK_TOLERANCE * np.abs(matrix).max(initial=0.0) else rows


@dataclass(frozen=True, eq=False)
class ModelLoops:
    """The equality constraints of a model with a crank, evaluated in batches.

    With several drivers, or a driver that is no hinge, the crank is the joint of the path parameter, and the
    motion laws are among the equations. `dataclasses.replace` makes copies with other fields.

    Attributes:
        model: the compiled model.
        crank: index of the crank among the degrees of freedom.
        drivers: the drivers that follow motion laws; None for a single crank.
        pairs, rods, frames, couplings: coincident points, points with a constant distance, parallel frames
            and coupled coordinates.
        posed: the kinematics of the model.
        independent: the independent constraints, shared by all copies.
        change_point: policy of a path of poses at change points.
    """

    model: mujoco.MjModel
    crank: int
    drivers: Drivers | None
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
        driven = [] if self.drivers is None else np.where(self.drivers.slides, factor, 1.0)
        lengths = np.full(self.point_rows.stop, factor)
        return np.concatenate([lengths, np.ones(3 * len(self.frames)), coupled, driven])

    @property
    def units(self) -> Array:
        """Scales of the DOFs, (nv,): 1 for angles in [rad], the characteristic length for displacements."""
        return np.where(self.angular_dofs, 1.0, self.characteristic_length)

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
        return slice(first, first + (0 if self.drivers is None else len(self.drivers.dofs)))

    @property
    def driven_dofs(self) -> NDArray[np.int64]:
        """The crank or all drivers."""
        return np.array([self.crank]) if self.drivers is None else self.drivers.dofs.astype(np.int64)

    def driver_text(self, angle: float) -> str:
        """Return the crank angle or the driver values as text."""
        return f"crank angle {angle:.6g} rad" if self.drivers is None else self.drivers.text(angle)

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
            for pair in (*self.pairs, *self.rods)
        ]
        gaps = [a[1] - b[1] for a, b in ends]
        rods = list(zip(self.rods, gaps[len(self.pairs) :], strict=True))
        errors = [pair.rotation_error(*(rotation[:, body] for body in pair.bodies)) for pair in self.frames]
        coupled = [coupling.residual(qpos)[:, None] for coupling in self.couplings]
        drivers, law = self.drivers, None
        if drivers is not None:
            law = drivers.law(qpos[:, self.crank_address])
            coupled.append(qpos[:, drivers.addresses] - law[0].T)
        chunks = [
            np.zeros((n, 0)),
            *gaps[: len(self.pairs)],
            *(0.5 * ((rod.along(gap) * gap).sum(1, keepdims=True) - rod.length) for rod, gap in rods),
            *(apart for apart, _ in errors),
            *coupled,
        ]

        def jacobian() -> Array:
            chunks = [np.zeros((n, 0, nv))]
            fixed = np.zeros((n, 3, nv))
            for i, points in enumerate(ends, -len(self.pairs)):
                a, b = (point_jacobian(body, point)[0] if body else fixed for body, point in points)
                chunks.append(a - b if i < 0 else rods[i][0].along(rods[i][1])[:, None] @ (a - b))
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

    def displaced(self, qpos: Array, step: Array) -> Array:
        """Return states displaced by a step in the DOFs, (n, nq)."""
        return displaced(self.model, qpos, step)

    def closure_error(self, residual: Array) -> Array:
        """Return the largest loop-closure error of each state, in characteristic lengths or [rad], (n,)."""
        return np.abs(residual * self.scale).max(1, initial=0.0)


def read_loops(model: mujoco.MjModel, crank: str = "crank", drivers: Drivers | None = None) -> ModelLoops:
    """Return the loops of a compiled model with a crank, or with drivers under motion laws.

    Raises:
        InputError: if the model has no hinge with the crank's name.
    """
    crank = crank if drivers is None else PARAMETER_JOINT
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, crank)
    if joint < 0 or model.jnt_type[joint] != HINGE:
        names = [model.joint(i).name for i in range(model.njnt)]
        raise InputError(
            f"the model has no hinge joint called {crank!r} (it has {', '.join(names) or 'none'}); "
            f"name the driven hinge {crank!r}"
        )
    return loops_with_crank(model, int(model.jnt_dofadr[joint]), drivers)


def loops_with_crank(model: mujoco.MjModel, dof: int, drivers: Drivers | None = None) -> ModelLoops:
    """Return the loops of a compiled model whose crank is a degree of freedom."""
    closing = constraints(model)
    return ModelLoops(model, dof, drivers, *closing, PosedBodies(model), IndependentRows())
