"""The plane of motion of a planar mechanism: its normal in the frame of each link."""

from collections.abc import Sequence

import numpy as np

from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# directions count as parallel below this: frames are accurate to 1e-16, real tilts are far larger
PARALLEL_TOLERANCE = 1e-9


def plane_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None for a spatial mechanism.

    A mechanism is planar if all joints rotate about one direction and slide perpendicular to it at any
    coordinates. This follows from the description, without solving. Points of a link need not lie in one
    plane.

    Args:
        mechanism: the mechanism.

    Returns:
        Link ("ground" included) -> unit vector, (3,): along the axis of the first hinge, a driven one if
        possible, transferred along the joints.
    """
    joints = [*mechanism.driven_joints, *mechanism.joints]
    hinge = next((joint for joint in joints if KINDS[joint.kind].hinge), joints[0])
    return _normals(hinge.a, mechanism, mechanism.joints)


def hinged_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return normals as `plane_normals`, also with sliding drivers or spherical joints that close loops.

    Spherical and universal joints cannot move links out of a plane in which hinges and slides keep them.
    """
    aligned = [joint for joint in mechanism.joints if KINDS[joint.kind].aligned]
    hinges = [joint.a for joint in (*mechanism.driven_joints, *aligned) if KINDS[joint.kind].hinge]
    normals = (_normals(hinges[0], mechanism, aligned) if hinges else None) or {}
    return normals if normals.keys() >= {*mechanism.link_names} else None


def _normals(hinge: End, mechanism: Mechanism, joints: Sequence[Joint]) -> dict[str, Array] | None:
    normals, count = {hinge.link: np.asarray(hinge.axis)}, 0
    while count < len(normals):
        count = len(normals)
        for joint in joints:
            for start, other in ((joint.a, joint.b), (joint.b, joint.a)):
                if start.link in normals and other.link not in normals:
                    # a joint that rotates about the normal has it in the same direction of both joint frames
                    normals[other.link] = other.frame @ start.frame.T @ normals[start.link]
    ends = [(joint, end) for joint in joints for end in (joint.a, joint.b)]
    planar = all(
        end.link in normals and _stays_in_plane(joint, end, normals[end.link]) for joint, end in ends
    )
    return normals if planar else None


def _stays_in_plane(joint: Joint, end: End, normal: Array) -> bool:
    """Whether a joint rotates about a normal of one of its links and slides perpendicular to it."""
    kind = KINDS[joint.kind]
    if not kind.aligned:
        return False
    components = end.frame.T @ normal
    across = [abs(components[COLUMN[axis]]) for axis in kind.slides]
    if kind.turns:
        across += [abs(components[0]), abs(components[1])]
    return max(across, default=0.0) <= PARALLEL_TOLERANCE
