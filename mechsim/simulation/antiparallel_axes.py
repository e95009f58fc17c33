"""Rejects assemblies in which MuJoCo satisfies a joint's constraints with antiparallel axes."""

from collections.abc import Mapping

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS, opposed
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism


def require_aligned(mechanism: Mechanism, poses: Mapping[str, Pose]) -> None:
    """Reject a mechanism assembled with antiparallel axes of a joint; point constraints allow that.

    Args:
        mechanism: the mechanism.
        poses: moving link -> its pose.

    Raises:
        AssemblyError: naming the joint.
    """
    everywhere = {GROUND: IDENTITY, **poses}
    for joint in mechanism.joints:
        for i in KINDS[joint.kind].alike:
            a, b = (everywhere[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b))
            if not float(np.dot(a, b)) > 0.0:
                raise AssemblyError(f"{mechanism.name}: {opposed(joint.name, i)}")
