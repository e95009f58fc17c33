"""Loop equations of any mechanism: residual, Jacobian, rates, rank and assembly.

Every moving link has six coordinates (a position and an orientation); each joint is a few rows that
must vanish. This is the second, independent truth on the analytic side: it knows no closed form.

A row is one of four kinds, for unit vectors U on link A and V on link B and the vector D from A's
joint point to B's: the three components of D, U.V - c, U.D - c, and the driver or gear row.
Jacobians are with respect to twists (velocity of the link's origin, angular velocity), both in the
ground frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism import GROUND, IDENTITY, Joint, Mechanism, Pose, joint_coordinate
from mechsim.motion import JointMotion, LinkMotion, Motion, PointMotion

Array = NDArray[np.float64]
Poses = Mapping[str, Pose]

# singular values below this part of the largest count as zero: between the 1e-16 of rounding and
# the 1e-6 or so of a mechanism that is merely near a dead centre
RANK_TOLERANCE = 1e-9
# a gap this small is rounding; polishing on would chase it down to the denormal numbers
FLOOR = 4.0 * np.finfo(np.float64).eps


@dataclass(frozen=True, slots=True)
class Rows:
    """Some rows of the loop equations, linearised.

    Attributes:
        residual: (n, m).
        jacobian: (n, m, 6 links).
        bias: second derivative of the residual at zero acceleration, (n, m).
    """

    residual: Array
    jacobian: Array
    bias: Array


class _Side:
    """A joint end in space: its arm from the link's origin, its frame, and how both move."""

    def __init__(self, pose: Pose, twist: Array, point: ArrayLike, frame: Array, slot: int | None):
        self.slot = slot
        self.arm = pose.rotation @ np.asarray(point)  # (n, 3)
        self.point = pose.position + self.arm
        self.frame = pose.rotation @ frame  # (n, 3, 3)
        self.velocity, self.spin = twist[..., :3], twist[..., 3:]
        self.point_velocity = self.velocity + _cross(self.spin, self.arm)
        self.point_bias = _cross(self.spin, _cross(self.spin, self.arm))

    def direction(self, column: int) -> tuple[Array, Array, Array]:
        """Return a frame direction, its rate and the bias of its second rate."""
        u = self.frame[..., column]
        rate = _cross(self.spin, u)
        return u, rate, _cross(self.spin, rate)


def _skew(v: Array) -> Array:
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(-1)


def _cross(a: Array, b: Array) -> Array:
    # np.cross spends ten times longer on moving axes than on multiplying
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


