"""The coordinates of joints and their rates, read from how the two links move that a joint joins."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.joints import COLUMN, KINDS, coordinates
from mechsim.model.mechanism import GROUND, Joint, Mechanism
from mechsim.model.motion import JointMotion, LinkMotion, Motion


def with_all_joints(mechanism: Mechanism, motion: Motion) -> Motion:
    """Return a motion that tells every coordinate, also of joints at which the loops of a model are cut.

    Args:
        mechanism: that moves.
        motion: of it, with its links; joints that it tells stay as they are.

    Accuracy: that of the links; angles are counted on from (-pi, pi] at the first instant.
    """
    n = len(motion)
    still = np.zeros((n, 3))
    frame = LinkMotion(still, np.broadcast_to(np.eye(3), (n, 3, 3)), still, still, still, still)
    links = {GROUND: frame, **motion.links}
    joints: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        told = [motion.joints.get(name) for name in joint.coordinates]
        known = joint.a.link in links and joint.b.link in links
        if known and any(one is None for one in told):
            told = list(_moved(joint, links[joint.a.link], links[joint.b.link], motion.time))
        joints |= {name: one for name, one in zip(joint.coordinates, told, strict=True) if one is not None}
    return replace(motion, joints=joints | {k: v for k, v in motion.joints.items() if k not in joints})


def _moved(joint: Joint, a: LinkMotion, b: LinkMotion, time: Array | None) -> Iterator[JointMotion]:
    """Yield the motion of each coordinate of a joint."""
    kind = KINDS[joint.kind]
    frame_a, frame_b = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame
    arms = _turned(a.rotation, joint.a.point), _turned(b.rotation, joint.b.point)
    gap = b.position + arms[1] - a.position - arms[0]
    value = coordinates(kind, gap, frame_a, frame_b, joint.cross_angle)
    speed, bend = _relative(a, b, gap, *arms) if kind.slides else (gap, gap)
    axes = [frame_a[..., COLUMN[axis]] for axis in kind.slides]
    rates = [((speed * axis).sum(-1), (bend * axis).sum(-1)) for axis in axes]
    if not kind.ball:
        rates += _turns(kind.crossed, a, b, frame_a[..., 2], frame_b[..., 2]) if kind.turns else []
    several = len(kind.units) > 1
    for i, (unit, (rate, acceleration)) in enumerate(zip(kind.units, rates, strict=True)):
        whole = _counted(value[:, i], rate, time) if unit == "rad" else value[:, i]
        yield JointMotion(whole, rate, acceleration, unit, i if several else None)


def _relative(a: LinkMotion, b: LinkMotion, gap: Array, arm_a: Array, arm_b: Array) -> tuple[Array, Array]:
    """Return the rates of the gap as a sees it, first and second."""
    spin = a.angular_velocity
    speed = b.velocity + np.cross(b.angular_velocity, arm_b) - a.velocity - np.cross(spin, arm_a)
    bend = [
        link.acceleration
        + np.cross(link.angular_acceleration, arm)
        + np.cross(link.angular_velocity, np.cross(link.angular_velocity, arm))
        for link, arm in ((a, arm_a), (b, arm_b))
    ]
    seen = speed - np.cross(spin, gap)
    carried = np.cross(a.angular_acceleration, gap) + np.cross(spin, np.cross(spin, gap))
    return seen, bend[1] - bend[0] - carried - 2.0 * np.cross(spin, seen)


def _turns(
    crossed: bool, a: LinkMotion, b: LinkMotion, axis_a: Array, axis_b: Array
) -> list[tuple[Array, Array]]:
    """Return first and second rates of the angle about a's axis, and about b's where the two cross."""
    spin, swing = b.angular_velocity - a.angular_velocity, b.angular_acceleration - a.angular_acceleration
    if not crossed:
        return [((spin * axis_a).sum(-1), (swing * axis_a).sum(-1))]
    axes = np.stack([axis_a, axis_b], -1)  # (n, 3, 2)
    across = np.swapaxes(axes, -1, -2)

    def parts(of: Array) -> Array:
        found = np.linalg.solve(across @ axes, across @ of[..., None])[..., 0]
        return found.astype(np.float64, copy=False)

    rates = parts(spin)
    turning = np.cross(a.angular_velocity, axis_a) * rates[:, :1]
    turning = turning + np.cross(b.angular_velocity, axis_b) * rates[:, 1:]
    seconds = parts(swing - turning)
    return [(rates[:, i], seconds[:, i]) for i in range(2)]


def _counted(angle: Array, rate: Array, time: Array | None) -> Array:
    """Return angles with their turns: each lies nearest to where the one before led at its speed."""
    ahead = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time) if time is not None else np.zeros(len(angle) - 1)
    step = np.diff(angle)
    step = step + TURN * np.round((ahead - step) / TURN)
    return angle[:1].repeat(len(angle)) + np.concatenate([[0.0], np.cumsum(step)])


def _turned(rotation: Array, local: tuple[float, float, float]) -> Array:
    return rotation @ np.asarray(local)
