"""Free bodies held where they stand: in a copy of a specification they lose their free joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf_reader.kinds import FREE
from mechsim.simulation.mjcf_reader.link_places import rotation


def free_bodies(model: mujoco.MjModel) -> list[str]:
    """Return the names of the bodies with free joints."""
    return [model.body(model.jnt_bodyid[j]).name for j in range(model.njnt) if int(model.jnt_type[j]) == FREE]


@dataclass(frozen=True)
class HeldBase:
    """Free bodies of a scene that are held where they start.

    Attributes:
        places: body -> where it stands: place in [m] and quaternion, (7,).
        moved: bodies that its file has elsewhere.
        qpos: which of the coordinates remain, (nq,).
        qvel: which of the freedoms remain, (nv,).
    """

    places: Mapping[str, Array]
    moved: Sequence[str]
    qpos: NDArray[np.bool_]
    qvel: NDArray[np.bool_]


def hold_scene_base(spec: mujoco.MjSpec, model: mujoco.MjModel, key: str | None) -> HeldBase:
    """Take away all free joints of a scene, its keyframes cut to what remains; say what was done.

    Args:
        spec: changed in place.
        model: compiled from it.
        key: keyframe as in which the bodies are to stand; None for the reference configuration.

    Raises:
        InputError: for a free body without a name.
    """
    start = model.qpos0 if key is None else model.key(key).qpos
    qpos, qvel = np.ones(model.nq, dtype=np.bool_), np.ones(model.nv, dtype=np.bool_)
    places: dict[str, Array] = {}
    moved: list[str] = []
    for j in np.flatnonzero(model.jnt_type == FREE):
        name = model.body(model.jnt_bodyid[j]).name
        if not name:
            raise InputError("a body with a free joint has no name; give it one in the file")
        at, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        qpos[at : at + 7], qvel[dof : dof + 6] = False, False
        places[name] = start[at : at + 7].copy()
        moved += [name] if (places[name] != model.qpos0[at : at + 7]).any() else []
    known = [(one, k) for k, one in enumerate(spec.keys)]
    kept = {
        one.name: (
            float(one.time),
            *(
                values[k].copy()
                for values in (model.key_act, model.key_ctrl, model.key_mpos, model.key_mquat)
            ),
            model.key_qpos[k][qpos],
            model.key_qvel[k][qvel],
        )
        for one, k in known
    }
    for one, _ in known:
        spec.delete(one)
    hold_base(spec, model, start)
    for name, (time, act, ctrl, mpos, mquat, places_, rates) in kept.items():
        spec.add_key(
            name=name, time=time, act=act, ctrl=ctrl, mpos=mpos, mquat=mquat, qpos=places_, qvel=rates
        )
    return HeldBase(places, tuple(moved), qpos, qvel)


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