class _Stack:
    """Collects rows for a mechanism of `links` moving links at n poses."""

    def __init__(self, links: int, n: int):
        self.links, self.n = links, n
        self.residual: list[Array] = []
        self.jacobian: list[Array] = []
        self.bias: list[Array] = []

    def _add(self, residual: Array, bias: Array, parts: list[tuple[int | None, Array, Array]]) -> None:
        row = np.zeros((self.n, 6 * self.links))
        for slot, linear, angular in parts:
            if slot is not None:
                row[:, 6 * slot : 6 * slot + 3] += linear
                row[:, 6 * slot + 3 : 6 * slot + 6] += angular
        self.residual.append(np.broadcast_to(residual, (self.n,)))
        self.jacobian.append(row)
        self.bias.append(np.broadcast_to(bias, (self.n,)))

    def coincide(self, a: _Side, b: _Side) -> None:
        """D = 0, three rows."""
        gap, bias = b.point - a.point, b.point_bias - a.point_bias
        turn_a, turn_b = _skew(a.arm), -_skew(b.arm)
        for i in range(3):
            unit = np.eye(3)[i]
            parts = [(a.slot, -unit, turn_a[:, i]), (b.slot, unit, turn_b[:, i])]
            self._add(gap[:, i], bias[:, i], parts)

    def angle_between(self, a: _Side, i: int, b: _Side, j: int, cosine: float) -> None:
        """U.V = cosine, with U column i of a's frame and V column j of b's."""
        u, u_rate, _ = a.direction(i)
        v, v_rate, _ = b.direction(j)
        across = _cross(u, v)
        bias = _dot(a.spin - b.spin, _cross(u_rate, v) + _cross(u, v_rate))
        zero = np.zeros(3)
        self._add(_dot(u, v) - cosine, bias, [(a.slot, zero, across), (b.slot, zero, -across)])

    def distance_along(self, a: _Side, i: int, b: _Side, way: float) -> None:
        """U.D = way, with U column i of a's frame."""
        u, u_rate, u_bias = a.direction(i)
        gap, gap_rate = b.point - a.point, b.point_velocity - a.point_velocity
        bias = 2.0 * _dot(u_rate, gap_rate) + _dot(u_bias, gap)
        bias = bias + _dot(u, b.point_bias - a.point_bias)
        parts = [(a.slot, -u, _cross(u, gap) - _cross(a.arm, u)), (b.slot, u, _cross(b.arm, u))]
        self._add(_dot(u, gap) - way, bias, parts)

    def turned(self, residual: Array, turns: list[tuple[float, _Side, _Side]]) -> None:
        """A weighted sum of joint angles is given; residual in [rad]."""
        bias = np.zeros(self.n)
        parts: list[tuple[int | None, Array, Array]] = []
        for weight, a, b in turns:
            axis, axis_rate, _ = a.direction(2)
            bias = bias + weight * _dot(axis_rate, b.spin - a.spin)
            parts += [(a.slot, np.zeros(3), -weight * axis), (b.slot, np.zeros(3), weight * axis)]
        self._add(_wrap(residual), bias, parts)

    def rows(self) -> Rows:
        """Return all rows collected."""
        return Rows(np.stack(self.residual, 1), np.stack(self.jacobian, 1), np.stack(self.bias, 1))


def _wrap(angle: Array) -> Array:
    return angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi))


def equations(
    mechanism: Mechanism,
    poses: Poses,
    angle: ArrayLike | None,
    twists: Mapping[str, Array] | None = None,
) -> Rows:
    """Return the loop equations of a mechanism, linearised about n sets of poses.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses.
        angle: crank angle that the driver row asks for, scalar or (n,) in [rad]; None leaves the
            driver row out, so that the crank is free.
        twists: moving link -> (n, 6) velocity of the origin and angular velocity; only the bias
            depends on them. None means at rest.

    Returns:
        Rows in the order of the joints, then gears, then the driver. Residuals in [m], [rad] or
        cosines of angles.
    """
    names = [link.name for link in mechanism.links]
    n = next(iter(poses.values())).position.shape[0]
    at_rest = np.zeros((n, 6))
    ground = Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))

    def side(joint: Joint, which: str) -> _Side:
        end = getattr(joint, which)
        if end.link == GROUND:
            return _Side(ground, at_rest, end.point, end.frame, None)
        twist = at_rest if twists is None else twists[end.link]
        return _Side(poses[end.link], twist, end.point, end.frame, names.index(end.link))

    def pose(link: str) -> Pose:
        return ground if link == GROUND else poses[link]

    stack = _Stack(len(names), n)
    for joint in mechanism.joints:
        _joint_rows(stack, joint, side(joint, "a"), side(joint, "b"))

    def coordinate(joint: Joint) -> Array:
        return joint_coordinate(joint, pose(joint.a.link), pose(joint.b.link))[..., 0]

    driver = mechanism.joint(mechanism.driver)
    for gear in mechanism.gears:
        first, second = mechanism.joint(gear.driver), mechanism.joint(gear.driven)
        # the crank's own angle counts its turns, so that a ratio that is no whole number works
        turned = coordinate(first)
        if first.name == driver.name and angle is not None:
            turned = np.asarray(angle) + _wrap(turned - np.asarray(angle))
        gap = coordinate(second) - gear.ratio * turned - gear.phase
        turns = [(1.0, side(second, "a"), side(second, "b"))]
        turns.append((-gear.ratio, side(first, "a"), side(first, "b")))
        stack.turned(gap, turns)
    if angle is not None:
        gap = coordinate(driver) - np.asarray(angle)
        stack.turned(gap, [(1.0, side(driver, "a"), side(driver, "b"))])
    return stack.rows()


