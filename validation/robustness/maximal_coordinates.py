"""Constraint equations of a mechanism in maximal coordinates: a reference that shares no code with mechsim.

The unknowns are position and quaternion of every link and every joint coordinate. The constraint equations
follow from the definitions of the joints; they are polynomials except for cos and sin. Complex steps give the
Jacobian and Cauchy's integral the Taylor coefficients along a motion, both to rounding. Newton steps have
least norm, so that redundant constraints and passive degrees of freedom are allowed. `solve_path` follows an
assembly with steps that are halved until prediction and solution agree.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

# coordinate in [m] or [rad] at time t, which may be complex
MotionLaw = Callable[[complex | float], complex | float]
DOFS = {
    "fixed": 0,
    "revolute": 1,
    "prismatic": 1,
    "screw": 1,
    "cylindrical": 2,
    "universal": 2,
    "planar": 3,
    "spherical": 3,
}
# kind -> units of its coordinates
UNITS = {
    "fixed": "",
    "revolute": "r",
    "prismatic": "m",
    "screw": "mr",
    "cylindrical": "mr",
    "universal": "rr",
    "planar": "mmr",
    "spherical": "",
}
# singular values relative to the largest: the smallest of a regular pose, and the limit of rank loss
MIN_SINGULAR_VALUE, ZERO_SINGULAR_VALUE = 1e-4, 1e-9


class NearSingularError(Exception):
    """The path comes near a singular pose, or ends in one."""


@dataclass
class Joint:
    """Frames of both links: (point, columns reference, axis x reference, axis)."""

    name: str
    kind: str
    a: int
    b: int
    frame_a: tuple[np.ndarray, np.ndarray]
    frame_b: tuple[np.ndarray, np.ndarray]
    cross: float = np.pi / 2
    lead: float = 0.0
    index: int = 0  # index of its first coordinate

    @property
    def coordinates(self) -> range:
        return range(self.index, self.index + len(UNITS[self.kind]))


@dataclass
class ConstraintModel:
    """Links 0 (ground) to n, joints, and couplings: functions of all coordinates that vanish."""

    links: int
    length: float
    joints: list[Joint]
    couplings: list[Callable[[np.ndarray], np.ndarray]] = field(default_factory=list)
    laws: dict[int, MotionLaw] = field(default_factory=dict)
    rank: int = 0  # of the Jacobian at the assembled pose; some equations may be redundant

    @property
    def count(self) -> int:
        """Number of all joint coordinates."""
        return sum(len(UNITS[item.kind]) for item in self.joints)

    def poses(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (..., n+1, 3) and rotations (..., n+1, 3, 3) of all links, ground first."""
        n = self.links
        position = self.length * x[..., : 3 * n].reshape(*x.shape[:-1], n, 3)
        w, i, j, k = np.moveaxis(x[..., 3 * n : 7 * n].reshape(*x.shape[:-1], n, 4), -1, 0)
        rows = [
            [w * w + i * i - j * j - k * k, 2 * (i * j - w * k), 2 * (i * k + w * j)],
            [2 * (i * j + w * k), w * w - i * i + j * j - k * k, 2 * (j * k - w * i)],
            [2 * (i * k - w * j), 2 * (j * k + w * i), w * w - i * i - j * j + k * k],
        ]
        rotation = np.stack([np.stack(row, -1) for row in rows], -2)
        frame = np.broadcast_to(np.eye(3), (*x.shape[:-1], 1, 3, 3))
        return np.concatenate([0 * frame[..., 0], position], -2), np.concatenate([frame, rotation], -3)

    def residual(self, x: np.ndarray, t: complex | float) -> np.ndarray:
        """Return all constraint equations, lengths relative to the size, (..., equations)."""
        position, rotation = self.poses(x)
        q = x[..., 7 * self.links :]
        rows = [(x[..., 3 * self.links : 7 * self.links].reshape(*x.shape[:-1], -1, 4) ** 2).sum(-1) - 1.0]
        for item in self.joints:
            (point_a, axes_a), (point_b, axes_b) = item.frame_a, item.frame_b
            to_a = np.swapaxes(rotation[..., item.a, :, :] @ axes_a, -1, -2)
            offset = position[..., item.b, :] + rotation[..., item.b, :, :] @ point_b
            offset = offset - position[..., item.a, :] - rotation[..., item.a, :, :] @ point_a
            offset = (to_a @ offset[..., None])[..., 0] / self.length
            rel = to_a @ rotation[..., item.b, :, :] @ axes_b
            rows.append(
                np.stack(joint_equations(item, offset, rel, q[..., list(item.coordinates)], self.length), -1)
            )
        extra = [coupling(q) for coupling in self.couplings]
        extra += [q[..., i] - law(t) for i, law in self.laws.items()]  # t has the batch shape of x
        return np.concatenate([*rows, np.stack(extra, -1)] if extra else rows, -1)

    def jacobian(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the constraint Jacobian, by complex steps."""
        return self.residual(x + 1e-40j * np.eye(len(x)), t).imag.T / 1e-40

    def pseudo_inverse(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the pseudo-inverse of the Jacobian, and a basis of its null space (k, unknowns).

        Raises:
            NearSingularError: near a singular pose, where the rank is not certain.
        """
        u, values, v = np.linalg.svd(self.jacobian(x, t))
        rank = self.rank or int((values > ZERO_SINGULAR_VALUE * values[0]).sum())
        if values[rank - 1] < MIN_SINGULAR_VALUE * values[0]:
            raise NearSingularError
        return v[:rank].T / values[:rank] @ u[:, :rank].T, v[rank:]

    def solve(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the pose to which Newton's method converges."""
        for _ in range(12):
            step = self.pseudo_inverse(x, t)[0] @ self.residual(x, t)
            x = x - step
            if np.abs(step).max() < 1e-13:
                break
        if not np.abs(self.residual(x, t)).max() < 1e-12:
            raise NearSingularError
        return x

    def rates(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return first and second time derivatives of the unknowns, of least norm."""
        inverse, _ = self.pseudo_inverse(x, t)
        velocity = -inverse @ self.residual(x, t + 1e-40j).imag / 1e-40
        radius = 0.3 / max(1.0, np.abs(velocity).max())
        return velocity, -2.0 * inverse @ self.taylor_coefficient(x, velocity, t, radius, 2)

    def taylor_coefficient(
        self, x: np.ndarray, velocity: np.ndarray, t: float, radius: float, power: int
    ) -> np.ndarray:
        """Return a Taylor coefficient of the equations along x + velocity t, from a circle of complex t."""
        circle = radius * np.exp(2j * np.pi * np.arange(32) / 32)
        values = self.residual(x + velocity * circle[:, None], t + circle)
        return (values * circle[:, None] ** -power).mean(0).real


def joint_equations(
    item: Joint, offset: np.ndarray, rel: np.ndarray, q: np.ndarray, length: float
) -> list[np.ndarray]:
    """Return the constraints of a joint and the equations of its coordinates; `offset` is relative."""
    axial, parallel = offset[..., 2], [rel[..., 0, 2], rel[..., 1, 2]]

    def angle_equation(angle: np.ndarray) -> np.ndarray:
        return rel[..., 1, 0] * np.cos(angle) - rel[..., 0, 0] * np.sin(angle)

    if item.kind == "planar":
        return [
            offset[..., 0] - q[..., 0] / length,
            offset[..., 1] - q[..., 1] / length,
            axial,
            *parallel,
            angle_equation(q[..., 2]),
        ]
    pinned = [offset[..., 0], offset[..., 1], axial]
    if item.kind == "spherical":
        return pinned
    if item.kind == "fixed":
        return [*pinned, *parallel, rel[..., 1, 0]]
    if item.kind == "revolute":
        return [*pinned, *parallel, angle_equation(q[..., 0])]
    if item.kind == "universal":
        first, second = q[..., 0], q[..., 1]
        return [
            *pinned,
            rel[..., 2, 2] - np.cos(item.cross),
            rel[..., 1, 2] * np.cos(first) - rel[..., 0, 2] * np.sin(first),
            -rel[..., 2, 1] * np.cos(second) - rel[..., 2, 0] * np.sin(second),
        ]
    sliding = [*pinned[:2], axial - q[..., 0] / length, *parallel]
    if item.kind == "prismatic":
        return [*sliding, rel[..., 1, 0]]
    helical = [(q[..., 0] - item.lead * q[..., 1] / (2 * np.pi)) / length] if item.kind == "screw" else []
    return [*sliding, angle_equation(q[..., 1]), *helical]


def solve_path(model: ConstraintModel, x: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the poses at given times, (times, unknowns), starting near `x`.

    Raises:
        NearSingularError: where the path comes near a singular pose.
    """
    x = model.solve(x, float(times[0]))
    result, time, step = [x], float(times[0]), float(times[1] - times[0]) / 2
    for end in times[1:]:
        while time < end:
            velocity, acceleration = model.rates(x, time)
            step = min(step, float(end) - time)
            predicted = x + step * velocity + 0.5 * step**2 * acceleration
            try:
                corrected = model.solve(predicted, time + step)
                correction = float(np.abs(corrected - predicted).max())
            except NearSingularError:
                correction = np.inf
            if correction > 0.02:
                step /= 2
                if step < 1e-3 * (times[-1] - times[0]):
                    raise NearSingularError
                continue
            x, time = corrected, time + step
            step *= 2 if correction < 0.003 else 1
        result.append(x)
    return np.array(result)


def point_motion(
    model: ConstraintModel, x: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return positions, velocities and accelerations of points of every link, (3, links, points, 3)."""
    circle = 0.3 / max(1.0, np.abs(velocity).max()) * np.exp(2j * np.pi * np.arange(32) / 32)
    position, rotation = model.poses(
        x + velocity * circle[:, None] + 0.5 * acceleration * circle[:, None] ** 2
    )
    moved = position[:, 1:, None] + (rotation[:, 1:, None] @ points[..., None])[..., 0]
    powers = [(moved * circle[:, None, None, None] ** -power).mean(0).real for power in range(3)]
    return np.array([powers[0], powers[1], 2.0 * powers[2]])
