"""The closure of an MJCF file by least squares in maximal coordinates, independent of mechsim.

The unknowns are position and quaternion of every body and every joint coordinate. The equations of joints and
equalities follow from the definitions in MuJoCo's manual, with the numbers of the compiled file. It uses
neither mechsim's reader and loop equations nor MuJoCo's constraints. The equations are polynomials except for
cos and sin, so that derivatives are complex steps, exact to rounding.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise

import mujoco
import numpy as np
from scipy.linalg import lstsq

FREE, BALL, SLIDE, HINGE = (
    int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "SLIDE", "HINGE")
)
CONNECT, WELD, JOINT, TENDON = (
    int(getattr(mujoco.mjtEq, f"mjEQ_{name}")) for name in ("CONNECT", "WELD", "JOINT", "TENDON")
)
SITE = int(mujoco.mjtObj.mjOBJ_SITE)
# complex step; relative singular values of undetermined motions; pose components that such a motion moves
COMPLEX_STEP, ZERO_SINGULAR_VALUE, MOTION_LIMIT = 1e-40, 1e-9, 1e-7
# steps between two instants; step at which Newton's method ends
STEPS_PER_INTERVAL, STEP_TOLERANCE = 2, 1e-13


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return products of quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(a, -1, 0)
    s, i, j, k = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            w * s - x * i - y * j - z * k,
            w * i + x * s + y * k - z * j,
            w * j - x * k + y * s + z * i,
            w * k + x * j - y * i + z * s,
        ],
        -1,
    )


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) rotated by unit quaternions (..., 4)."""
    u = q[..., 1:]
    twice_cross = 2.0 * np.cross(u, v)
    return v + q[..., :1] * twice_cross + np.cross(u, twice_cross)