def _joint_rows(stack: _Stack, joint: Joint, a: _Side, b: _Side) -> None:
    """Add the rows of one joint; frame columns are 0 = mark, 1 = axis x mark, 2 = axis."""
    if joint.kind in ("revolute", "universal", "spherical"):
        stack.coincide(a, b)
    else:
        stack.distance_along(a, 0, b, 0.0)
        stack.distance_along(a, 1, b, 0.0)
    if joint.kind == "universal":
        stack.angle_between(a, 2, b, 2, float(np.cos(joint.cross_angle)))
    elif joint.kind != "spherical":
        stack.angle_between(a, 0, b, 2, 0.0)
        stack.angle_between(a, 1, b, 2, 0.0)
    if joint.kind == "prismatic":
        stack.angle_between(a, 0, b, 1, 0.0)


def _scaled(mechanism: Mechanism, jacobian: Array) -> Array:
    """Make a Jacobian free of units: lengths in units of the mechanism's size."""
    size = mechanism.size
    columns = np.tile([size] * 3 + [1.0] * 3, len(mechanism.links))
    scaled = jacobian * columns
    rows = np.ones(jacobian.shape[1])
    lengths = [length for joint in mechanism.joints for length in _is_length(joint)]
    rows[: len(lengths)] = np.where(lengths, 1.0 / size, 1.0)
    return scaled * rows[:, None]


def _is_length(joint: Joint) -> list[bool]:
    """Say of each row of a joint whether its residual is a length."""
    point_rows = 3 if joint.kind in ("revolute", "universal", "spherical") else 2
    angle_rows = {"revolute": 2, "prismatic": 3, "cylindrical": 2, "universal": 1, "spherical": 0}
    return [True] * point_rows + [False] * angle_rows[joint.kind]


def residual_norms(mechanism: Mechanism, poses: Poses, angle: ArrayLike) -> tuple[Array, Array]:
    """Return how far the loops stand open at each pose: (n,) in [m] and (n,) in [rad]."""
    rows = np.abs(equations(mechanism, poses, angle).residual)
    kinds = [length for joint in mechanism.joints for length in _is_length(joint)]
    lengths = np.array(kinds + [False] * (rows.shape[1] - len(kinds)))
    return rows[:, lengths].max(1, initial=0.0), rows[:, ~lengths].max(1, initial=0.0)


def singular_values(mechanism: Mechanism, poses: Poses, *, crank_free: bool = False) -> Array:
    """Return the singular values of the loop Jacobian in units of the mechanism's size, (n, k), falling.

    With the crank held, the smallest of them that belongs to a determined coordinate is the
    distance to a singular pose (a dead centre of the crank).
    """
    angle = None if crank_free else 0.0
    rows = equations(mechanism, poses, angle)
    values = np.linalg.svd(_scaled(mechanism, rows.jacobian), compute_uv=False)
    return values.astype(np.float64, copy=False)


@dataclass(frozen=True, slots=True)
class Freedom:
    """What the rank of the loop Jacobian says at one pose.

    Attributes:
        mobility: freedoms left by all joints.
        passive: freedoms left once the crank is held, which move no tracked point by themselves.
        redundant: rows that repeat what others say.
        rank: of the loop Jacobian without the driver row.
    """

    mobility: int
    passive: int
    redundant: int
    rank: int


