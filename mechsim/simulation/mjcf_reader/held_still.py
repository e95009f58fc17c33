"""Balls and free bodies held where they stand: in a copy of a specification they lose these joints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf_reader.kinds import BALL, FREE
from mechsim.simulation.mjcf_reader.link_places import rotation

# kind of joint -> its coordinates and freedoms
TURNING = {FREE: (7, 6), BALL: (4, 3)}


def free_bodies(model: mujoco.MjModel) -> list[str]:
    """Return the names of the bodies with free joints."""
    return [model.body(model.jnt_bodyid[j]).name for j in free_joints(model)]


def free_joints(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the free joints of a model, by their numbers."""
    return tuple(np.flatnonzero(model.jnt_type == FREE).tolist())


def turning_joints(model: mujoco.MjModel) -> dict[str, int]:
    """Return the balls and free joints of a model: name -> number."""
    return {model.joint(j).name: j for j in range(model.njnt) if int(model.jnt_type[j]) in TURNING}


@dataclass(frozen=True)
class HeldStill:
    """Balls and free joints of a scene that are held where they start.

    Attributes:
        joints: their numbers in the file.
        places: their body -> where it stands in what it hangs on: place in [m] and quaternion, (7,).
        order: their body -> how many of its joints stand before.
        moved: bodies that its file has elsewhere.
        qpos: which of the coordinates remain, (nq,).
        qvel: which of the freedoms remain, (nv,).
    """

    joints: tuple[int, ...]
    places: Mapping[str, Array]
    order: Mapping[str, int]
    moved: Sequence[str]
    qpos: NDArray[np.bool_]
    qvel: NDArray[np.bool_]


def hold_in_scene(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joints: tuple[int, ...], key: str | None
) -> HeldStill:
    """Take balls and free joints of a scene away, its keyframes cut to what remains; say what was done.

    Args:
        spec: changed in place.
        model: compiled from it.
        joints: their numbers.
        key: keyframe as in which the bodies are to stand; None for the reference configuration.

    Raises:
        InputError: for a body of theirs without a name.
    """
    start = model.qpos0 if key is None else model.key(key).qpos
    places = {model.body(body).name: place for body, place in _places(model, joints, start).items()}
    if "" in places:
        raise InputError("a body with a free joint or a ball has no name; give it one in the file")
    qpos, qvel = _remaining(model, joints)
    differs = start != model.qpos0
    moved = [
        model.body(body).name
        for j, body in _bodies(model, joints)
        if differs[model.jnt_qposadr[j] :][: TURNING[int(model.jnt_type[j])][0]].any()
    ]
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
    hold_still(spec, model, joints, start)
    for name, (time, act, ctrl, mpos, mquat, places_, rates) in kept.items():
        spec.add_key(
            name=name, time=time, act=act, ctrl=ctrl, mpos=mpos, mquat=mquat, qpos=places_, qvel=rates
        )
    order = {model.body(body).name: j - int(model.body_jntadr[body]) for j, body in _bodies(model, joints)}
    return HeldStill(joints, places, order, tuple(moved), qpos, qvel)


