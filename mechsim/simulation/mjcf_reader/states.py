"""A motion as coordinates of the model it was read from."""

import mujoco
import numpy as np

from mechsim.model.links import GROUND
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.joint_chains import kinematic_tree
from mechsim.simulation.mjcf_reader.joint_types import DRIVABLE, FREE
from mechsim.simulation.mjcf_reader.link_frames import link_name


def states_of(model: mujoco.MjModel, motion: Motion) -> Array:
    """Return the coordinates of a model in a motion of the mechanism read from it, (n, nq).

    Hinges and slides are as the motion has them; balls and free joints are as its links stand.

    Args:
        model: compiled from `MjcfModel.spec`.
        motion: of its mechanism.
    """
    tree = kinematic_tree(model)
    out = np.repeat(model.qpos0[None], len(motion), 0)
    for j, joint in enumerate(tree.joints):
        address = int(model.jnt_qposadr[j])
        if int(model.jnt_type[j]) in DRIVABLE:
            out[:, address] = motion.joints[joint.name].value
            continue
        link = motion.links[link_name(model, int(model.jnt_bodyid[j]))]
        rotations = link.rotation @ joint.b.frame
        if int(model.jnt_type[j]) == FREE:
            out[:, address : address + 3] = link.position
            address += 3
        elif joint.a.link == GROUND:
            rotations = joint.a.frame.T @ rotations
        else:
            rotations = np.swapaxes(motion.links[joint.a.link].rotation @ joint.a.frame, -1, -2) @ rotations
        for row, rotation in zip(out, rotations, strict=True):
            mujoco.mju_mat2Quat(row[address : address + 4], np.ascontiguousarray(rotation).ravel())
    return out