class Closure:
    """The equations of a compiled model; unknowns are (nbody - 1) positions and quaternions, then qpos."""

    def __init__(
        self, model: mujoco.MjModel, length: float, prescribed: Mapping[str, Callable[[float], float]]
    ):
        """Store the model, its size in [m], and the values over time of driven and locked joints."""
        self.model, self.length = model, length
        self.first_qpos = 7 * (model.nbody - 1)
        self.prescribed = {
            int(model.jnt_qposadr[model.joint(name).id]): value for name, value in prescribed.items()
        }

    def body(self, x: np.ndarray, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Return position and quaternion of a body."""
        if b <= 0:
            return np.zeros((*x.shape[:-1], 3)), np.broadcast_to([1.0, 0, 0, 0], (*x.shape[:-1], 4))
        values = x[..., 7 * (b - 1) : 7 * b]
        return values[..., :3], values[..., 3:]

    def tree_pose(self, x: np.ndarray, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the pose of a body that follows from its joints and its parent."""
        m, q = self.model, x[..., self.first_qpos :]
        position, rotation = self.body(x, int(m.body_parentid[b]))
        position, rotation = position + rotated(rotation, m.body_pos[b]), multiply(rotation, m.body_quat[b])
        for j in range(int(m.body_jntadr[b]), int(m.body_jntadr[b]) + int(m.body_jntnum[b])):
            address, kind = int(m.jnt_qposadr[j]), int(m.jnt_type[j])
            if kind == FREE:
                return q[..., address : address + 3], q[..., address + 3 : address + 7]
            change = (q[..., address] - m.qpos0[address])[..., None]
            if kind == SLIDE:
                position = position + rotated(rotation, change * m.jnt_axis[j])
                continue
            anchor = position + rotated(rotation, m.jnt_pos[j])
            joint_rotation = np.concatenate([np.cos(change / 2), np.sin(change / 2) * m.jnt_axis[j]], -1)
            rotation = multiply(rotation, q[..., address : address + 4] if kind == BALL else joint_rotation)
            position = anchor - rotated(rotation, m.jnt_pos[j])
        return position, rotation

    def residual(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return all equations, lengths relative to the size, (..., equations)."""
        m, q, rows = self.model, x[..., self.first_qpos :], []
        for b in range(1, m.nbody):
            for (body_value, tree_value), scale in zip(
                zip(self.body(x, b), self.tree_pose(x, b), strict=True), (self.length, 1.0), strict=True
            ):
                rows.append((body_value - tree_value) / scale)
        for j in range(m.njnt):
            if int(m.jnt_type[j]) in (FREE, BALL):
                address = int(m.jnt_qposadr[j]) + (3 if int(m.jnt_type[j]) == FREE else 0)
                rows.append(((q[..., address : address + 4] ** 2).sum(-1) - 1.0)[..., None])
        rows += [self.equality(x, i) for i in range(m.neq) if m.eq_active0[i]]
        rows += [(q[..., address] - value(t))[..., None] for address, value in self.prescribed.items()]
        return np.concatenate(rows, -1)

    def equality(self, x: np.ndarray, i: int) -> np.ndarray:
        """Return the residual of an equality constraint."""
        m, data, kind = self.model, self.model.eq_data[i], int(self.model.eq_type[i])
        first, second = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if kind in (JOINT, TENDON):
            left, right = (self.coordinate_change(x, number, kind == TENDON) for number in (first, second))
            return (left - sum(data[k] * right**k for k in range(5)))[..., None]
        weld = kind == WELD
        if int(m.eq_objtype[i]) == SITE:
            bodies = int(m.site_bodyid[first]), int(m.site_bodyid[second])
            points, rotations = (
                (m.site_pos[first], m.site_pos[second]),
                (m.site_quat[first], m.site_quat[second]),
            )
        else:
            bodies, identity = (first, second), np.array([1.0, 0, 0, 0])
            points = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
            rotations = (data[6:10] if weld else identity), identity
        (position_a, rotation_a), (position_b, rotation_b) = (self.body(x, b) for b in bodies)
        gap = position_b + rotated(rotation_b, points[1]) - position_a - rotated(rotation_a, points[0])
        if not weld or data[10] == 0.0:
            return gap / self.length
        inverse = multiply(rotation_a, rotations[0]) * np.array([1.0, -1, -1, -1])
        return np.concatenate(
            [gap / self.length, multiply(inverse, multiply(rotation_b, rotations[1]))[..., 1:]], -1
        )

    def coordinate_change(self, x: np.ndarray, number: int, tendon: bool) -> np.ndarray:
        """Return the change of a joint coordinate or fixed tendon length from the reference."""
        m, q = self.model, x[..., self.first_qpos :]
        if number < 0:
            return np.zeros(x.shape[:-1])
        if not tendon:
            address = int(m.jnt_qposadr[number])
            return q[..., address] - m.qpos0[address]
        first = int(m.tendon_adr[number])
        wraps = range(first, first + int(m.tendon_num[number]))
        address = [int(m.jnt_qposadr[m.wrap_objid[wrap]]) for wrap in wraps]
        return ((q[..., address] - m.qpos0[address]) * m.wrap_prm[list(wraps)]).sum(-1)

    def jacobian(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the derivatives of all equations by all unknowns."""
        return self.residual(x + 1j * COMPLEX_STEP * np.eye(len(x)), t).imag.T / COMPLEX_STEP

    def initial(self, qpos: np.ndarray) -> np.ndarray:
        """Return the unknowns of the spanning tree at qpos."""
        x = np.concatenate([np.zeros(self.first_qpos), qpos])
        for b in range(1, self.model.nbody):
            x[7 * (b - 1) : 7 * b] = np.concatenate(self.tree_pose(x, b))
        return x

    def solve(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the least-squares pose near `x`."""
        for _ in range(20):
            step = lstsq(self.jacobian(x, t), self.residual(x, t), cond=ZERO_SINGULAR_VALUE)[0]
            x = x - step
            if np.abs(step).max() < STEP_TOLERANCE:
                break
        return x

    def solve_path(self, qpos: np.ndarray, instants: np.ndarray) -> np.ndarray:
        """Return the poses at given times, (times, unknowns), starting from qpos."""
        x = self.solve(self.initial(qpos), float(instants[0]))
        result = [x]
        for t, end in pairwise(instants):
            previous = x
            for time in np.linspace(t, end, STEPS_PER_INTERVAL + 1)[1:]:
                x, previous = self.solve(2.0 * x - previous if previous is not x else x, float(time)), x
            result.append(x)
        return np.array(result)

    def determined_bodies(self, x: np.ndarray, t: float) -> list[str]:
        """Return the names of the bodies that no undetermined motion moves."""
        _, values, right = np.linalg.svd(self.jacobian(x, t))
        null_space = right[int((values > ZERO_SINGULAR_VALUE * values[0]).sum()) :, : self.first_qpos]
        moved = np.abs(null_space).max(0, initial=0.0).reshape(-1, 7).max(-1)
        return [self.model.body(b + 1).name for b in np.flatnonzero(moved < MOTION_LIMIT)]


def worst_difference(
    model: mujoco.MjModel,
    length: float,
    qpos: np.ndarray,
    prescribed: Mapping[str, Callable[[float], float]],
    instants: np.ndarray,
    links: Mapping[str, tuple[np.ndarray, np.ndarray]],
) -> tuple[float, float, float]:
    """Return the largest differences between links and the separate closure.

    Args:
        model: compiled, every body named.
        length: characteristic length in [m].
        qpos: initial configuration.
        prescribed: driven or locked joint -> its value over time.
        instants: (n,) in [s].
        links: body -> positions (n, 3) and rotation matrices (n, 3, 3) to compare.

    Returns:
        The largest distance over all determined links, relative to the size; the largest rotation in [rad];
        and the largest residual of the reference.
    """
    closure = Closure(model, length, prescribed)
    poses = closure.solve_path(qpos, instants)
    bodies = [
        name
        for name in closure.determined_bodies(poses[len(poses) // 2], float(instants[len(poses) // 2]))
        if name in links
    ]
    distance = rotation = 0.0
    for name in bodies:
        position, quaternion = closure.body(poses, model.body(name).id)
        columns = np.stack(
            [rotated(quaternion, np.broadcast_to(axis, position.shape)) for axis in np.eye(3)], -1
        )
        distance = max(
            distance, float(np.linalg.norm(position - links[name][0], axis=-1).max()) / closure.length
        )
        rotation = max(rotation, float(np.abs(columns - links[name][1]).max()))
    residual = max(
        float(np.abs(closure.residual(x, float(t))).max()) for x, t in zip(poses, instants, strict=True)
    )
    return distance, rotation, residual
