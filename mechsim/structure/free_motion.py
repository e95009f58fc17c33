"""Freedoms left once the crank is held: which links move, and about what."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.closure import equations
from mechsim.mechanism import GROUND, End, Joint, Mechanism, Pose

Array = NDArray[np.float64]

# parts of a null vector below this are rounding: singular vectors come to about 1e-16 over the gap
# of RANK_TOLERANCE between zero and nonzero singular values
NOTHING = 1e-6


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A freedom that the crank does not take.

    Attributes:
        links: what moves.
        idle: whether it changes nothing wanted: no tracked point and no link on the frame moves.
        text: what moves how, in words.
    """

    links: tuple[str, ...]
    idle: bool
    text: str

    def __str__(self) -> str:
        return f"{'idle freedom' if self.idle else 'freedom not driven'}: {self.text}"


@dataclass(frozen=True, slots=True)
class _Twist:
    """Velocity of the point at the ground's origin, (3,) in [m/s], and angular velocity, (3,) in [rad/s]."""

    velocity: Array
    spin: Array

    def at(self, point: Array) -> Array:
        return self.velocity + np.cross(self.spin, point)


def free_motions(mechanism: Mechanism, poses: Mapping[str, Pose], count: int) -> tuple[FreeMotion, ...]:
    """Name the freedoms left with the crank held.

    The null space of the loop Jacobian is split so that each freedom moves as few links as it can.

    Args:
        mechanism: the mechanism.
        poses: moving link -> one pose that closes the loops, arrays with a leading axis of length 1.
        count: how many such freedoms there are (`closure.Freedom.passive`).
    """
    if count == 0:
        return ()
    names = [link.name for link in mechanism.links]
    size = mechanism.size
    columns = np.tile([size] * 3 + [1.0] * 3, len(names))
    jacobian = equations(mechanism, poses, 0.0).jacobian[0] * columns
    jacobian /= np.linalg.norm(jacobian, axis=1, keepdims=True)
    space = np.linalg.svd(jacobian)[2][-count:].T  # (6 links, count)
    found: list[FreeMotion] = []
    for vector in _localised(space, len(names)):
        parts = vector.reshape(-1, 6)
        moving = np.linalg.norm(parts, axis=1) > NOTHING * np.linalg.norm(parts)
        twists: dict[str, _Twist] = {}
        for name, part in zip(names, parts, strict=True):
            if moving[names.index(name)]:
                shift = np.asarray(np.cross(part[3:], poses[name].position[0]), dtype=np.float64)
                twists[name] = _Twist(size * part[:3] - shift, part[3:])
        found.append(_named(mechanism, poses, twists))
    return tuple(found)


def _localised(space: Array, links: int) -> Iterable[Array]:
    """Yield a basis of a space of twists, (6 links, k), whose vectors move few links each."""
    known = np.zeros((space.shape[1], 0))
    for count in range(1, links + 1):
        for chosen in combinations(range(links), count):
            outside = np.ones(links, dtype=bool)
            outside[list(chosen)] = False
            rows = space[np.repeat(outside, 6)]
            inside = _null_space(np.vstack([rows, known.T]))
            for i in range(inside.shape[1]):
                known = np.column_stack([known, inside[:, i]])
                yield space @ inside[:, i]
            if known.shape[1] == space.shape[1]:
                return


def _null_space(matrix: Array) -> Array:
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix)
    return right[int((values > NOTHING).sum()) :].T


def _named(mechanism: Mechanism, poses: Mapping[str, Pose], twists: Mapping[str, _Twist]) -> FreeMotion:
    on_frame = {end.link for joint in _joints_of(mechanism, {GROUND}) for end in (joint.a, joint.b)}
    still = NOTHING * mechanism.size
    moved = [
        point
        for point, (link, local) in mechanism.points.items()
        if link in twists and np.linalg.norm(twists[link].at(poses[link].point(local)[0])) > still
    ]
    bodies = _rigid_bodies(twists, mechanism.size)
    said = [(body, _motion(mechanism, poses, body, twists[body[0]])) for body in bodies]
    words = [f"{' and '.join(body)} {motion}" for body, motion in said if motion]
    others = [link for body, motion in said if not motion for link in body]
    if others:
        # a motion that no joint names goes with the ones that can be named, if there are any
        words.append(
            f"{', '.join(others)} {'moves' if len(others) == 1 else 'move'}{' with them' * bool(words)}"
        )
    if moved:
        words.append(
            f"tracked {', '.join(moved)} with them" if len(twists) > 1 else f"and with it {', '.join(moved)}"
        )
    return FreeMotion(tuple(twists), not moved and not on_frame & set(twists), ", ".join(words))


def _rigid_bodies(twists: Mapping[str, _Twist], size: float) -> list[tuple[str, ...]]:
    """Put links together that move as one."""
    bodies: list[list[str]] = []
    for name, twist in twists.items():
        for body in bodies:
            first = twists[body[0]]
            gap = np.concatenate([(twist.velocity - first.velocity) / size, twist.spin - first.spin])
            if np.linalg.norm(gap) <= NOTHING:
                body.append(name)
                break
        else:
            bodies.append([name])
    return [tuple(body) for body in bodies]


def _motion(
    mechanism: Mechanism, poses: Mapping[str, Pose], body: tuple[str, ...], twist: _Twist
) -> str | None:
    """Say about or along which joints a body moves; None if no joint tells."""
    size = mechanism.size
    ends = [
        (joint, end)
        for joint in _joints_of(mechanism, set(body))
        for end in (joint.a, joint.b)
        if end.link in body
    ]
    places = {joint.name: poses[end.link].point(end.point)[0] for joint, end in ends}
    speed = float(np.linalg.norm(twist.spin))
    if speed <= NOTHING:
        along = _along(poses, ends, twist.velocity, ("prismatic", "cylindrical"))
        return f"slides along the axis of joint {along[0]}" if along else None
    direction = twist.spin / speed
    pitch = float(twist.velocity @ direction) / speed
    verb = "spins" if abs(pitch) <= NOTHING * size else "screws"
    foot = np.cross(direction, twist.velocity) / speed
    on_axis = [
        name
        for name, place in places.items()
        if np.linalg.norm(np.cross(place - foot, direction)) <= NOTHING * size
    ]
    along = _along(poses, ends, direction, ("revolute", "cylindrical", "universal"))
    for name in along:
        if name in on_axis:
            return f"{verb} about the axis of joint {name}"
    for first, second in combinations(on_axis, 2):
        if np.linalg.norm(places[first] - places[second]) > NOTHING * size:
            return f"{verb} about the line through {first} and {second}"
    if on_axis:
        return f"{verb} about a line through {on_axis[0]} along ({', '.join(f'{x:.3g}' for x in direction)})"
    return None


def _along(
    poses: Mapping[str, Pose], ends: list[tuple[Joint, End]], direction: Array, kinds: tuple[str, ...]
) -> list[str]:
    """Return the joints of some kinds whose axes lie along a direction."""
    unit = direction / np.linalg.norm(direction)
    return [
        joint.name
        for joint, end in ends
        if joint.kind in kinds
        and np.linalg.norm(np.cross(poses[end.link].rotation[0] @ np.asarray(end.axis), unit)) <= NOTHING
    ]


def _joints_of(mechanism: Mechanism, links: set[str]) -> list[Joint]:
    """Return the joints between some links and the rest."""
    return [joint for joint in mechanism.joints if (joint.a.link in links) != (joint.b.link in links)]
