"""The equality constraints that close a model's loops, read from the compiled model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array, polynomial
from mechsim.simulation.state import cross_matrices, rotation_matrix

if TYPE_CHECKING:
    from mechsim.mechanism.curves import CouplingFunction

SITE = int(mujoco.mjtObj.mjOBJ_SITE)
# 4 cos²(angle/2) below which two frames count as rotated by half a revolution
HALF_TURN = 1e-6
# step of the differences that give the third and fourth derivative of a function from its second, in [m] or
# [rad]: their errors are 1e-7 of the fifth and sixth derivative
DIFFERENCE = 1e-3


@dataclass(frozen=True, slots=True)
class PointPair:
    """Two body-fixed points that a `connect` or a `weld` makes coincident."""

    bodies: tuple[int, int]
    local: tuple[Array, Array]

    @property
    def ends(self) -> tuple[tuple[int, Array], tuple[int, Array]]:
        """The two pairs of body and point."""
        return (self.bodies[0], self.local[0]), (self.bodies[1], self.local[1])


@dataclass(frozen=True, slots=True)
class RodPair(PointPair):
    """Two body-fixed points whose distance a tendon equality keeps.

    Attributes:
        length: the distance, in [m].
        equality: index of the equality in the model.
    """

    length: float
    equality: int

    @property
    def nonlinear(self) -> bool:
        """Whether MuJoCo omits the velocity-product term, as of a polynomial."""
        return True

    def stretching(self, data: mujoco.MjData) -> float:
        """Return the second derivative of the length of the tendon at accelerations of zero, in [m/s2].

        It is u.b + (v.v - (u.v)^2) / length, with direction u, relative velocity v = J q', and b = J' q'.
        """
        model, point, velocity, bias = data.model, np.zeros(3), np.zeros(3), np.zeros(3)
        for (body, local), sign in zip(self.ends, (1.0, -1.0), strict=True):
            end = data.xpos[body] + data.xmat[body].reshape(3, 3) @ local
            rows = np.zeros((2, 3, model.nv))
            mujoco.mj_jac(model, data, rows[0], None, end, body)
            mujoco.mj_jacDot(model, data, rows[1], None, end, body)
            point += sign * end
            velocity += sign * (rows[0] @ data.qvel)
            bias += sign * (rows[1] @ data.qvel)
        length = float(np.linalg.norm(point))
        along = point / length
        return float(along @ bias + (velocity @ velocity - (along @ velocity) ** 2) / length)

    def along(self, gap: Array) -> Array:
        """Return the direction from the second point to the first, from their gap, (n, 3) in [m]."""
        return gap / self.length


@dataclass(frozen=True, slots=True)
class FramePair:
    """Two frames, each fixed in a body, that a `weld` keeps parallel.

    Attributes:
        bodies: the two bodies.
        local: rotation matrices of the frames in their bodies, (3, 3) each.
    """

    bodies: tuple[int, int]
    local: tuple[Array, Array]

    def rotation_error(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Return the rotation of the first frame relative to the second, for rotations of both bodies.

        Args:
            first: rotations of the first body, (n, 3, 3).
            second: rotations of the second body, (n, 3, 3).

        Returns:
            Twice the vector part of the quaternion in the second frame, (n, 3), in [rad] if small; and
            its derivative with respect to the rotation of the first body relative to the second, (n, 3, 3).
        """
        frame = second @ self.local[1]
        relative = np.swapaxes(frame, 1, 2) @ first @ self.local[0]
        half = np.sqrt(np.maximum(1.0 + np.trace(relative, axis1=1, axis2=2), HALF_TURN)) / 2.0
        difference = relative[:, [2, 0, 1], [1, 2, 0]] - relative[:, [1, 2, 0], [2, 0, 1]]
        vector = difference / (2.0 * half[:, None])
        rate = half[:, None, None] * np.eye(3) - cross_matrices(vector) / 2.0
        return vector, rate @ np.swapaxes(frame, 1, 2)


@dataclass(frozen=True, slots=True)
class Sum:
    """A weighted sum of coordinates, each relative to the model's reference configuration; (k,) each."""

    addresses: NDArray[np.intp]
    dofs: NDArray[np.intp]
    zeros: Array
    weights: Array

    def value(self, qpos: Array) -> Array:
        """Return the sum at states (n, nq), (n,)."""
        return (qpos[:, self.addresses] - self.zeros) @ self.weights


@dataclass(frozen=True, slots=True)
class RelativeFunction:
    """A function of a coupling in sums relative to the reference: y = function(offset + x) + difference."""

    function: "CouplingFunction"
    offset: float
    difference: float

    def __call__(self, right: Array) -> tuple[Array, Array, Array]:
        """Return y and its first two derivatives by x, (n,)."""
        value, rate, second = self.function(self.offset + right)
        return value + self.difference, rate, second


