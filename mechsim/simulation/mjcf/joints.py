"""A joint in a MuJoCo model: the hinges and slides it is made of, and the points that close it when cut.

Each coordinate of a joint is a hinge or a slide of its own; only a ball is one joint without coordinates.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.model.joints import COLUMN, KINDS, Axis, Kind, KindName, displaced
from mechsim.model.mechanism import End, Joint, Mechanism, Pose, joint_coordinate

CRANK = "crank"
# the kind by which a link is joined to what stands in for it
FIXED: KindName = "fixed"


@dataclass(frozen=True, slots=True)
class Branch:
    """One joint of the tree, from a link already placed to the next.

    Attributes:
        joint: the joint.
        parent: its end on the placed link.
        child: its end on the next.
        sense: +1 if the joint's own order is parent to child, else -1.
    """

    joint: Joint
    parent: End
    child: End
    sense: int


def part_names(mechanism: Mechanism, joint: Joint) -> list[str]:
    """Return the names of the model's joints that make up a joint, in the order of its coordinates."""
    if mechanism.has_crank and joint.name == mechanism.crank.name:
        return [CRANK]
    return [joint.name] if KINDS[joint.kind].ball else list(joint.coordinates)


def model_names(mechanism: Mechanism) -> dict[str, str]:
    """Return coordinate of a mechanism -> the name of its hinge or slide in the model."""
    return {
        coordinate: name
        for joint in mechanism.joints
        for coordinate, name in zip(joint.coordinates, part_names(mechanism, joint), strict=False)
    }


def meeting_points(kind: Kind) -> list[float] | None:
    """Return heights along the axis at which points of both links meet in a joint, and by that hold it.

    A joint can be cut where they do: MuJoCo has an equality that closes it exactly, point on point. None
    if no points say what the joint says.
    """
    if kind.slides:
        return None
    return [0.0] if kind.ball else [0.0, 1.0] if kind.hinge else None


def zero_pose(branch: Branch) -> tuple[Pose, tuple[float, ...]]:
    """Return the child's pose in the parent's frame with the coordinates of the joint at zero, and those."""
    values = (0.0,) * len(KINDS[branch.joint.kind].units)
    return _posed(branch, values), values


def seated_pose(branch: Branch, parent: Pose, child: Pose) -> tuple[Pose, tuple[float, ...]]:
    """Return the child's pose in the parent's frame nearest to two rough poses, and its joint coordinates.

    The joint is kept exactly: only its free coordinates are taken from the rough poses.
    """
    a, b = (parent, child) if branch.sense > 0 else (child, parent)
    values = tuple(float(value) for value in joint_coordinate(branch.joint, a, b))
    if KINDS[branch.joint.kind].ball:
        rotation = parent.rotation.T @ child.rotation
        if values:
            return Pose(parent.rotation.T @ (child.position - parent.position), rotation), ()
        return Pose(np.asarray(branch.parent.point) - rotation @ np.asarray(branch.child.point), rotation), ()
    return _posed(branch, values), values


def _posed(branch: Branch, values: tuple[float, ...]) -> Pose:
    """Return the child's pose in the parent's frame at coordinates of the joint."""
    joint, frame = branch.joint, branch.parent.frame
    shift, turn = displaced(KINDS[joint.kind], values, joint.cross_angle)
    if branch.sense < 0:
        shift, turn = -turn.T @ shift, turn.T
    rotation = frame @ turn @ branch.child.frame.T
    place = np.asarray(branch.parent.point) + frame @ shift - rotation @ np.asarray(branch.child.point)
    return Pose(place, rotation)


def add_joint(
    body: mujoco.MjsBody, mechanism: Mechanism, branch: Branch, local: Pose, values: tuple[float, ...]
) -> None:
    """Add a tree joint to its child body; `ref` makes MuJoCo's coordinates those of the mechanism.

    Args:
        body: of the child.
        mechanism: whose joint it is.
        branch: the joint.
        local: the child's pose in the parent's frame, in the model's reference configuration.
        values: the joint's coordinates there.
    """
    joint, at = branch.joint, branch.child.point
    kind, names = KINDS[joint.kind], part_names(mechanism, joint)
    if kind.ball and kind.slides:
        body.add_freejoint(name=names[0])
        return
    if kind.ball:
        body.add_joint(name=names[0], type=mujoco.mjtJoint.mjJNT_BALL, pos=at)
        return
    types = [mujoco.mjtJoint.mjJNT_SLIDE] * len(kind.slides) + [mujoco.mjtJoint.mjJNT_HINGE] * len(kind.turns)
    axes: list[Axis] = [*kind.slides, *kind.turns]
    parts = list(zip(names, types, axes, values, strict=True))
    if branch.sense < 0 and len(set(axes)) > 1:
        # an axis fixed in the parent comes first, one fixed in the child last
        parts.reverse()
    across = len(kind.slides) > 1 and branch.sense < 0
    if across:
        # a turn that comes before slides across it is about the parent's point
        at = local.rotation.T @ (np.asarray(branch.parent.point) - local.position)
    for name, made, axis, value in parts:
        body.add_joint(name=name, type=made, pos=at, axis=_axis_of(branch, local, axis), ref=value)


def _axis_of(branch: Branch, local: Pose, axis: Axis) -> np.ndarray:
    """Return an axis of a joint in the child's frame, in the direction in which the child moves along it."""
    child_is_b = branch.sense > 0
    shared = axis == "a" and KINDS[branch.joint.kind].aligned
    if shared or (axis == "b") == child_is_b:
        return branch.sense * branch.child.frame[:, COLUMN[axis]]
    return branch.sense * (local.rotation.T @ branch.parent.frame[:, COLUMN[axis]])