def freedom(mechanism: Mechanism, poses: Poses) -> Freedom:
    """Return mobility, passive freedoms and redundant rows at the first of the poses.

    Source: rank of the Jacobian of the loop equations; papers.md sections 1-3 for what is expected.
    """
    first = {name: pose.at(slice(0, 1)) for name, pose in poses.items()}
    unknowns = 6 * len(mechanism.links)

    def rank(crank_free: bool) -> tuple[int, int]:
        values = singular_values(mechanism, first, crank_free=crank_free)[0]
        rows = equations(mechanism, first, None if crank_free else 0.0).residual.shape[1]
        return int((values > RANK_TOLERANCE * values[0]).sum()), rows

    free, rows = rank(True)
    held, _ = rank(False)
    return Freedom(unknowns - free, unknowns - held, rows - free, free)


def _solve(mechanism: Mechanism, jacobian: Array, right: Array) -> Array:
    """Least-norm solution of J x = right, (n, 6 links): redundant rows, passive freedoms do no harm."""
    size = mechanism.size
    columns = np.tile([size] * 3 + [1.0] * 3, len(mechanism.links))
    inverse = np.linalg.pinv(jacobian * columns, rcond=RANK_TOLERANCE)
    return columns * (inverse @ right[..., None])[..., 0]


def turned_by(rotation: Array, vector: Array) -> Array:
    """Return exp(vector) @ rotation, (n, 3, 3), made orthogonal again to rounding."""
    angle = np.sqrt(_dot(vector, vector))[:, None, None]
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    k = _skew(vector)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    turned = (np.eye(3) + a * k + b * (k @ k)) @ rotation
    # one Newton step towards the nearest rotation keeps the columns orthonormal to an ulp
    return turned @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(turned, -1, -2) @ turned)


def assemble(
    mechanism: Mechanism,
    angles: ArrayLike,
    guess: Poses | None = None,
    *,
    most_steps: int = 50,
    tolerance: float = 1e-12,
) -> dict[str, Pose]:
    """Close the loops at each crank angle by Newton's method from a guess.

    Args:
        mechanism: the mechanism.
        angles: crank angles, (n,) in [rad].
        guess: moving link -> one pose or n poses; None takes the mechanism's own guess for all angles.
        most_steps: Newton steps before giving up.
        tolerance: largest residual left, in units of the mechanism's size and in [rad].

    Returns:
        Moving link -> n poses.

    Raises:
        AssemblyError: where the loops do not close; names the crank angle and the gap left.

    Accuracy: Newton's method to rounding: residuals of a few ulp of the longest link away from a
    dead centre.
    """
    angles = _crank_angles(mechanism, angles)
    start = rough_poses(mechanism) if guess is None else guess
    poses = {
        link.name: Pose(
            np.broadcast_to(start[link.name].position, (len(angles), 3)),
            np.broadcast_to(start[link.name].rotation, (len(angles), 3, 3)),
        )
        for link in mechanism.links
    }
    gap, before = np.full(len(angles), np.inf), np.inf
    for _ in range(most_steps):
        rows = equations(mechanism, poses, angles)
        gap = _gap(mechanism, rows.residual)
        worst = gap.max()
        if worst <= FLOOR or (worst <= tolerance and worst >= 0.25 * before):
            return poses
        before = worst
        step = -_solve(mechanism, rows.jacobian, rows.residual)
        turns = step.reshape(len(angles), -1, 6)[..., 3:]
        # never turn a link by more than half a radian at once: the linear model is not true that far
        step *= 0.5 / np.maximum(0.5, np.sqrt((turns**2).sum(-1)).max(-1))[:, None]
        poses = _moved(mechanism, poses, step)
    if gap.max() <= tolerance:
        return poses
    worst = int(np.argmax(gap))
    raise AssemblyError(
        f"{mechanism.name}: the loops do not close at crank angle {angles[worst]:.6g} rad: a gap of "
        f"{gap[worst]:.3g} of the longest link is left after {most_steps} Newton steps; "
        "change the dimensions, the crank angle or the guess"
    )


