"""The loop equations of a mechanism at given poses: six coordinates for each link, and no spanning tree.

They check solved motions by their residual, and give the reactions in joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.kinematics.vector_method.rotations import dot, skew
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import End, Joint, joint_coordinate
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array, cross, wrapped


@dataclass(frozen=True)
class Rows:
    """Some loop equations, linearised.

    Attributes:
        residual: (n, m).
        blocks: for each equation link's slot -> its derivative by the six coordinates of the link, (n, 6).
        bias: velocity-product term: second derivative of the residual at zero link accelerations, (n, m).
        links: number of links.
    """

    residual: Array
    blocks: tuple[Mapping[int, Array], ...]
    bias: Array
    links: int

    @cached_property
    def jacobian(self) -> Array:
        """Derivative of the residual by the coordinates of all links, (n, m, 6 links)."""
        n, m = self.residual.shape
        dtype = np.result_type(np.float64, *(values for row in self.blocks for values in row.values()))
        jacobian = np.zeros((n, m, 6 * self.links), dtype)
        for i, row in enumerate(self.blocks):
            for slot, values in row.items():
                jacobian[:, i, 6 * slot : 6 * slot + 6] = values
        return jacobian


Slots = list[int | None]


class Side:
    """One end of j joints in space: its arm from the link's origin, its frame, and their rates, (j, n, 3)."""

    def __init__(
        self,
        ends: Sequence[End],
        poses: Mapping[str, Pose],
        twists: Mapping[str, Array],
        slots: Mapping[str, int],
    ):
        rotation = np.stack([poses[end.link].rotation for end in ends])
        position = np.stack([poses[end.link].position for end in ends])
        twist = np.stack([twists[end.link] for end in ends])
        self.slots = [slots.get(end.link) for end in ends]
        self.arm = (rotation @ np.array([end.point for end in ends])[:, None, :, None])[..., 0]
        self.point = position + self.arm
        self.frame = rotation @ np.array([end.frame for end in ends])[:, None]  # (j, n, 3, 3)
        self.velocity, self.spin = twist[..., :3], twist[..., 3:]
        self.point_velocity = self.velocity + cross(self.spin, self.arm)
        self.point_bias = cross(self.spin, cross(self.spin, self.arm))

    def direction(self, column: int) -> tuple[Array, Array, Array]:
        """Return a frame direction, its rate and the velocity-product term of its second rate."""
        u = self.frame[..., column]
        rate = cross(self.spin, u)
        return u, rate, cross(self.spin, rate)


class Stack:
    """Collects equations of j joints of a kind at n poses."""

    def __init__(self, joints: int, n: int):
        self.shape = joints, n
        self.residual: list[Array] = []
        self.blocks: list[list[dict[int, Array]]] = []
        self.bias: list[Array] = []

    def _add(self, residual: Array, bias: Array, terms: list[tuple[Slots, Array, Array]]) -> None:
        rows: list[dict[int, Array]] = [{} for _ in range(self.shape[0])]
        for slots, linear, angular in terms:
            values = np.empty((*self.shape, 6), np.result_type(linear, angular))
            values[..., :3], values[..., 3:] = linear, angular
            for row, slot, own in zip(rows, slots, values, strict=True):
                if slot is not None:
                    row[slot] = row[slot] + own if slot in row else own
        self.residual.append(np.broadcast_to(residual, self.shape))
        self.blocks.append(rows)
        self.bias.append(np.broadcast_to(bias, self.shape))

    def coincide(self, a: Side, b: Side) -> None:
        """D = 0, three equations."""
        gap, bias = b.point - a.point, b.point_bias - a.point_bias
        across_a, across_b = skew(a.arm), -skew(b.arm)
        for i, unit in enumerate(np.eye(3)):
            terms = [(a.slots, -unit, across_a[..., i, :]), (b.slots, unit, across_b[..., i, :])]
            self._add(gap[..., i], bias[..., i], terms)

    def angle_between(self, a: Side, i: int, b: Side, j: int, cosine: Array | float) -> None:
        """U.V = cosine, with U column i of a's frame and V column j of b's."""
        u, u_rate, _ = a.direction(i)
        v, v_rate, _ = b.direction(j)
        across = cross(u, v)
        bias = dot(a.spin - b.spin, cross(u_rate, v) + cross(u, v_rate))
        zero = np.zeros(3)
        self._add(dot(u, v) - cosine, bias, [(a.slots, zero, across), (b.slots, zero, -across)])

    def no_gap_along(self, a: Side, i: int, b: Side) -> None:
        """U.D = 0, with U column i of a's frame."""
        motion = slide_motion(a, i, b)
        self._add(dot(a.frame[..., i], b.point - a.point), motion.bias, motion.terms)

    def distance(self, a: Side, b: Side, length: Array) -> None:
        """(D.D - length^2) / (2 length) = 0: the points have a distance (Nikravesh, 1988, eq. 7.13)."""
        gap, rate = (b.point - a.point) / length[..., None], b.point_velocity - a.point_velocity
        bias = dot(gap, b.point_bias - a.point_bias) + dot(rate, rate) / length
        terms = [(a.slots, -gap, -cross(a.arm, gap)), (b.slots, gap, cross(b.arm, gap))]
        self._add(0.5 * length * (dot(gap, gap) - 1.0), bias, terms)

    def weighted(self, residual: Array, bias: Array, terms: list[tuple[Array, CoordinateMotion]]) -> None:
        """Prescribe a weighted sum of joint coordinates, weights (n,) or scalar; residual in [rad] or [m]."""
        scaled = [
            (slots, weight[..., None] * linear, weight[..., None] * angular)
            for weight, moved in terms
            for slots, linear, angular in moved.terms
        ]
        total = bias + sum(weight * moved.bias for weight, moved in terms)
        self._add(residual, total, scaled)


