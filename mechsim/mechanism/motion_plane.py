"""The plane of motion of a planar mechanism: its normal in the frame of each link."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from mechsim.mechanism.joint_kinds import COLUMN, KINDS, Kind
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
    if not all(end.link in normals and KINDS[joint.kind].aligned for joint, end in ends):
        return None
    # a joint rotates about the normals of both links and slides perpendicular to them
    frames, own = np.array([end.frame for _, end in ends]), np.array([normals[end.link] for _, end in ends])
    components = np.abs(np.einsum("eij,ei->ej", frames, own))
    across = np.array([_across(KINDS[joint.kind]) for joint, _ in ends])
    return normals if not components[across].max(initial=0.0) > PARALLEL_TOLERANCE else None


@cache
def _across(kind: Kind) -> tuple[bool, ...]:
    """Return which columns of a joint's frame are perpendicular to the normal, (3,)."""
    columns = {*(COLUMN[axis] for axis in kind.slides), *((0, 1) if kind.turns else ())}
    return tuple(i in columns for i in range(3))
