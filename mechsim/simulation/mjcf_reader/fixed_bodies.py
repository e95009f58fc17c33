"""Bodies fixed at their initial pose: their ball or free joints are removed from the specification."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.state import BALL, FREE, is_disabled, rotation_matrix

# kind of joint that can be removed -> number of coordinates
COORDINATES = {FREE: 7, BALL: 4}


def free_joints(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the indices of the free joints of a model."""
    return tuple(np.flatnonzero(model.jnt_type == FREE).tolist())


@dataclass(frozen=True)
class FixedBodies:
    """Bodies of a scene that are fixed at their initial poses, without their ball or free joints.

    Attributes:
        joints: indices of the removed joints in the file.
        poses: body -> its pose in the parent body: position in [m] and quaternion, (7,).
        order: body -> number of its joints before the removed one.
        moved: bodies whose initial pose differs from the file's reference configuration.
        qpos: mask of the remaining coordinates, (nq,).
        qvel: mask of the remaining DOFs, (nv,).
        excluded: pairs of bodies whose contacts MuJoCo filters only while the parent is free.
    """

    joints: tuple[int, ...]
    poses: Mapping[str, Array]
    order: Mapping[str, int]
    moved: Sequence[str]
    qpos: NDArray[np.bool_]
    qvel: NDArray[np.bool_]
    excluded: Sequence[tuple[str, str]]


def fix_bodies_in_scene(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joints: tuple[int, ...], key: str | None
) -> FixedBodies:
    """Remove ball and free joints of a scene and their entries in keyframes.

    Args:
        spec: specification of the scene, changed in place.
        model: model compiled from it.
        joints: indices of the joints.
        key: keyframe with the poses of the bodies; None for the reference configuration.

    Raises:
        InputError: if a body has no name.
    """
    start = model.qpos0 if key is None else model.key(key).qpos
    poses = {model.body(body).name: pose for body, pose in _body_poses(model, joints, start).items()}
    if "" in poses:
        raise InputError("a body with a free joint or a ball has no name; give it one in the file")
    qpos, qvel = _remaining(model, joints)
    differs, names = start != model.qpos0, {j: model.body(body).name for j, body in _bodies(model, joints)}
    moved = tuple(name for j, name in names.items() if differs[_coordinates(model, j)].any())
    keyframes: dict[str, dict[str, Any]] = {}
    for k, keyframe in enumerate(list(spec.keys)):
        state = {name: getattr(model, f"key_{name}")[k].copy() for name in ("act", "ctrl", "mpos", "mquat")}
        state |= {"qpos": model.key_qpos[k][qpos], "qvel": model.key_qvel[k][qvel]}
        keyframes[keyframe.name] = state | {"time": float(keyframe.time)}
        spec.delete(keyframe)
    own_pairs = len(spec.excludes)
    fix_bodies(spec, model, joints, start)
    excluded = tuple((pair.bodyname1, pair.bodyname2) for pair in spec.excludes[own_pairs:])
    for name, state in keyframes.items():
        spec.add_key(name=name, **state)
    order = {name: j - int(model.body(name).jntadr[0]) for j, name in names.items()}
    return FixedBodies(joints, poses, order, moved, qpos, qvel, excluded)


