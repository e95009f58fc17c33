"""Joints whose constraints MuJoCo meets with both sides' axes, or marks, against each other."""

from collections.abc import Mapping

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS, opposed
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism


def require_aligned(mechanism: Mechanism, poses: Mapping[str, Pose]) -> None:
    """Refuse a mechanism put together with sides of a joint opposed, as a point alone lets them be.

    Args:
        mechanism: the mechanism.
        poses: moving link -> one pose.

    Raises:
        AssemblyError: naming the joint.
    """
    everywhere = {GROUND: IDENTITY, **poses}
    for joint in mechanism.joints:
        for i in KINDS[joint.kind].alike:
            a, b = (everywhere[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b))
            if not float(np.dot(a, b)) > 0.0:
                raise AssemblyError(f"{mechanism.name}: {opposed(joint.name, i)}")
