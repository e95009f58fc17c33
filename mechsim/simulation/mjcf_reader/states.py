"""A motion as coordinates of the model it was read from."""

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.links import GROUND
from mechsim.model.motion import Motion
from mechsim.simulation.mjcf_reader.joint_chains import chains
from mechsim.simulation.mjcf_reader.kinds import DRIVABLE, FREE
from mechsim.simulation.mjcf_reader.link_places import link_name


def states_of(model: mujoco.MjModel, motion: Motion) -> Array:
    """Return the coordinates of a model in a motion of the mechanism read from it, (n, nq).

    Hinges and slides are as the motion has them; balls and free joints are as its links stand.

    Args:
        model: compiled from `MjcfModel.spec`.
        motion: of its mechanism.
    """
    chained = chains(model)
    out = np.repeat(model.qpos0[None], len(motion), 0)
    for j, joint in enumerate(chained.joints):
        place = int(model.jnt_qposadr[j])
        if int(model.jnt_type[j]) in DRIVABLE:
            out[:, place] = motion.joints[joint.name].value
            continue
        link = motion.links[link_name(model, int(model.jnt_bodyid[j]))]
        turns = link.rotation @ joint.b.frame
        if int(model.jnt_type[j]) == FREE:
            out[:, place : place + 3] = link.position
            place += 3
        elif joint.a.link == GROUND:
            turns = joint.a.frame.T @ turns
        else:
            turns = np.swapaxes(motion.links[joint.a.link].rotation @ joint.a.frame, -1, -2) @ turns
        for row, turn in zip(out, turns, strict=True):
            mujoco.mju_mat2Quat(row[place : place + 4], np.ascontiguousarray(turn).ravel())
    return out
