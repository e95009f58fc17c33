"""Whether a mechanism is planar: the direction across which each link moves, from the description alone."""

from collections.abc import Sequence

import numpy as np

from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# directions this little out of parallel are parallel: frames are made to 1e-16, a real tilt is far larger
PARALLEL = 1e-9


def plane_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None for a spatial mechanism.

    Planar is a mechanism all of whose joints turn about one direction and slide across it, whatever
    their coordinates; nothing needs to be solved for that. Points of a link need not lie in one plane.

    Args:
        mechanism: the mechanism.

    Returns:
        Link, "ground" included -> unit vector, (3,): along the crank's axis, and as the joints from there
        carry it on.
    """
    return _normals(mechanism.driven_joints[0].a, mechanism, mechanism.joints)


def hinged_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return normals as `plane_normals` does, also where slides drive, or balls close loops.

    Balls and crosses cannot take out of the plane what hinges and slides hold there.
    """
    aligned = [joint for joint in mechanism.joints if KINDS[joint.kind].aligned]
    hinges = [joint.a for joint in (*mechanism.driven_joints, *aligned) if KINDS[joint.kind].hinge]
    normals = (_normals(hinges[0], mechanism, aligned) if hinges else None) or {}
    return normals if all(link.name in normals for link in mechanism.links) else None


def _normals(hinge: End, mechanism: Mechanism, joints: Sequence[Joint]) -> dict[str, Array] | None:
    normals = {hinge.link: np.asarray(hinge.axis)}
    for _ in mechanism.links:
        for joint in joints:
            for here, there in ((joint.a, joint.b), (joint.b, joint.a)):
                if here.link in normals and there.link not in normals:
                    # where a joint turns about the normal only, both joint frames see the normal alike
                    normals[there.link] = there.frame @ here.frame.T @ normals[here.link]
    for joint in joints:
        for end in (joint.a, joint.b):
            if end.link not in normals or not _stays_in_plane(joint, end, normals[end.link]):
                return None
    return normals


def _stays_in_plane(joint: Joint, end: End, normal: Array) -> bool:
    """Say whether a joint turns about a normal of one of its links and slides across it."""
    kind = KINDS[joint.kind]
    if not kind.aligned:
        return False
    seen = end.frame.T @ normal
    across = [abs(seen[COLUMN[axis]]) for axis in kind.slides]
    if kind.turns:
        across += [abs(seen[0]), abs(seen[1])]
    return max(across, default=0.0) <= PARALLEL