@dataclass(frozen=True, slots=True)
class CouplingConstraint:
    """A sum of coordinates that is a polynomial in another sum: a `joint` or fixed-tendon constraint.

    Attributes:
        left: the dependent sum.
        right: the independent sum; None if the left sum is constant.
        coefficients: coefficients of the polynomial, from the constant up.
        equality: index of the equality in the model.
        function: takes the place of the polynomial, whose coefficients are its expansion about one state.
    """

    left: Sum
    right: Sum | None
    coefficients: Array
    equality: int
    function: RelativeFunction | None = None

    @property
    def dofs(self) -> NDArray[np.intp]:
        """The degrees of freedom of both sides, (k,)."""
        return self.left.dofs if self.right is None else np.append(self.left.dofs, self.right.dofs)

    def values(self, right: Array) -> tuple[Array, Array, Array]:
        """Return the polynomial and its first two derivatives at values of the right side."""
        return self.function(right) if self.function else polynomial(self.coefficients, right)

    def expanded(self, right: float) -> list[float]:
        """Return the coefficients of the Taylor polynomial about a value of the right side."""
        values, rates, (before, second, after) = self.values(right + DIFFERENCE * np.arange(-1.0, 2.0))
        third, fourth = (after - before) / (2.0 * DIFFERENCE), (after - 2.0 * second + before) / DIFFERENCE**2
        coefficients = [0.0] * 5
        for entry in (fourth / 24.0, third / 6.0, second / 2.0, rates[1], values[1]):
            below = [entry, *coefficients[:-1]]
            coefficients = [lower - right * same for lower, same in zip(below, coefficients, strict=True)]
        return coefficients

    @property
    def nonlinear(self) -> bool:
        """Whether the polynomial has terms of second or higher degree."""
        return self.function is not None or (self.right is not None and bool(np.any(self.coefficients[2:])))

    def target(self, qpos: Array) -> Array:
        """Return the value that the constraint prescribes for the left side at states (n, nq), (n,)."""
        if self.right is None:
            return np.full(len(qpos), self.coefficients[0])
        return self.values(self.right.value(qpos))[0]

    def residual(self, qpos: Array) -> Array:
        """Return the constraint residual at states (n, nq), (n,) in [m] or [rad]."""
        return self.left.value(qpos) - self.target(qpos)

    def jacobian(self, qpos: Array, nv: int) -> Array:
        """Return the derivative of the residual with respect to all DOFs, (n, nv)."""
        derivative = np.zeros((len(qpos), nv))
        derivative[:, self.left.dofs] = self.left.weights
        if self.right is not None:
            rate = self.values(self.right.value(qpos))[1]
            derivative[:, self.right.dofs] -= rate[:, None] * self.right.weights
        return derivative

    def velocity_product(self, qpos: Array, qvel: Array) -> Array:
        """Return the velocity-product term of the left side's acceleration at rates (n, nv), (n,)."""
        if self.right is None:
            return np.zeros(len(qpos))
        rate = qvel[:, self.right.dofs] @ self.right.weights
        return self.values(self.right.value(qpos))[2] * rate**2


def constraints(
    model: mujoco.MjModel,
) -> tuple[list[PointPair], list[RodPair], list[FramePair], list[CouplingConstraint]]:
    """Return the coincident points, the rods, the parallel frames and the coupled coordinates of a model.

    Raises:
        InputError: if an equality has another kind, such as that of a flex or a tendon around bodies.
    """
    pairs: list[PointPair] = []
    rods: list[RodPair] = []
    frames: list[FramePair] = []
    couplings: list[CouplingConstraint] = []
    for i in range(model.neq):
        if not model.eq_active0[i]:
            continue
        first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        kind = mujoco.mjtEq(model.eq_type[i])
        if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            bodies, points, rotations = coincident_frames(model, i)
            pairs.append(PointPair(bodies, points))
            if kind == mujoco.mjtEq.mjEQ_WELD:
                frames.append(FramePair(bodies, rotations))
        elif rod := rod_of(model, i):
            rods.append(rod)
        elif kind in (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON):
            left, right = _sum_of(model, kind, first), _sum_of(model, kind, second) if second >= 0 else None
            couplings.append(CouplingConstraint(left, right, model.eq_data[i, :5].copy(), i))
        else:
            raise InputError(
                f"equality {model.equality(i).name or i!r} has a kind that cannot close a loop; "
                "close loops by connect or weld constraints, couple by joint or tendon constraints"
            )
    return pairs, rods, frames, couplings


def rod_of(model: mujoco.MjModel, i: int) -> RodPair | None:
    """Return the rod of an equality that keeps the length above 0 of a tendon between sites of two bodies."""
    if model.eq_type[i] != int(mujoco.mjtEq.mjEQ_TENDON) or model.eq_obj2id[i] >= 0:
        return None
    tendon = int(model.eq_obj1id[i])
    line, length = line_of(model, tendon), float(model.tendon_length0[tendon] + model.eq_data[i, 0])
    return RodPair(*line, length, i) if line and length > 0.0 and line[0][0] != line[0][1] else None