def fix_bodies(spec: mujoco.MjSpec, model: mujoco.MjModel, joints: Sequence[int], qpos: Array) -> Array:
    """Remove ball and free joints; their bodies keep their poses at qpos, (nq,).

    Args:
        spec: specification without keyframes, changed in place.
        model: model compiled from it.
        joints: indices of the joints.
        qpos: state with the poses of the bodies.

    Returns:
        The remaining coordinates of qpos.
    """
    _keep_contacts_filtered(spec, model, joints)
    poses = _body_poses(model, joints, qpos)
    in_order = sorted(spec.joints, key=lambda joint: joint.id)
    bodies = {body: in_order[j].parent for j, body in _bodies(model, joints)}
    for j, body in _bodies(model, joints):
        stated = qpos[_coordinates(model, j)][-4:]
        quaternion = stated / np.linalg.norm(stated)
        if int(model.jnt_type[j]) == BALL and quaternion[0] == 1.0:
            del poses[body]
        else:
            for inner in in_order[int(model.body_jntadr[body]) : j]:
                _undo_rotation(inner, in_order[j], rotation_matrix(quaternion))
            _set_pose(bodies[body], np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        spec.delete(in_order[j])
    # a <frame> element around a body displaces it; the compiled pose contains the displacement
    spec.compiler.fusestatic = False  # of URDF files, which would remove the bodies
    base_model = compiled(spec)
    for body, pose in poses.items():
        frame, inverse = base_model.body(body), np.empty(4)
        mujoco.mju_negQuat(inverse, frame.quat)
        position = rotation_matrix(frame.quat).T @ (pose[:3] - frame.pos)
        _set_pose(bodies[body], position, _product(inverse, pose[3:]))
    return qpos[_remaining(model, joints)[0]]


def _keep_contacts_filtered(spec: mujoco.MjSpec, model: mujoco.MjModel, joints: Sequence[int]) -> None:
    """Exclude the contacts of fixed bodies with their children, as MuJoCo does unless the parent is fixed."""
    if is_disabled(model, mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        return
    carrier, solid = model.body_weldid, model.body_geomnum > 0
    parent = carrier[model.body_parentid[carrier]]
    for _, body in _bodies(model, joints):
        for own in np.flatnonzero(solid & (carrier == carrier[body])).tolist():
            for child in np.flatnonzero(solid & (parent == carrier[body])).tolist():
                names = model.body(own).name, model.body(child).name
                if all(names):
                    spec.add_exclude(bodyname1=names[0], bodyname2=names[1])


def _undo_rotation(joint: mujoco.MjsJoint, ball: mujoco.MjsJoint, rotation_: Array) -> None:
    """Keep a joint before a removed ball of its body in place while the frame of the body rotates."""
    if joint.frame is not None or ball.frame is not None:
        raise InputError(
            f"joint {ball.name!r} cannot be held where it is turned: {joint.name!r} of the same body stands "
            "in a frame; write the file out whole first (mujoco.MjSpec.from_file(...).to_xml())"
        )
    joint.axis = rotation_.T @ joint.axis
    joint.pos = ball.pos + rotation_.T @ (joint.pos - ball.pos)


def _bodies(model: mujoco.MjModel, joints: Sequence[int]) -> list[tuple[int, int]]:
    """Return the indices of joints and of their bodies."""
    return [(j, int(model.jnt_bodyid[j])) for j in joints]


def _body_poses(model: mujoco.MjModel, joints: Sequence[int], qpos: Array) -> dict[int, Array]:
    """Return the poses of the bodies of some joints in their parents at qpos: index -> (7,)."""
    data = mujoco.MjData(model)
    for j in joints:
        data.qpos[_coordinates(model, j)] = qpos[_coordinates(model, j)]
    mujoco.mj_kinematics(model, data)
    return {body: pose_in_parent(model, data, body) for _, body in _bodies(model, joints)}


def pose_in_parent(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Array:
    """Return the pose of a body in its parent after `mj_kinematics`: position and quaternion, (7,)."""
    parent, inverse = int(model.body_parentid[body]), np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[parent])
    position = data.xmat[parent].reshape(3, 3).T @ (data.xpos[body] - data.xpos[parent])
    return np.concatenate([position, _product(inverse, data.xquat[body])])


def _product(first: Array, then: Array) -> Array:
    out = np.empty(4)
    mujoco.mju_mulQuat(out, first, then)
    return out


def _remaining(model: mujoco.MjModel, joints: Sequence[int]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks of the coordinates, (nq,), and DOFs, (nv,), that remain without some joints."""
    qpos, qvel = np.ones(model.nq, dtype=np.bool_), np.ones(model.nv, dtype=np.bool_)
    for j in joints:
        qpos[_coordinates(model, j)] = False
    qvel[np.isin(model.dof_jntid, joints)] = False
    return qpos, qvel


def _coordinates(model: mujoco.MjModel, j: int) -> slice:
    """Return the entries of a ball or free joint in qpos."""
    return slice(model.jnt_qposadr[j], model.jnt_qposadr[j] + COORDINATES[int(model.jnt_type[j])])


def _set_pose(body: mujoco.MjsBody, position: Array, quaternion: Array) -> None:
    body.pos, body.quat = position, quaternion
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
