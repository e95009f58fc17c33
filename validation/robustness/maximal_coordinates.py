"""The closure of a mechanism in maximal coordinates: a truth that shares no code with mechsim.

Unknown are the place and the quaternion of every link, and every coordinate of every joint; what joints hold
is written from their definitions, as polynomials but for cos and sin. Slopes are complex steps, second
derivatives along a motion are Taylor coefficients by Cauchy's integral: all to rounding. Newton's steps are
of least norm, so that equations may repeat and a rod may spin between balls; `followed` takes steps along an
assembly that are halved until prediction and solution meet.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

# a coordinate's length or angle at time t, which may be complex
Program = Callable[[complex | float], complex | float]
FREEDOMS = {
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
# the nearest to a singular pose that is judged, and what counts as one: singular values over the largest
NEAR, NOUGHT = 1e-4, 1e-9


class TooNearError(Exception):
    """The path comes near a singular pose, or ends in one."""


@dataclass
class Joint:
    """Frames that meet: (point, columns reference, axis x reference, axis)."""

    name: str
    kind: str
    a: int
    b: int
    frame_a: tuple[np.ndarray, np.ndarray]
    frame_b: tuple[np.ndarray, np.ndarray]
    cross: float = np.pi / 2
    lead: float = 0.0
    at: int = 0  # of its first coordinate among those of all joints

    @property
    def coordinates(self) -> range:
        return range(self.at, self.at + len(UNITS[self.kind]))


@dataclass
class DynamicModel:
    """Links 0 (the frame) to n, joints, and laws: functions of all coordinates and of t that are zero."""

    links: int
    size: float
    joints: list[Joint]
    couplings: list[Callable[[np.ndarray], np.ndarray]] = field(default_factory=list)
    driven: dict[int, Program] = field(default_factory=dict)
    rank: int = 0  # of its equations at the assembled pose, which it keeps: some may repeat others

    @property
    def count(self) -> int:
        """How many coordinates all joints have."""
        return sum(len(UNITS[item.kind]) for item in self.joints)

    def poses(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return places (..., n+1, 3) and turning matrices (..., n+1, 3, 3) of all links, the frame first."""
        n = self.links
        place = self.size * x[..., : 3 * n].reshape(*x.shape[:-1], n, 3)
        w, i, j, k = np.moveaxis(x[..., 3 * n : 7 * n].reshape(*x.shape[:-1], n, 4), -1, 0)
        rows = [
            [w * w + i * i - j * j - k * k, 2 * (i * j - w * k), 2 * (i * k + w * j)],
            [2 * (i * j + w * k), w * w - i * i + j * j - k * k, 2 * (j * k - w * i)],
            [2 * (i * k - w * j), 2 * (j * k + w * i), w * w - i * i - j * j + k * k],
        ]
        turn = np.stack([np.stack(row, -1) for row in rows], -2)
        frame = np.broadcast_to(np.eye(3), (*x.shape[:-1], 1, 3, 3))
        return np.concatenate([0 * frame[..., 0], place], -2), np.concatenate([frame, turn], -3)

    def residual(self, x: np.ndarray, t: complex | float) -> np.ndarray:
        """Return all equations, lengths over the size, (..., rows)."""
        place, turn = self.poses(x)
        q = x[..., 7 * self.links :]
        rows = [(x[..., 3 * self.links : 7 * self.links].reshape(*x.shape[:-1], -1, 4) ** 2).sum(-1) - 1.0]
        for item in self.joints:
            (point_a, own_a), (point_b, own_b) = item.frame_a, item.frame_b
            to_a = np.swapaxes(turn[..., item.a, :, :] @ own_a, -1, -2)
            gap = place[..., item.b, :] + turn[..., item.b, :, :] @ point_b
            gap = gap - place[..., item.a, :] - turn[..., item.a, :, :] @ point_a
            gap = (to_a @ gap[..., None])[..., 0] / self.size
            rel = to_a @ turn[..., item.b, :, :] @ own_b
            rows.append(np.stack(_equations(item, gap, rel, q[..., list(item.coordinates)], self.size), -1))
        laws = [law(q) for law in self.couplings]
        laws += [q[..., i] - program(t) for i, program in self.driven.items()]  # t may be as many as x
        return np.concatenate([*rows, np.stack(laws, -1)] if laws else rows, -1)

    def jacobian(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the derivatives of all equations by all unknowns, by complex steps."""
        return self.residual(x + 1e-40j * np.eye(len(x)), t).imag.T / 1e-40

    def split(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the pseudo-inverse of the derivative, and the motions that nothing holds (k, unknowns).

        Raises:
            TooNearError: near a singular pose, where the two are not reported apart.
        """
        left, values, right = np.linalg.svd(self.jacobian(x, t))
        rank = self.rank or int((values > NOUGHT * values[0]).sum())
        if values[rank - 1] < NEAR * values[0]:
            raise TooNearError
        return right[:rank].T / values[:rank] @ left[:, :rank].T, right[rank:]

    def solved(self, x: np.ndarray, t: float) -> np.ndarray:
        """Return the pose that Newton's method leads to."""
        for _ in range(12):
            step = self.split(x, t)[0] @ self.residual(x, t)
            x = x - step
            if np.abs(step).max() < 1e-13:
                break
        if not np.abs(self.residual(x, t)).max() < 1e-12:
            raise TooNearError
        return x

    def rates(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return first and second derivatives of the unknowns by time, of least norm."""
        inverse, _ = self.split(x, t)
        pace = -inverse @ self.residual(x, t + 1e-40j).imag / 1e-40
        far = 0.3 / max(1.0, np.abs(pace).max())
        return pace, -2.0 * inverse @ self.taylor(x, pace, t, far, 2)

    def taylor(self, x: np.ndarray, pace: np.ndarray, t: float, far: float, power: int) -> np.ndarray:
        """Return a Taylor coefficient of the equations along x + pace t, from a circle of complex t."""
        on = far * np.exp(2j * np.pi * np.arange(32) / 32)
        values = self.residual(x + pace * on[:, None], t + on)
        return (values * on[:, None] ** -power).mean(0).real


def _equations(item: Joint, gap: np.ndarray, rel: np.ndarray, q: np.ndarray, size: float) -> list[np.ndarray]:
    """Return what holds a joint, and what defines its coordinates; `gap` is over the size."""
    along, lies = gap[..., 2], [rel[..., 0, 2], rel[..., 1, 2]]

    def turned(by: np.ndarray) -> np.ndarray:
        return rel[..., 1, 0] * np.cos(by) - rel[..., 0, 0] * np.sin(by)

    if item.kind == "planar":
        return [
            gap[..., 0] - q[..., 0] / size,
            gap[..., 1] - q[..., 1] / size,
            along,
            *lies,
            turned(q[..., 2]),
        ]
    pinned = [gap[..., 0], gap[..., 1], along]
    if item.kind == "spherical":
        return pinned
    if item.kind == "fixed":
        return [*pinned, *lies, rel[..., 1, 0]]
    if item.kind == "revolute":
        return [*pinned, *lies, turned(q[..., 0])]
    if item.kind == "universal":
        first, second = q[..., 0], q[..., 1]
        return [
            *pinned,
            rel[..., 2, 2] - np.cos(item.cross),
            rel[..., 1, 2] * np.cos(first) - rel[..., 0, 2] * np.sin(first),
            -rel[..., 2, 1] * np.cos(second) - rel[..., 2, 0] * np.sin(second),
        ]
    slides = [*pinned[:2], along - q[..., 0] / size, *lies]
    if item.kind == "prismatic":
        return [*slides, rel[..., 1, 0]]
    led = [(q[..., 0] - item.lead * q[..., 1] / (2 * np.pi)) / size] if item.kind == "screw" else []
    return [*slides, turned(q[..., 1]), *led]


def followed(machine: DynamicModel, x: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the poses at given times, (times, unknowns), from one at the first of them.

    Raises:
        TooNearError: where the path comes near to a singular pose.
    """
    x = machine.solved(x, float(times[0]))
    result, now, step = [x], float(times[0]), float(times[1] - times[0]) / 2
    for end in times[1:]:
        while now < end:
            pace, bend = machine.rates(x, now)
            step = min(step, float(end) - now)
            ahead = x + step * pace + 0.5 * step**2 * bend
            try:
                new = machine.solved(ahead, now + step)
                far = float(np.abs(new - ahead).max())
            except TooNearError:
                far = np.inf
            if far > 0.02:
                step /= 2
                if step < 1e-3 * (times[-1] - times[0]):
                    raise TooNearError
                continue
            x, now = new, now + step
            step *= 2 if far < 0.003 else 1
        result.append(x)
    return np.array(result)


def point_motion(
    machine: DynamicModel, x: np.ndarray, pace: np.ndarray, bend: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Return places, velocities and accelerations of points of every moving link, (3, links, points, 3)."""
    on = 0.3 / max(1.0, np.abs(pace).max()) * np.exp(2j * np.pi * np.arange(32) / 32)
    place, turn = machine.poses(x + pace * on[:, None] + 0.5 * bend * on[:, None] ** 2)
    at = place[:, 1:, None] + (turn[:, 1:, None] @ points[..., None])[..., 0]
    powers = [(at * on[:, None, None, None] ** -power).mean(0).real for power in range(3)]
    return np.array([powers[0], powers[1], 2.0 * powers[2]])
