"""States of a compiled model: coordinates, displacements, body poses and point Jacobians."""

import copy
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
BALL = int(mujoco.mjtJoint.mjJNT_BALL)
SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)

# joints with one coordinate
SCALAR = (HINGE, SLIDE)

# body and points on it, (n, 3) -> the Jacobians of the points and of the body's rotation, (n, 3, nv) each
PointJacobians = Callable[[int, Array], tuple[Array, Array]]

Integers = NDArray[np.intp]

# number of states up to which one thread is as fast as two: a few milliseconds of work
ONE_THREAD = 4096


class PosedBodies:
    """MuJoCo's kinematics of a model.

    Attributes:
        kinematic_model: a copy of the model reduced to its kinematics; do not change it.
    """

    def __init__(self, model: mujoco.MjModel):
        # a copy of a model that computes kinematics only, as far as MuJoCo allows
        self.kinematic_model, off = copy.copy(model), mujoco.mjtDisableBit
        unused = int(off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT | off.mjDSBL_SENSOR)
        self.kinematic_model.opt.disableflags |= unused
        self._batches: dict[int, batch.Batch] = {}

    def poses(self, qpos: Array) -> tuple[Array, Array, PointJacobians]:
        """Return positions and rotations of all bodies at n states, and Jacobians of points fixed in them.

        Args:
            qpos: states, (n, nq).

        Returns:
            Positions of the bodies' origins, (n, nbody, 3) in [m], their rotations, (n, nbody, 3, 3), and a
            function for Jacobians; all are valid until the next call.
        """
        # a batch is made once for each number of states
        if (n := len(qpos)) not in self._batches:
            if len(self._batches) > 8:
                self._batches.clear()
            self._batches[n] = batch.Batch(self.kinematic_model, n, 1 if n <= ONE_THREAD else 0)
        sims = self._batches[n]
        # what `rates` reads is computed with them
        position, matrix, *_ = map(sims.bind, ("xpos", "xmat", "cdof", "subtree_com"))
        sims.bind("qpos")[:] = qpos
        sims.forward(stage=int(mujoco.mjtStage.mjSTAGE_POS))
        return position, matrix.reshape(*matrix.shape[:2], 3, 3), sims.jac

    def moving_dofs(self, bodies: Integers) -> tuple[Integers, Integers]:
        """Return the DOFs that move bodies: the index of each body among these, and the DOF, (e,) each."""
        model = self.kinematic_model
        # a body without joints moves as its parent does
        last = np.full(model.nbody, -1)
        for body in range(1, model.nbody):
            count = model.body_dofnum[body]
            last[body] = model.body_dofadr[body] + count - 1 if count else last[model.body_parentid[body]]
        entries: list[tuple[int, int]] = []
        for i, dof in enumerate(last[bodies].tolist()):
            while dof >= 0:
                entries.append((i, dof))
                dof = int(model.dof_parentid[dof])
        index, dofs = np.array(entries, dtype=np.intp).reshape(-1, 2).T
        return index, dofs

    def rates(self, bodies: Integers, dofs: Integers, points: Array) -> tuple[Array, Array]:
        """Return velocities of points of bodies, and their angular velocities, at unit rates of DOFs.

        Args:
            bodies: (e,).
            dofs: one that moves each of them, (e,).
            points: positions at the states of the last call of `poses`, (n, e, 3) in [m].

        Returns:
            (n, e, 3) each.
        """
        sims, model = self._batches[len(points)], self.kinematic_model
        # motions of the DOFs about the centres of mass of their trees, angular before linear
        axes, centres = sims.bind("cdof")[:, dofs], sims.bind("subtree_com")
        angular, arms = axes[..., :3], points - centres[:, model.body_rootid[bodies]]
        ahead, behind = [1, 2, 0], [2, 0, 1]
        rotated_arms = angular[..., ahead] * arms[..., behind] - angular[..., behind] * arms[..., ahead]
        return axes[..., 3:] + rotated_arms, angular

    def body_poses(self, qpos: Array) -> tuple[Array, Array]:
        """Return positions and rotations of all bodies at n states, (n, nbody, 3) and (n, nbody, 3, 3)."""
        position, rotation, _ = self.poses(qpos)
        return position.copy(), rotation.copy()

    def site_positions(self, qpos: Array) -> Array:
        """Return the positions of all sites at n states, (n, nsite, 3) in [m]."""
        model = self.kinematic_model
        return self._positions(qpos, model.site_bodyid, model.site_pos)

    def centres(self, qpos: Array) -> Array:
        """Return the centres of mass of all bodies at n states, (n, nbody, 3) in [m]."""
        return self._positions(qpos, slice(None), self.kinematic_model.body_ipos)

    def _positions(self, qpos: Array, bodies: Any, local: Array) -> Array:
        position, rotation, _ = self.poses(qpos)
        return position[:, bodies] + (rotation[:, bodies] @ local[..., None])[..., 0]


def data_at(model: mujoco.MjModel, qpos: Array, qvel: Array | None = None) -> mujoco.MjData:
    """Return MuJoCo's data at a state, evaluated by `mj_forward`.

    Args:
        model: the model.
        qpos: coordinates, (nq,).
        qvel: velocities, (nv,); by default at rest.
    """
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, 0.0 if qvel is None else qvel
    mujoco.mj_forward(model, data)
    return data


def mass_matrix(data: mujoco.MjData) -> Array:
    """Return the mass matrix at the state of MuJoCo's data, (nv, nv)."""
    matrix = np.zeros((data.model.nv, data.model.nv))
    mujoco.mj_fullM(data.model, data, matrix)
    return matrix


