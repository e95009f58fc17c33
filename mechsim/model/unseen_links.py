"""Where a motion's links are, with those between several joints of one body: their joints say it."""

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS, displaced
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion


def moved_links(mechanism: Mechanism, motion: Motion) -> dict[str, Pose]:
    """Return the poses of all links but ground at the n instants of a motion.

    Raises:
        InputError: where the motion lacks a link that stands for a body.
    """
    found = {GROUND: Pose(np.zeros(3), np.eye(3))}
    for link in mechanism.links:
        if link.name in motion.links:
            moved = motion.links[link.name]
            found[link.name] = Pose(moved.position, moved.rotation)
        elif link.seen:
            raise InputError(
                f"the motion does not say where link {link.name!r} is, so it cannot be drawn; "
                "solve it with links"
            )
        else:
            found[link.name] = _hung(mechanism, link.name, found, motion)
    del found[GROUND]
    return found


def _hung(mechanism: Mechanism, name: str, poses: dict[str, Pose], motion: Motion) -> Pose:
    """Return where a link stands that hangs on another by a joint of one coordinate."""
    joint = next(one for one in mechanism.joints if one.b.link == name)
    near, value = poses[joint.a.link], motion.joints[joint.name].value
    shift, turn = displaced(KINDS[joint.kind], (value,), joint.cross_angle)
    frame = near.rotation @ joint.a.frame
    rotation = np.broadcast_to(frame @ turn @ joint.b.frame.T, (len(value), 3, 3))
    place = near.point(joint.a.point) + (frame @ shift[..., None])[..., 0]
    return Pose(place - rotation @ joint.b.point, rotation)
