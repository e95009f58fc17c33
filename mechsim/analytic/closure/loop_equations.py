"""The loop equations of a mechanism at given poses, and how far they are from closed."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.joint_rows import Rows, Side, Stack, add_joint, is_length
from mechsim.analytic.vector_method.rotations import wrap
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import GROUND, Joint, Mechanism, Pose, joint_coordinate

Poses = Mapping[str, Pose]


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

    def side(joint: Joint, which: str) -> Side:
        end = getattr(joint, which)
        if end.link == GROUND:
            return Side(ground, at_rest, end.point, end.frame, None)
        twist = at_rest if twists is None else twists[end.link]
        return Side(poses[end.link], twist, end.point, end.frame, names.index(end.link))

    def pose(link: str) -> Pose:
        return ground if link == GROUND else poses[link]

    stack = Stack(len(names), n)
    for joint in mechanism.joints:
        add_joint(stack, joint, side(joint, "a"), side(joint, "b"))

    def coordinate(joint: Joint) -> Array:
        return joint_coordinate(joint, pose(joint.a.link), pose(joint.b.link))[..., 0]

    driver = mechanism.crank
    for gear in mechanism.gears:
        first, second = mechanism.joint(gear.driver), mechanism.joint(gear.driven)
        # the crank's own angle counts its turns, so that a ratio that is no whole number works
        turned = coordinate(first)
        if first.name == driver.name and angle is not None:
            turned = np.asarray(angle) + wrap(turned - np.asarray(angle))
        gap = coordinate(second) - gear.ratio * turned - gear.phase
        turns = [(1.0, side(second, "a"), side(second, "b"))]
        turns.append((-gear.ratio, side(first, "a"), side(first, "b")))
        stack.turned(gap, turns)
    if angle is not None:
        gap = coordinate(driver) - np.asarray(angle)
        stack.turned(gap, [(1.0, side(driver, "a"), side(driver, "b"))])
    return stack.rows()


def scaled(mechanism: Mechanism, jacobian: Array) -> Array:
    """Make a Jacobian free of units: lengths in units of the mechanism's size."""
    size = mechanism.size
    columns = np.tile([size] * 3 + [1.0] * 3, len(mechanism.links))
    scaled = jacobian * columns
    rows = np.ones(jacobian.shape[1])
    lengths = [length for joint in mechanism.joints for length in is_length(joint)]
    rows[: len(lengths)] = np.where(lengths, 1.0 / size, 1.0)
    return scaled * rows[:, None]


def residual_norms(mechanism: Mechanism, poses: Poses, angle: ArrayLike) -> tuple[Array, Array]:
    """Return how far the loops stand open at each pose: (n,) in [m] and (n,) in [rad]."""
    rows = np.abs(equations(mechanism, poses, angle).residual)
    kinds = [length for joint in mechanism.joints for length in is_length(joint)]
    lengths = np.array(kinds + [False] * (rows.shape[1] - len(kinds)))
    return rows[:, lengths].max(1, initial=0.0), rows[:, ~lengths].max(1, initial=0.0)