def dense_rows(data: mujoco.MjData) -> Array:
    """Return the Jacobian of the constraints of a model that keeps it dense, (nefc, nv).

    MuJoCo's array is longer if constraints without effect were left out.
    """
    nv = data.model.nv
    return data.efc_J[: data.nefc * nv].reshape(data.nefc, nv)


def scalar_joints(model: mujoco.MjModel) -> dict[str, int]:
    """Return the hinges and slides of a model: name -> index."""
    return {model.joint(j).name: j for j in range(model.njnt) if model.jnt_type[j] in SCALAR}


def limited_joints(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Return the indices of the hinges and slides whose limits are active."""
    limited = (model.jnt_limited != 0) & np.isin(model.jnt_type, SCALAR)
    return np.flatnonzero(limited & (not is_disabled(model, mujoco.mjtDisableBit.mjDSBL_LIMIT)))


def is_disabled(model: mujoco.MjModel, flag: mujoco.mjtDisableBit) -> bool:
    """Return whether a model has a disable flag set."""
    return bool(model.opt.disableflags & int(flag))


def has_dry_friction(model: mujoco.MjModel) -> bool:
    """Return whether joints or tendons of a model have MuJoCo's Coulomb friction."""
    return bool((model.dof_frictionloss > 0.0).any() or (model.tendon_frictionloss > 0.0).any())


def gravity(model: mujoco.MjModel) -> Array:
    """Return the acceleration of gravity, zero if it is disabled, (3,) in [m/s2]."""
    if is_disabled(model, mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        return np.zeros(3)
    return np.array(model.opt.gravity)


def angular_dofs(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each DOF is an angle, (nv,); the first three DOFs of a free joint are lengths."""
    kinds = model.jnt_type[model.dof_jntid]
    order = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    return (kinds != SLIDE) & ~((kinds == FREE) & (order < 3))


def hinge_entries(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each entry of qpos is the angle of a hinge, (nq,)."""
    return np.isin(np.arange(model.nq), model.jnt_qposadr[model.jnt_type == HINGE])


def quaternion_addresses(model: mujoco.MjModel) -> list[int]:
    """Return the addresses of the quaternions in qpos."""
    kinds = model.jnt_type
    first = model.jnt_qposadr + np.where(kinds == FREE, 3, 0)
    return first[(kinds == FREE) | (kinds == BALL)].tolist()


def quaternion_entries(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return whether each entry of qpos belongs to a quaternion, (nq,)."""
    return np.isin(np.arange(model.nq), np.add.outer(quaternion_addresses(model), np.arange(4)))


def displaced(model: mujoco.MjModel, qpos: Array, step: Array) -> Array:
    """Return states displaced by a step in the DOFs, (n, nq): mj_integratePos in batches."""
    out = qpos.copy()
    if len(out) == 1:
        mujoco.mj_integratePos(model, out[0], step[0], 1.0)
        return out
    for kind, address, dof in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
        if kind in SCALAR:
            out[:, address] += step[:, dof]
            continue
        if kind == FREE:
            out[:, address : address + 3] += step[:, dof : dof + 3]
            address, dof = address + 3, dof + 3
        quaternion = out[:, address : address + 4]
        out[:, address : address + 4] = rotated_quaternions(quaternion, step[:, dof : dof + 3])
    return out


def matching_state(
    model: mujoco.MjModel, other: mujoco.MjModel, state: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return position (nq,) and velocity (nv,) of a model, copied from joints of the same names in another.

    Args:
        model: a model whose joints all exist in the other model.
        other: the other model.
        state: position and velocity of the other model.
    """
    qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
    for j in range(model.njnt):
        own, same = model.joint(j), other.joint(model.joint(j).name)
        coordinates, dofs = np.arange(len(own.qpos0)), np.arange(len(own.damping))
        qpos[own.qposadr + coordinates] = state[0][same.qposadr + coordinates]
        qvel[own.dofadr + dofs] = state[1][same.dofadr + dofs]
    return qpos, qvel


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (n, 3, 3) of the cross products with vectors (n, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, [2, 0, 1], [1, 2, 0]] = vectors
    return matrices - np.swapaxes(matrices, 1, 2)


def rotation_vector_rates(vector: Array) -> Array:
    """Return the matrices (n, 3, 3) that convert angular velocities to rates of rotation vectors (n, 3).

    Source: Solà, Deray & Atchuthan 2018, "A micro Lie theory", eq. (146), inverse left Jacobian of SO(3).
    """
    angle = np.linalg.norm(vector, axis=1)
    safe = np.where(angle > 1e-4, angle, 1.0)
    # the series 1/12 + angle^2/720 is exact to 1e-18 below 1e-4 rad
    factor = np.where(angle > 1e-4, 1 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe)), 1 / 12 + angle**2 / 720)
    cross = cross_matrices(vector)
    return np.eye(3) - 0.5 * cross + factor[:, None, None] * (cross @ cross)


def rotated_quaternions(quaternions: Array, vector: Array) -> Array:
    """Return unit quaternions (w, x, y, z) rotated by rotation vectors in their own frames, (n, 4)."""
    angle = np.sqrt((vector * vector).sum(1))
    # sin(angle / 2) / angle
    v = 0.5 * np.sinc(angle / (2.0 * np.pi))[:, None] * vector
    scalar, w, u = np.cos(0.5 * angle)[:, None], quaternions[:, :1], quaternions[:, 1:]
    product = np.hstack([w * scalar - (u * v).sum(1, keepdims=True), w * v + scalar * u + np.cross(u, v)])
    return product / np.sqrt((product * product).sum(1, keepdims=True))


def rotation_matrix(quaternion: Array) -> Array:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length, (3, 3)."""
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, quaternion / np.linalg.norm(quaternion))
    return out.reshape(3, 3)


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix, (4,)."""
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(rotation, dtype=np.float64).ravel())
    return out