def _crank_angles(mechanism: Mechanism, angles: ArrayLike) -> Array:
    values = np.atleast_1d(np.asarray(angles, dtype=np.float64))
    if values.ndim != 1 or not np.isfinite(values).all():
        raise InputError(
            f"{mechanism.name}: a crank angle is no finite number; give a list of angles in [rad]"
        )
    return values


def _gap(mechanism: Mechanism, residual: Array) -> Array:
    kinds = [length for joint in mechanism.joints for length in _is_length(joint)]
    scale = np.ones(residual.shape[1])
    scale[: len(kinds)] = np.where(kinds, 1.0 / mechanism.size, 1.0)
    return np.abs(residual * scale).max(1)


def _moved(mechanism: Mechanism, poses: Poses, step: Array) -> dict[str, Pose]:
    moved = {}
    for i, link in enumerate(mechanism.links):
        shift, vector = step[:, 6 * i : 6 * i + 3], step[:, 6 * i + 3 : 6 * i + 6]
        pose = poses[link.name]
        moved[link.name] = Pose(pose.position + shift, turned_by(pose.rotation, vector))
    return moved


def rough_poses(mechanism: Mechanism) -> dict[str, Pose]:
    """Return one pose a link: the guess, else where its joints to placed links put it at zero coordinates."""
    placed: dict[str, Pose] = {GROUND: IDENTITY, **mechanism.guess}
    waiting = list(mechanism.joints)
    while waiting:
        joint = next((j for j in waiting if j.a.link in placed or j.b.link in placed), None)
        if joint is None:
            lost = [link.name for link in mechanism.links if link.name not in placed]
            raise AssemblyError(
                f"{mechanism.name}: no chain of joints leads from the frame to {', '.join(lost)}; add one"
            )
        waiting.remove(joint)
        near, far = (joint.a, joint.b) if joint.a.link in placed else (joint.b, joint.a)
        if far.link not in placed:
            pose = placed[near.link]
            rotation = pose.rotation @ near.frame @ far.frame.T
            placed[far.link] = Pose(pose.point(near.point) - rotation @ np.asarray(far.point), rotation)
    lost = [link.name for link in mechanism.links if link.name not in placed]
    if lost:
        raise AssemblyError(
            f"{mechanism.name}: no joint holds link {', '.join(lost)}; add one or leave it out"
        )
    del placed[GROUND]
    return placed


def follow(mechanism: Mechanism, angles: ArrayLike, *, step: float = np.pi / 36) -> dict[str, Pose]:
    """Assemble along a path of crank angles, each pose guessed from the one before: the assembly is kept.

    Args:
        mechanism: the mechanism; its guess begins the path.
        angles: crank angles in the order they are passed, (n,) in [rad].
        step: longest step of the crank between two solutions, in [rad].

    Returns:
        Moving link -> n poses.

    Raises:
        AssemblyError: where the loops do not close.
    """
    angles = _crank_angles(mechanism, angles)
    current = assemble(mechanism, [mechanism.start])
    found: list[dict[str, Pose]] = []
    for here, there in pairwise([mechanism.start, *angles]):
        way = np.linspace(here, there, 1 + max(1, int(np.ceil(abs(there - here) / step))))[1:]
        for angle in way:
            current = assemble(mechanism, [angle], current)
        found.append(current)
    return {
        link.name: Pose(
            np.concatenate([poses[link.name].position for poses in found]),
            np.concatenate([poses[link.name].rotation for poses in found]),
        )
        for link in mechanism.links
    }