def line_of(model: mujoco.MjModel, tendon: int) -> tuple[tuple[int, int], tuple[Array, Array]] | None:
    """Return the bodies and points of a tendon that is a line between two sites; None for another."""
    wraps = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if model.wrap_type[wraps].tolist() != [int(mujoco.mjtWrap.mjWRAP_SITE)] * 2:
        return None
    first, second = model.wrap_objid[wraps].tolist()
    bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
    return bodies, (model.site_pos[first].copy(), model.site_pos[second].copy())


def coincident_frames(
    model: mujoco.MjModel, i: int
) -> tuple[tuple[int, int], tuple[Array, Array], tuple[Array, Array]]:
    """Return the bodies of a `connect` or `weld`, and their coincident frames as points and rotations."""
    first, second, data = int(model.eq_obj1id[i]), int(model.eq_obj2id[i]), model.eq_data[i]
    if model.eq_objtype[i] == SITE:
        bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        rotations = rotation_matrix(model.site_quat[first]), rotation_matrix(model.site_quat[second])
        return bodies, (model.site_pos[first].copy(), model.site_pos[second].copy()), rotations
    bodies = first, max(second, 0)
    if model.eq_type[i] == int(mujoco.mjtEq.mjEQ_CONNECT):
        return bodies, (data[0:3].copy(), data[3:6].copy()), (np.eye(3), np.eye(3))
    # data of a weld: the point in the second body, then its pose in the first body
    return bodies, (data[3:6].copy(), data[0:3].copy()), (rotation_matrix(data[6:10]), np.eye(3))


def _sum_of(model: mujoco.MjModel, kind: mujoco.mjtEq, number: int) -> Sum:
    """Return the coordinate of a joint, or the sum of a fixed tendon."""
    joints, weights = np.array([number]), np.ones(1)
    if kind == mujoco.mjtEq.mjEQ_TENDON:
        joints, weights = tendon_joints(model, number)
    address, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    return Sum(address.astype(np.intp), dof.astype(np.intp), model.qpos0[address], weights)


def tendon_joints(model: mujoco.MjModel, tendon: int) -> tuple[NDArray[np.int32], Array]:
    """Return the joints of a fixed tendon and their weights in its length, (k,) each.

    Raises:
        InputError: if the tendon runs through sites.
    """
    rows = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if (model.wrap_type[rows] != int(mujoco.mjtWrap.mjWRAP_JOINT)).any():
        raise InputError(
            f"tendon {model.tendon(tendon).name or tendon!r} runs through sites, so an equality of its "
            "length cannot close a loop; make it a fixed tendon, a sum of joints, or the equality inactive"
        )
    return model.wrap_objid[rows], model.wrap_prm[rows].astype(np.float64)


def chained(couplings: Sequence[CouplingConstraint], driven: Sequence[int]) -> list[CouplingConstraint]:
    """Return the couplings whose dependent coordinate follows from driven DOFs, in order of evaluation."""
    known_dofs, chain, waiting = {*driven}, list[CouplingConstraint](), list(couplings)
    while True:
        row = next((row for row in waiting if _follows(row, known_dofs)), None)
        if row is None:
            return chain
        waiting = [other for other in waiting if other is not row]  # comparison of arrays is elementwise
        chain.append(row)
        known_dofs.add(int(row.left.dofs[0]))


def _follows(coupling: CouplingConstraint, known_dofs: set[int]) -> bool:
    if coupling.right is None or len(coupling.left.dofs) != 1 or int(coupling.left.dofs[0]) in known_dofs:
        return False
    return {int(dof) for dof in coupling.right.dofs} <= known_dofs


def rates(
    chain: Sequence[CouplingConstraint], values: dict[int, Array], speeds: dict[int, Array]
) -> dict[int, Array]:
    """Return the rates of all coordinates of a chain, DOF -> (n,).

    Args:
        chain: couplings from `chained`.
        values: driven coordinates: address in qpos -> (n,) in [m] or [rad].
        speeds: rates of driven coordinates: DOF -> (n,) in [m/s] or [rad/s].
    """
    values, speeds = dict(values), dict(speeds)
    for row in chain:
        assert row.right is not None
        weight, address, dof = float(row.left.weights[0]), int(row.left.addresses[0]), int(row.left.dofs[0])
        target, derivative, _ = row.values(_sum(row.right, values))
        values[address] = row.left.zeros[0] + target / weight
        right = sum(w * speeds[int(k)] for k, w in zip(row.right.dofs, row.right.weights, strict=True))
        speeds[dof] = np.asarray(derivative * right / weight)
    return speeds


def _sum(side: Sum, values: dict[int, Array]) -> Array:
    terms = zip(side.addresses, side.zeros, side.weights, strict=True)
    return np.sum([weight * (values[int(address)] - zero) for address, zero, weight in terms], axis=0)
