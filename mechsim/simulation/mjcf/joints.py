"""Joints in a MuJoCo model: their hinges and slides, and the points that coincide in a cut joint.

Each coordinate of a joint is a separate hinge or slide; a spherical joint has a ball, and a floating one too.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

import mujoco
import numpy as np

from mechsim.mechanism.actuators import NO_LIMIT, Range
from mechsim.mechanism.joint_kinds import COLUMN, KINDS, Axis, Kind, coordinates, displaced
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.limits import Ranges
from mechsim.mechanism.links import Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

BALL = mujoco.mjtJoint.mjJNT_BALL
SLIDE, HINGE = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
# name of the driver's hinge, and of a joint with this name that is not the driver
CRANK, PASSIVE_CRANK = "crank", "crank, no driver"
JOINT_TERM = mujoco.mjtWrap.mjWRAP_JOINT
# what a generated tendon of joints can have
TENDON_VALUES = ("armature", "frictionloss", "stiffness", "damping", "springlength")


@dataclass(frozen=True, slots=True)
class Branch:
    """One joint of the tree, from its parent link to its child.

    Attributes:
        joint: the joint.
        parent: its end on the parent link.
        child: its end on the child link.
        direction: +1 if link a is the parent, else -1.
    """

    joint: Joint
    parent: End
    child: End
    direction: int


def part_names(mechanism: Mechanism, joint: Joint) -> list[str]:
    """Return the names of the model's joints for a joint, in the order of its coordinates; a ball is last."""
    if mechanism.has_crank and joint.name == mechanism.crank.name:
        return [CRANK]
    names = [*joint.coordinates, joint.name] if KINDS[joint.kind].ball else list(joint.coordinates)
    return [PASSIVE_CRANK if mechanism.has_crank and name == CRANK else name for name in names]


def model_names(mechanism: Mechanism) -> dict[str, str]:
    """Return a map: coordinate of a mechanism -> name of its hinge or slide in the model."""
    return {
        coordinate: name
        for joint in mechanism.joints
        for coordinate, name in zip(joint.coordinates, part_names(mechanism, joint), strict=False)
    }


def rename_crank(spec: mujoco.MjSpec, name: str) -> None:
    """Give the crank of a generated model its own name, also in actuators, equalities and tendons."""
    own = {CRANK: name, PASSIVE_CRANK: CRANK}
    for tendon in list(spec.tendons):
        terms = [(wrap.target.name, wrap.coef) for wrap in tendon.path if wrap.type == JOINT_TERM]
        if own.keys() & dict(terms):
            # the terms of a tendon keep the name of their joint: another one takes its values
            renamed, label = spec.add_tendon(), tendon.name
            for key in TENDON_VALUES:
                setattr(renamed, key, getattr(tendon, key))
            spec.delete(tendon)
            renamed.name = label
            for joint, weight in terms:
                renamed.wrap_joint(own.get(joint, joint), weight)
    # the crank first, so that no two joints have one name
    for joint in sorted((joint for joint in spec.joints if joint.name in own), key=attrgetter("name")):
        joint.name = own[joint.name]
    for actuator in spec.actuators:
        actuator.target = own.get(actuator.target, actuator.target)
    for equality in spec.equalities:
        if equality.type == mujoco.mjtEq.mjEQ_JOINT:
            equality.name1, equality.name2 = (
                own.get(joint, joint) for joint in (equality.name1, equality.name2)
            )


def coincident_points(kind: Kind) -> list[float] | None:
    """Return heights along the axis at which coincident points of both links are equivalent to a joint.

    A joint with such points can be cut: MuJoCo equalities of points close it exactly. None for other kinds.
    """
    if kind.floating or kind.rod:
        return []
    if kind.slides:
        return None
    return [0.0] if kind.ball else [0.0, 1.0] if kind.hinge else None


