"""Chains of slides and hinges whose coordinates are the position of a point or the pose of a link.

A virtual body on three slides, connected to a site or body, adds as many DOFs as the connection removes.
With three hinges and a weld the chain also has the rotation. Names are POINT.x, LINK.rz and so on.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled

POSITIONS, ROTATIONS = ("x", "y", "z"), ("rx", "ry", "rz")
# mass in [kg] and moment of inertia in [kg m2] of a body of a chain: time-stepped runs of g1_ankle.xml exceed
# the tolerance with a thousandth of these values
MASS, INERTIA = 1e-6, 1e-9
# distance from ry = 90 deg, in [rad], within which rz and rx are not distinct
GIMBAL_LOCK = 1e-3


def with_pose_chains(
    spec: mujoco.MjSpec, model: mujoco.MjModel, start: Array, drivers: Sequence[str]
) -> tuple[mujoco.MjModel, Array]:
    """Add a chain for each point or body whose coordinates are among the drivers.

    Args:
        spec: specification, changed in place.
        model: model compiled from it.
        start: initial configuration, (nq,).
        drivers: names of coordinates; names of joints need no chain.

    Returns:
        The model with the chains, and its initial configuration.

    Raises:
        InputError: if a driver is the rotation of a site, or a body starts at ry = 90 deg.
    """
    joints = {model.joint(i).name for i in range(model.njnt)}
    subjects: dict[str, bool] = {}
    for name in drivers:
        subject, _, suffix = name.rpartition(".")
        added = name not in joints and suffix in (*POSITIONS, *ROTATIONS)
        if added and site_or_body(model, subject) is not None:
            subjects[subject] = subjects.get(subject, False) or suffix in ROTATIONS
    if not subjects:
        return model, start
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_kinematics(model, data)
    for subject, rotates in subjects.items():
        start = np.concatenate([start, _add_chain(spec, model, data, subject, rotates)])
    return compiled(spec), start


def site_or_body(model: mujoco.MjModel, name: str) -> tuple[int, Array] | None:
    """Return the body and point of a site or body with this name; None if there is neither."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site >= 0:
        return int(model.site_bodyid[site]), model.site_pos[site].copy()
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    return (body, np.zeros(3)) if body > 0 else None


def _add_chain(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, subject: str, rotates: bool
) -> Array:
    """Add the chain of a site or body at its current pose, and return its coordinates, (3,) or (6,)."""
    from scipy.spatial.transform import Rotation

    located = site_or_body(model, subject)
    assert located is not None
    body, local = located
    name = model.body(body).name
    if rotates and subject != name:
        raise InputError(f"{subject} is a site, whose rotation cannot be driven; drive that of {name}")
    rotation = data.xmat[body].reshape(3, 3)
    position = data.xpos[body] + rotation @ local
    carrier = spec.worldbody.add_body(name=f"{VIRTUAL_PREFIX}{subject}", pos=position)
    for axis, suffix, value in zip(np.eye(3), POSITIONS, position.tolist(), strict=True):
        _add_joint(carrier, f"{subject}.{suffix}", mujoco.mjtJoint.mjJNT_SLIDE, axis, value)
    equality = spec.add_equality(name=f"{VIRTUAL_PREFIX}{subject}", objtype=mujoco.mjtObj.mjOBJ_BODY)
    equality.name1, equality.name2 = name, carrier.name
    if not rotates:
        equality.type = mujoco.mjtEq.mjEQ_CONNECT
        equality.data[:3] = local
        return position
    if abs(abs(rotation[0, 2]) - 1.0) < 0.5 * GIMBAL_LOCK**2:
        raise InputError(f"body {name} starts at {name}.ry = 90 deg, where rx and rz coincide; drive joints")
    angles = Rotation.from_matrix(rotation).as_euler("XYZ")
    for axis, suffix, angle in zip(np.eye(3), ROTATIONS, angles.tolist(), strict=True):
        quaternion = Rotation.from_rotvec(angle * axis).as_quat(scalar_first=True)
        carrier = carrier.add_body(name=f"{VIRTUAL_PREFIX}{subject}.{suffix}", quat=quaternion)
        ref = np.degrees(angle) if spec.compiler.degree else angle
        _add_joint(carrier, f"{subject}.{suffix}", mujoco.mjtJoint.mjJNT_HINGE, axis, ref)
    equality.type, equality.name2 = mujoco.mjtEq.mjEQ_WELD, carrier.name
    # anchor, relative position and rotation, torque scale
    equality.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
    return np.concatenate([position, angles])


def _add_joint(body: mujoco.MjsBody, name: str, kind: mujoco.mjtJoint, axis: Array, ref: float) -> None:
    body.explicitinertial = True
    body.mass, body.inertia = MASS, np.full(3, INERTIA)
    joint = body.add_joint(name=name, type=kind, axis=axis, ref=ref)
    # override the limits of the file's default class
    joint.limited = joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    joint.pos, joint.range = np.zeros(3), np.zeros(2)
    joint.armature = joint.frictionloss = 0.0
    joint.damping, joint.stiffness = np.zeros_like(joint.damping), np.zeros_like(joint.stiffness)
