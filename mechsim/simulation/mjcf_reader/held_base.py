"""Free bodies held where they stand: in a copy of a specification they lose their free joints."""

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf_reader.kinds import FREE
from mechsim.simulation.mjcf_reader.link_places import rotation


def free_bodies(model: mujoco.MjModel) -> list[str]:
    """Return the names of the bodies with free joints."""
    return [model.body(model.jnt_bodyid[j]).name for j in range(model.njnt) if int(model.jnt_type[j]) == FREE]


def hold_base(spec: mujoco.MjSpec, model: mujoco.MjModel, qpos: Array) -> Array:
    """Take away all free joints, their bodies standing as at qpos (nq,).

    Args:
        spec: changed in place; it has no keyframes.
        model: compiled from it.
        qpos: where the bodies are to stand.

    Returns:
        What remains of qpos.
    """
    keep = np.ones(model.nq, dtype=np.bool_)
    places: dict[str, Array] = {}
    for j in range(model.njnt):
        if int(model.jnt_type[j]) == FREE:
            own = slice(int(model.jnt_qposadr[j]), int(model.jnt_qposadr[j]) + 7)
            places[model.body(model.jnt_bodyid[j]).name] = qpos[own].copy()
            keep[own] = False
    for name in places:
        body = spec.body(name)
        for joint in list(body.joints):
            spec.delete(joint)
        _place(body, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    # a frame round a body moves it: where it is put says by how much
    base = compiled(spec)
    for name, place in places.items():
        frame = base.body(name)
        turn = rotation(frame.quat)
        back = np.empty(4)
        mujoco.mju_negQuat(back, frame.quat)
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, back, place[3:] / np.linalg.norm(place[3:]))
        _place(spec.body(name), turn.T @ (place[:3] - frame.pos), quaternion)
    return qpos[keep]


def _place(body: mujoco.MjsBody, position: Array, quaternion: Array) -> None:
    body.pos, body.quat = position, quaternion
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