def seated_pose(branch: Branch, parent: Pose, child: Pose | None) -> tuple[Pose, tuple[float, ...]]:
    """Return the child's pose in the parent's frame nearest to an initial guess, and its joint coordinates.

    The pose satisfies the joint exactly: only its free coordinates come from the approximate poses. Without a
    guess the coordinates are zero.
    """
    if child is None:
        return _posed(branch, branch.joint.unguessed), branch.joint.unguessed
    kind = KINDS[branch.joint.kind]
    sides = [
        (pose.point(end.point), pose.rotation @ end.frame)
        for end, pose in ((branch.parent, parent), (branch.child, child))
    ]
    a, b = sides if branch.direction > 0 else reversed(sides)
    values = tuple(coordinates(kind, b[0] - a[0], a[1], b[1], branch.joint.cross_angle).tolist())
    return _posed(branch, values, a[1].T @ b[1] if kind.ball else None), values


def _posed(branch: Branch, values: Sequence[float], ball: Array | None = None) -> Pose:
    """Return the child's pose in the parent's frame at the joint's coordinates and the rotation of a ball."""
    joint, frame = branch.joint, branch.parent.frame
    shift, relative = displaced(KINDS[joint.kind], values, joint.cross_angle)
    relative = relative if ball is None else ball
    if branch.direction < 0:
        relative = relative.T
        shift = -relative @ shift
    rotation = frame @ relative @ branch.child.frame.T
    parent_point, local = np.asarray(branch.parent.point), np.asarray(branch.child.point)
    return Pose(parent_point + frame @ shift - rotation @ local, rotation)


def add_joint(
    body: mujoco.MjsBody, mechanism: Mechanism, branch: Branch, local: Pose, values: tuple[float, ...]
) -> None:
    """Add the hinges and slides, or the ball, of a tree joint to its child body.

    `ref` makes MuJoCo's coordinates those of the mechanism.

    Args:
        body: the body of the child.
        mechanism: the mechanism that has the joint.
        branch: the joint.
        local: the child's pose in the parent's frame, in the model's reference configuration.
        values: the joint's coordinates in the reference configuration.
    """
    joint, position = branch.joint, np.asarray(branch.child.point)
    kind, names = KINDS[joint.kind], part_names(mechanism, joint)
    axes: list[Axis | None] = [*kind.slides, *((None,) if kind.ball else kind.turns)]
    types = [SLIDE] * len(kind.slides) + [BALL if kind.ball else HINGE] * (len(axes) - len(kind.slides))
    components = list(zip(names, axes, types, [*values, 0.0][: len(axes)], strict=True))
    if branch.direction < 0 and len(set(axes)) > 1:
        # axes fixed in the parent come first, axes fixed in the child last
        components.reverse()
    if branch.direction < 0 and (len(kind.slides) > 1 or kind.ball):
        # a rotation before slides across its axis is about the parent's point
        position = local.rotation.T @ (np.asarray(branch.parent.point) - local.position)
    for name, axis, made, value in components:
        if axis is None:
            body.add_joint(name=name, type=made, pos=position)
        else:
            body.add_joint(name=name, type=made, pos=position, axis=_axis_of(branch, local, axis), ref=value)


def _axis_of(branch: Branch, local: Pose, axis: Axis) -> Array:
    """Return an axis of a joint in the child's frame, in the direction of the child's motion."""
    child_is_b = branch.direction > 0
    shared = axis == "a" and KINDS[branch.joint.kind].aligned
    if shared or (axis == "b") == child_is_b:
        return branch.direction * branch.child.frame[:, COLUMN[axis]]
    return branch.direction * local.rotation.T @ branch.parent.frame[:, COLUMN[axis]]


# limit in place of an infinite one on one side
UNLIMITED = 1e30


def finite_limits(limits: Range) -> tuple[bool, Range]:
    """Return whether there are limits, and finite ones for MuJoCo."""
    return limits != NO_LIMIT, (max(limits[0], -UNLIMITED), min(limits[1], UNLIMITED))


def limit_joints(spec: mujoco.MjSpec, ranges: Ranges) -> list[str]:
    """Give the joints of a model their ranges; return the joints that it does not have, as cut ones."""
    present = {joint.name: joint for joint in spec.joints}
    for name in ranges.keys() & present.keys():
        _, present[name].range = finite_limits(ranges[name])
        present[name].limited = mujoco.mjtLimited.mjLIMITED_TRUE
    return [name for name in ranges if name not in present]