def rates(
    mechanism: Mechanism, poses: Poses, angle: ArrayLike, speed: ArrayLike, acceleration: ArrayLike = 0.0
) -> Motion:
    """Differentiate the loop equations twice: exact velocities and accelerations of everything.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses that close the loops.
        angle: crank angle, (n,) in [rad].
        speed: crank speed, scalar or (n,) in [rad/s].
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].

    Returns:
        The motion. Passive freedoms (the spin of an unguided coupler) get the least rates that agree.

    Accuracy: relative error about 1e-15 times the condition of the loop Jacobian.
    """
    names = [link.name for link in mechanism.links]
    angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
    n = len(angle)
    speed = np.broadcast_to(np.asarray(speed, dtype=np.float64), (n,))
    acceleration = np.broadcast_to(np.asarray(acceleration, dtype=np.float64), (n,))

    rows = equations(mechanism, poses, angle)
    asked = np.zeros_like(rows.residual)
    asked[:, -1] = speed
    twist = _solve(mechanism, rows.jacobian, asked).reshape(n, -1, 6)
    twists = {name: twist[:, i] for i, name in enumerate(names)}

    rows = equations(mechanism, poses, angle, twists)
    asked[:, -1] = acceleration
    accelerations = _solve(mechanism, rows.jacobian, asked - rows.bias).reshape(n, -1, 6)

    links = {
        name: LinkMotion(
            poses[name].position,
            poses[name].rotation,
            twist[:, i, :3],
            twist[:, i, 3:],
            accelerations[:, i, :3],
            accelerations[:, i, 3:],
        )
        for i, name in enumerate(names)
    }
    points = {
        point: point_on(links[link], local)
        for point, (link, local) in mechanism.points.items()
        if link != GROUND
    }
    return Motion(
        source="loop equations",
        angle=angle,
        speed=speed,
        acceleration=acceleration,
        points=points,
        links=links,
        joints={
            joint.name: _joint_motion(joint, links)
            for joint in mechanism.joints
            if joint.kind in ("revolute", "prismatic")
        },
    )


def solve(
    mechanism: Mechanism, angles: ArrayLike, speed: ArrayLike = 1.0, acceleration: ArrayLike = 0.0
) -> Motion:
    """Return the motion of any mechanism from its loop equations alone; `follow`, then `rates`."""
    poses = follow(mechanism, angles)
    return rates(mechanism, poses, angles, speed, acceleration)


def point_on(link: LinkMotion, local: ArrayLike) -> PointMotion:
    """Return the motion of a point fixed in a moving link."""
    arm = link.rotation @ np.asarray(local, dtype=np.float64)
    swing = _cross(link.angular_velocity, arm)
    pull = _cross(link.angular_acceleration, arm) + _cross(link.angular_velocity, swing)
    return PointMotion(link.position + arm, link.velocity + swing, link.acceleration + pull)


def _joint_motion(joint: Joint, links: Mapping[str, LinkMotion]) -> JointMotion:
    a, b = (_link_motion(end.link, links) for end in (joint.a, joint.b))
    poses = [Pose(link.position, link.rotation) for link in (a, b)]
    value = joint_coordinate(joint, *poses)[..., 0]
    axis = a.rotation @ np.asarray(joint.a.axis)
    axis_rate = _cross(a.angular_velocity, axis)
    if joint.kind == "revolute":
        spin = b.angular_velocity - a.angular_velocity
        pull = _dot(axis, b.angular_acceleration - a.angular_acceleration)
        return JointMotion(np.unwrap(value), _dot(axis, spin), pull + _dot(axis_rate, spin))
    ends = point_on(a, joint.a.point), point_on(b, joint.b.point)
    gap, gap_rate, gap_pull = (
        getattr(ends[1], part) - getattr(ends[0], part) for part in ("position", "velocity", "acceleration")
    )
    axis_pull = _cross(a.angular_acceleration, axis) + _cross(a.angular_velocity, axis_rate)
    return JointMotion(
        value,
        _dot(axis, gap_rate) + _dot(axis_rate, gap),
        _dot(axis, gap_pull) + 2.0 * _dot(axis_rate, gap_rate) + _dot(axis_pull, gap),
        "m",
    )


def _link_motion(name: str, links: Mapping[str, LinkMotion]) -> LinkMotion:
    if name != GROUND:
        return links[name]
    still = np.zeros_like(next(iter(links.values())).position)
    frames = np.broadcast_to(np.eye(3), (*still.shape, 3))
    return LinkMotion(still, frames, still, still, still, still)
