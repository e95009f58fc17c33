"""The motion of a body at an instant, and its description by the joints it turns about."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mechsim.model.joint_kinds import KINDS, Axis, Kind
from mechsim.model.joints import End, Joint
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# parts of a null vector below this are rounding: singular vectors come to about 1e-16 over the gap
# of RANK_TOLERANCE between zero and nonzero singular values
NOTHING = 1e-6


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the point at the ground's origin, (3,) in [m/s], and angular velocity, (3,) in [rad/s]."""

    velocity: Array
    spin: Array

    def velocity_at(self, point: Array) -> Array:
        return self.velocity + np.cross(self.spin, point)


def motion_words(
    mechanism: Mechanism, poses: Mapping[str, Pose], body: tuple[str, ...], twist: Twist
) -> str | None:
    """Say about or along which joints a body moves; None if no joint tells."""
    length = mechanism.size
    ends = [
        (joint, end)
        for joint in joints_of(mechanism, set(body))
        for end in (joint.a, joint.b)
        if end.link in body
    ]
    positions = {joint.name: poses[end.link].point(end.point)[0] for joint, end in ends}
    speed = float(np.linalg.norm(twist.spin))
    if speed <= NOTHING:
        along = _along(poses, ends, twist.velocity, lambda kind: kind.slides)
        return f"slides along the axis of joint {along[0]}" if along else None
    direction = twist.spin / speed
    pitch = float(twist.velocity @ direction) / speed
    verb = "spins" if abs(pitch) <= NOTHING * length else "screws"
    foot = np.cross(direction, twist.velocity) / speed
    on_axis = [
        name
        for name, position in positions.items()
        if np.linalg.norm(np.cross(position - foot, direction)) <= NOTHING * length
    ]
    along = _along(poses, ends, direction, lambda kind: kind.turns)
    for name in along:
        if name in on_axis:
            return f"{verb} about the axis of joint {name}"
    for first, second in combinations(on_axis, 2):
        if np.linalg.norm(positions[first] - positions[second]) > NOTHING * length:
            return f"{verb} about the line through {first} and {second}"
    if on_axis:
        return f"{verb} about a line through {on_axis[0]} along ({', '.join(f'{x:.3g}' for x in direction)})"
    return None


def _along(
    poses: Mapping[str, Pose],
    ends: list[tuple[Joint, End]],
    direction: Array,
    axes: Callable[[Kind], tuple[Axis, ...]],
) -> list[str]:
    """Return the joints whose axis lies along a direction and is among some axes of their kind."""
    unit = direction / np.linalg.norm(direction)
    return [
        joint.name
        for joint, end in ends
        if "a" in axes(KINDS[joint.kind])
        and np.linalg.norm(np.cross(poses[end.link].rotation[0] @ np.asarray(end.axis), unit)) <= NOTHING
    ]


def joints_of(mechanism: Mechanism, links: set[str]) -> list[Joint]:
    """Return the joints between some links and the rest."""
    return [joint for joint in mechanism.joints if (joint.a.link in links) != (joint.b.link in links)]