@dataclass(frozen=True, slots=True)
class CoordinateMotion:
    """Dependence of a coordinate of j joints on the motion of the links.

    Attributes:
        rate: at the links' twists, (j, n) per second.
        bias: velocity-product term: its second rate at zero link accelerations, (j, n).
        terms: links' slots, and the coordinate's derivative by their velocities and angular velocities,
            (j, n, 3) each.
    """

    rate: Array
    bias: Array
    terms: list[tuple[Slots, Array, Array]]


def slide_motion(a: Side, column: int, b: Side) -> CoordinateMotion:
    """Return the motion of the gap between two sides along a direction of a's frame."""
    u, u_rate, u_bias = a.direction(column)
    gap, gap_rate = b.point - a.point, b.point_velocity - a.point_velocity
    bias = 2.0 * dot(u_rate, gap_rate) + dot(u_bias, gap) + dot(u, b.point_bias - a.point_bias)
    terms = [(a.slots, -u, cross(u, gap) - cross(a.arm, u)), (b.slots, u, cross(b.arm, u))]
    return CoordinateMotion(dot(u, gap_rate) + dot(u_rate, gap), bias, terms)


def coordinate_motion(joint: Joint, index: int, a: Side, b: Side) -> CoordinateMotion:
    """Return the motion of a joint coordinate, by its index in `Joint.coordinates`.

    Raises:
        InputError: for the angles of crossed axes, which no equation can couple or drive.
    """
    kind = KINDS[joint.kind]
    if index < len(kind.slides):
        return slide_motion(a, COLUMN[kind.slides[index]], b)
    if kind.crossed:
        raise InputError(
            f"coordinate {joint.coordinates[index]!r} of a {joint.kind} joint is coupled or driven, which is "
            "not supported; use two joints with one axis each instead"
        )
    axis = a.frame[..., 2]
    zero = np.zeros_like(axis)
    # the relative rotation is about the axis, to which a rate of the axis is perpendicular: no such term
    return CoordinateMotion(
        dot(axis, b.spin - a.spin), np.zeros(axis.shape[:-1]), [(a.slots, zero, -axis), (b.slots, zero, axis)]
    )


def add_joint_equations(stack: Stack, joints: Sequence[Joint], a: Side, b: Side) -> None:
    """Add the equations of joints of a kind: a length per force component, one per moment component."""
    kind = KINDS[joints[0].kind]
    if kind.rod:
        stack.distance(a, b, np.array([[joint.length] for joint in joints]))
    if not kind.slides:
        stack.coincide(a, b)
    else:
        for i in {0, 1, 2} - {COLUMN[axis] for axis in kind.slides}:
            stack.no_gap_along(a, i, b)
    if kind.crossed:
        stack.angle_between(a, 2, b, 2, np.cos(np.array([[joint.cross_angle] for joint in joints])))
    elif kind.aligned:
        stack.angle_between(a, 0, b, 2, 0.0)
        stack.angle_between(a, 1, b, 2, 0.0)
        if not kind.turns:
            stack.angle_between(a, 0, b, 1, 0.0)


Poses = Mapping[str, Pose]
# crank angle, or driver -> value; None for free drivers
Angles = ArrayLike | Mapping[str, ArrayLike] | None


