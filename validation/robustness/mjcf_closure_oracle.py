"""The closure of an MJCF file solved apart: least squares in maximal coordinates.

Unknown are the place and the quaternion of every body, and every coordinate of every joint. What joints and
equalities hold is written down from the definitions in MuJoCo's manual, out of the compiled numbers of the
file; nothing of mechsim's reader, of its loop equations or of MuJoCo's own constraints is used. All equations
are polynomials but for cos and sin, so that derivatives are complex steps, exact to rounding. The path is
followed from where the file starts, in steps between the requested instants.
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
# complex step; singular values of motions that nothing holds; parts of a body's pose that such a motion moves
STEP, OPEN, MOVED = 1e-40, 1e-9, 1e-7
# steps between two instants; the last step of a solution, in sizes and quaternions
BETWEEN, ENOUGH = 2, 1e-13


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
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


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) turned by quaternions (..., 4) of unit length."""
    u = q[..., 1:]
    across = 2.0 * np.cross(u, v)
    return v + q[..., :1] * across + np.cross(u, across)


class Closure:
    """The equations of a compiled model; its unknowns are (nbody - 1) places, quaternions, then qpos."""

    def __init__(
        self, model: mujoco.MjModel, size: float, prescribed: Mapping[str, Callable[[float], float]]
    ):
        """Take the model, its size in [m], and of driven and held joints their values over time."""
        self.model, self.size = model, size
        self.places = 7 * (model.nbody - 1)
        self.prescribed = {
            int(model.jnt_qposadr[model.joint(name).id]): value for name, value in prescribed.items()
        }

    def body(self, x: np.ndarray, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Return place and quaternion of a body."""
        if b <= 0:
            return np.zeros((*x.shape[:-1], 3)), np.broadcast_to([1.0, 0, 0, 0], (*x.shape[:-1], 4))
        own = x[..., 7 * (b - 1) : 7 * b]
        return own[..., :3], own[..., 3:]

    def hung(self, x: np.ndarray, b: int) -> tuple[np.ndarray, np.ndarray]:
        """Return where the joints of a body put it, on the body above."""
        m, q = self.model, x[..., self.places :]
        place, turn = self.body(x, int(m.body_parentid[b]))
        place, turn = place + turned(turn, m.body_pos[b]), times(turn, m.body_quat[b])
        for j in range(int(m.body_jntadr[b]), int(m.body_jntadr[b]) + int(m.body_jntnum[b])):
            at, kind = int(m.jnt_qposadr[j]), int(m.jnt_type[j])
            if kind == FREE:
                return q[..., at : at + 3], q[..., at + 3 : at + 7]
            moved = (q[..., at] - m.qpos0[at])[..., None]
            if kind == SLIDE:
                place = place + turned(turn, moved * m.jnt_axis[j])
                continue
            anchor = place + turned(turn, m.jnt_pos[j])
            about = np.concatenate([np.cos(moved / 2), np.sin(moved / 2) * m.jnt_axis[j]], -1)
            turn = times(turn, q[..., at : at + 4] if kind == BALL else about)
            place = anchor - turned(turn, m.jnt_pos[j])
        return place, turn

    def residual(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return all equations, lengths over the size, (..., rows)."""
        m, q, rows = self.model, x[..., self.places :], []
        for b in range(1, m.nbody):
            for (own, due), scale in zip(
                zip(self.body(x, b), self.hung(x, b), strict=True), (self.size, 1.0), strict=True
            ):
                rows.append((own - due) / scale)
        for j in range(m.njnt):
            if int(m.jnt_type[j]) in (FREE, BALL):
                at = int(m.jnt_qposadr[j]) + (3 if int(m.jnt_type[j]) == FREE else 0)
                rows.append(((q[..., at : at + 4] ** 2).sum(-1) - 1.0)[..., None])
        rows += [self.equality(x, i) for i in range(m.neq) if m.eq_active0[i]]
        rows += [(q[..., at] - value(t))[..., None] for at, value in self.prescribed.items()]
        return np.concatenate(rows, -1)

    def equality(self, x: np.ndarray, i: int) -> np.ndarray:
        """Return what an equality of the file holds."""
        m, data, kind = self.model, self.model.eq_data[i], int(self.model.eq_type[i])
        first, second = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if kind in (JOINT, TENDON):
            left, right = (self.measured(x, of, kind == TENDON) for of in (first, second))
            return (left - sum(data[k] * right**k for k in range(5)))[..., None]
        weld = kind == WELD
        if int(m.eq_objtype[i]) == SITE:
            bodies = int(m.site_bodyid[first]), int(m.site_bodyid[second])
            points, turns = (m.site_pos[first], m.site_pos[second]), (m.site_quat[first], m.site_quat[second])
        else:
            bodies, same = (first, second), np.array([1.0, 0, 0, 0])
            points = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
            turns = (data[6:10] if weld else same), same
        (place_a, turn_a), (place_b, turn_b) = (self.body(x, b) for b in bodies)
        gap = place_b + turned(turn_b, points[1]) - place_a - turned(turn_a, points[0])
        if not weld or data[10] == 0.0:
            return gap / self.size
        back = times(turn_a, turns[0]) * np.array([1.0, -1, -1, -1])
        return np.concatenate([gap / self.size, times(back, times(turn_b, turns[1]))[..., 1:]], -1)

    def measured(self, x: np.ndarray, of: int, tendon: bool) -> np.ndarray:
        """Return how far a joint's coordinate or a fixed tendon's length is from the reference."""
        m, q = self.model, x[..., self.places :]
        if of < 0:
            return np.zeros(x.shape[:-1])
        if not tendon:
            at = int(m.jnt_qposadr[of])
            return q[..., at] - m.qpos0[at]
        first = int(m.tendon_adr[of])
        wraps = range(first, first + int(m.tendon_num[of]))
        at = [int(m.jnt_qposadr[m.wrap_objid[w]]) for w in wraps]
        return ((q[..., at] - m.qpos0[at]) * m.wrap_prm[list(wraps)]).sum(-1)

    def jacobian(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the derivatives of all equations by all unknowns."""
        return self.residual(x + 1j * STEP * np.eye(len(x)), t).imag.T / STEP

    def initial(self, qpos: np.ndarray) -> np.ndarray:
        """Return the unknowns where the tree of the model puts its bodies."""
        x = np.concatenate([np.zeros(self.places), qpos])
        for b in range(1, self.model.nbody):
            x[7 * (b - 1) : 7 * b] = np.concatenate(self.hung(x, b))
        return x

    def solved(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the pose of least squares near one."""
        for _ in range(20):
            step = lstsq(self.jacobian(x, t), self.residual(x, t), cond=OPEN)[0]
            x = x - step
            if np.abs(step).max() < ENOUGH:
                break
        return x

    def followed(self, qpos: np.ndarray, instants: np.ndarray) -> np.ndarray:
        """Return the poses at given times, (times, unknowns), on the way from qpos."""
        x = self.solved(self.initial(qpos), float(instants[0]))
        result = [x]
        for t, end in pairwise(instants):
            before = x
            for at in np.linspace(t, end, BETWEEN + 1)[1:]:
                x, before = self.solved(2.0 * x - before if before is not x else x, float(at)), x
            result.append(x)
        return np.array(result)

    def settled(self, x: np.ndarray, t: float) -> list[str]:
        """Return the names of the bodies that no open motion moves."""
        _, values, right = np.linalg.svd(self.jacobian(x, t))
        loose = right[int((values > OPEN * values[0]).sum()) :, : self.places]
        moved = np.abs(loose).max(0, initial=0.0).reshape(-1, 7).max(-1)
        return [self.model.body(b + 1).name for b in np.flatnonzero(moved < MOVED)]


def worst_difference(
    model: mujoco.MjModel,
    size: float,
    qpos: np.ndarray,
    prescribed: Mapping[str, Callable[[float], float]],
    instants: np.ndarray,
    links: Mapping[str, tuple[np.ndarray, np.ndarray]],
) -> tuple[float, float, float]:
    """Return how far links are from the closure solved apart.

    Args:
        model: compiled, every body named.
        size: by which lengths are measured, in [m].
        qpos: where it starts.
        prescribed: driven or held joint -> its value over time.
        instants: (n,) in [s].
        links: body -> places (n, 3) and rotation matrices (n, 3, 3) to be judged.

    Returns:
        The worst distance over all links that nothing leaves open, over the size of the model; the worst
        turn between them in [rad]; and the worst residual of the reference itself.
    """
    closure = Closure(model, size, prescribed)
    poses = closure.followed(qpos, instants)
    settled = [
        name
        for name in closure.settled(poses[len(poses) // 2], float(instants[len(poses) // 2]))
        if name in links
    ]
    far = turn = 0.0
    for name in settled:
        place, quaternion = closure.body(poses, model.body(name).id)
        columns = np.stack([turned(quaternion, np.broadcast_to(axis, place.shape)) for axis in np.eye(3)], -1)
        far = max(far, float(np.linalg.norm(place - links[name][0], axis=-1).max()) / closure.size)
        turn = max(turn, float(np.abs(columns - links[name][1]).max()))
    left = max(
        float(np.abs(closure.residual(x, float(t))).max()) for x, t in zip(poses, instants, strict=True)
    )
    return far, turn, left
