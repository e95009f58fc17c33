"""Which kind of joint each joint and each equality constraint between bodies is."""

import mujoco

from mechsim.model.joint_kinds import KindName

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
# those whose one coordinate can be prescribed
DRIVABLE = (HINGE, SLIDE)

OF_JOINT: dict[int, KindName] = {
    HINGE: "revolute",
    SLIDE: "prismatic",
    BALL: "spherical",
    FREE: "floating",
}
# points meet; points and frames meet
POINTS: KindName = "spherical"
FRAMES: KindName = "fixed"