def equations(
    mechanism: Mechanism,
    poses: Poses,
    angle: Angles,
    twists: Mapping[str, Array] | None = None,
) -> Rows:
    """Return the loop equations of a mechanism, linearised about n sets of poses.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses.
        angle: prescribed crank angle, scalar or (n,) in [rad], or driver -> value; drivers without a value
            keep theirs. None omits the equations of drivers.
        twists: moving link -> (n, 6) velocity of the origin and angular velocity, which determine
            the bias; None means at rest.

    Returns:
        Equations in the order of joints, couplings (`Mechanism.laws`), locked coordinates and drivers.
        Residuals in [m], [rad] or cosines of angles.
    """
    slots = {link.name: i for i, link in enumerate(mechanism.links)}
    n = next(iter(poses.values())).position.shape[0]
    at_rest = np.zeros((n, 6))
    ground = Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))
    placed = {GROUND: ground, **poses}
    moving = {GROUND: at_rest, **(dict.fromkeys(poses, at_rest) if twists is None else twists)}

    def sides(joints: Sequence[Joint]) -> tuple[Side, Side]:
        a, b = ([joint.a for joint in joints], [joint.b for joint in joints])
        return Side(a, placed, moving, slots), Side(b, placed, moving, slots)

    added = _joint_equations(mechanism.joints, sides, n)
    stack = Stack(1, n)
    joint_of = {name: (joint, i) for joint in mechanism.joints for i, name in enumerate(joint.coordinates)}

    def value(name: str) -> Array:
        joint, i = joint_of[name]
        return joint_coordinate(joint, placed[joint.a.link], placed[joint.b.link])[..., i]

    def motion(name: str) -> CoordinateMotion:
        joint, i = joint_of[name]
        return coordinate_motion(joint, i, *sides([joint]))

    prescribed = _prescribed(mechanism, angle)

    def multi_turn_value(name: str) -> Array:
        """Return the value of a driver or of the guess with its revolutions, for any ratio."""
        current, target = value(name), prescribed.get(name)
        if target is None and name not in mechanism.drivers:
            target = mechanism.guess_coordinates.get(name)
        if target is None or mechanism.unit(name) == "m":
            return current
        return np.asarray(target) + wrapped(current - np.asarray(target))

    for law in mechanism.laws:
        # left - zeros[0] - p(right - zeros[1]) = 0; its velocity-product term is -p'' times the square of the
        # rate of the right side
        left, right = (
            sum((weight * multi_turn_value(name) for name, weight in terms.items()), np.zeros(n))
            for terms in (law.left_terms, law.right_terms)
        )
        current, derivative, second_derivative = law.polynomial(right)
        residual = left - law.zeros[0] - current
        angular = all(mechanism.unit(name) == "rad" for name in law.left_terms)
        left_terms = [(np.full(n, weight), motion(name)) for name, weight in law.left_terms.items()]
        right_terms = [(-weight * derivative, motion(name)) for name, weight in law.right_terms.items()]
        rate = sum((weight * motion(name).rate for name, weight in law.right_terms.items()), np.zeros(n))
        stack.weighted(
            wrapped(residual) if angular else residual,
            -second_derivative * rate**2,
            [*left_terms, *right_terms],
        )
    for name, target in (*mechanism.locked.items(), *prescribed.items()):
        gap = np.zeros(n) if target is None else value(name) - np.asarray(target)
        stack.weighted(
            gap if mechanism.unit(name) == "m" else wrapped(gap), np.zeros(n), [(np.ones(n), motion(name))]
        )
    collected = [added[joint.name] for joint in mechanism.joints] + [(stack, 0)]
    residual, bias = (
        np.stack([row[i] for each, i in collected for row in rows_of(each)], 1)
        for rows_of in (attrgetter("residual"), attrgetter("bias"))
    )
    blocks = tuple(rows[i] for each, i in collected for rows in each.blocks)
    return Rows(residual, blocks, bias, len(slots))


def _joint_equations(
    joints: Sequence[Joint], sides: Callable[[Sequence[Joint]], tuple[Side, Side]], n: int
) -> dict[str, tuple[Stack, int]]:
    """Return joint -> its equations: those of all joints of its kind, and its number among them."""
    kinds: dict[str, list[Joint]] = {}
    for joint in joints:
        kinds.setdefault(joint.kind, []).append(joint)
    added: dict[str, tuple[Stack, int]] = {}
    for of_kind in kinds.values():
        stack = Stack(len(of_kind), n)
        add_joint_equations(stack, of_kind, *sides(of_kind))
        added |= {joint.name: (stack, i) for i, joint in enumerate(of_kind)}
    return added


def _prescribed(mechanism: Mechanism, angle: Angles) -> dict[str, ArrayLike | None]:
    """Return the prescribed motion of each driver; None for an unchanged one."""
    if angle is None:
        return {}
    if isinstance(angle, Mapping):
        return {name: angle[name] for name in mechanism.drivers}
    return dict.fromkeys(mechanism.drivers, angle if mechanism.has_crank else None)


def length_rows(mechanism: Mechanism, count: int) -> NDArray[np.bool_]:
    """Return for the first `count` equations of a mechanism whether their residual is a length, (count,)."""
    kinds = [KINDS[joint.kind] for joint in mechanism.joints]
    of_joints = [length for kind in kinds for length in [True] * kind.forces + [False] * kind.moments]
    firsts = [next(iter(law.left_terms)) for law in mechanism.laws]
    named = (*firsts, *mechanism.locked, *mechanism.drivers)
    return np.array([*of_joints, *(mechanism.unit(name) == "m" for name in named)][:count], dtype=np.bool_)


def row_units(mechanism: Mechanism, count: int) -> Array:
    """Return factors that make the first `count` equations of a mechanism dimensionless, (count,)."""
    return np.where(length_rows(mechanism, count), 1.0 / mechanism.characteristic_length, 1.0)


def residual_norms(mechanism: Mechanism, poses: Poses, angle: Angles) -> tuple[Array, Array]:
    """Return the loop-closure errors at each pose: (n,) in [m] and (n,) in [rad]."""
    rows = np.abs(equations(mechanism, poses, angle).residual)
    long = length_rows(mechanism, rows.shape[1])
    return rows[:, long].max(1, initial=0.0), rows[:, ~long].max(1, initial=0.0)