def hold_still(spec: mujoco.MjSpec, model: mujoco.MjModel, joints: Sequence[int], qpos: Array) -> Array:
    """Take balls and free joints away, their bodies standing as at qpos (nq,).

    Args:
        spec: changed in place; it has no keyframes.
        model: compiled from it.
        joints: their numbers.
        qpos: where the bodies are to stand.

    Returns:
        What remains of qpos.
    """
    places = _places(model, joints, qpos)
    in_order = sorted(spec.joints, key=lambda joint: joint.id)
    bodies = {body: in_order[j].parent for j, body in _bodies(model, joints)}
    for j, body in _bodies(model, joints):
        turned = _quaternion(model, j, qpos)
        if int(model.jnt_type[j]) == BALL and turned[0] == 1.0:
            del places[body]
        else:
            for one in in_order[int(model.body_jntadr[body]) : j]:
                _turn_back(one, in_order[j], rotation(turned))
            _place(bodies[body], np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        spec.delete(in_order[j])
    # a frame round a body moves it: where it is put says by how much
    base = compiled(spec)
    for body, place in places.items():
        frame = base.body(body)
        back = np.empty(4)
        mujoco.mju_negQuat(back, frame.quat)
        _place(bodies[body], rotation(frame.quat).T @ (place[:3] - frame.pos), _product(back, place[3:]))
    return qpos[_remaining(model, joints)[0]]


def without_stilled(
    spec: mujoco.MjSpec, holds: Mapping[str, float | None], start: Array | None
) -> tuple[mujoco.MjSpec, Mapping[str, float | None], Array | None]:
    """Return a specification without the balls and free joints that are held, other holds, and the start."""
    if None not in holds.values():
        return spec, holds, start
    model = compiled(spec.copy())
    turning = turning_joints(model)
    names = [name for name, value in holds.items() if value is None and name in turning]
    if not names:
        return spec, holds, start
    for key in list(spec.keys):
        spec.delete(key)
    here: Array = model.qpos0 if start is None else start
    left = hold_still(spec, model, [turning[name] for name in names], here)
    return spec, {name: value for name, value in holds.items() if name not in names}, left


def _turn_back(joint: mujoco.MjsJoint, ball: mujoco.MjsJoint, turn: Array) -> None:
    """Leave a joint nearer the ground where it is, its body's frame being turned as a ball of it was."""
    if joint.frame is not None or ball.frame is not None:
        raise InputError(
            f"joint {ball.name!r} cannot be held where it is turned: {joint.name!r} of the same body stands "
            "in a frame; write the file out whole first (mujoco.MjSpec.from_file(...).to_xml())"
        )
    joint.axis = turn.T @ joint.axis
    joint.pos = ball.pos + turn.T @ (joint.pos - ball.pos)


def _bodies(model: mujoco.MjModel, joints: Sequence[int]) -> list[tuple[int, int]]:
    """Return joints and the bodies they move, by their numbers."""
    return [(j, int(model.jnt_bodyid[j])) for j in joints]


def _places(model: mujoco.MjModel, joints: Sequence[int], qpos: Array) -> dict[int, Array]:
    """Return where bodies stand in what they hang on with these joints as at qpos: number -> (7,)."""
    found: dict[int, Array] = {}
    for j, body in _bodies(model, joints):
        turned = _quaternion(model, j, qpos)
        if int(model.jnt_type[j]) == FREE:
            at = int(model.jnt_qposadr[j])
            found[body] = np.concatenate([qpos[at : at + 3], turned])
        else:
            pivot, quat = model.jnt_pos[j], model.body_quat[body]
            moved = rotation(quat) @ (pivot - rotation(turned) @ pivot)
            found[body] = np.concatenate([model.body_pos[body] + moved, _product(quat, turned)])
    return found


def _quaternion(model: mujoco.MjModel, joint: int, qpos: Array) -> Array:
    end = int(model.jnt_qposadr[joint]) + TURNING[int(model.jnt_type[joint])][0]
    turned = qpos[end - 4 : end]
    return turned / np.linalg.norm(turned)


def _product(first: Array, then: Array) -> Array:
    out = np.empty(4)
    mujoco.mju_mulQuat(out, first, then)
    return out


def _remaining(model: mujoco.MjModel, joints: Sequence[int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which coordinates (nq,) and freedoms (nv,) remain without some joints."""
    qpos, qvel = np.ones(model.nq, dtype=np.bool_), np.ones(model.nv, dtype=np.bool_)
    for j in joints:
        at, dof = int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        coordinates, freedoms = TURNING[int(model.jnt_type[j])]
        qpos[at : at + coordinates], qvel[dof : dof + freedoms] = False, False
    return qpos, qvel


def _place(body: mujoco.MjsBody, position: Array, quaternion: Array) -> None:
    body.pos, body.quat = position, quaternion
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
