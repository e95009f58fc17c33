"""Joints that hardly move, locked in their mean position."""

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import Candidate, NotApplicable
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "locked joints"
SINGLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
# largest displacement of a joint that is proposed, in [rad] or characteristic lengths
MAX_DISPLACEMENT = 0.02


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to lock each hinge and slide that hardly moves, the smallest displacement first."""
    candidates: list[tuple[float, Candidate]] = []
    for joint in observed.spec.joints:
        if joint.type not in SINGLE or joint.name in observed.scene.drive:
            continue
        values = observed.values(joint.name)
        unit = observed.length if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
        displacement = float(np.ptp(values)) / unit
        if displacement > MAX_DISPLACEMENT:
            continue
        middle = 0.5 * float(values.min() + values.max())
        distance = f"{displacement * unit:.2g} {'rad' if unit == 1.0 else 'm'}"
        what = f"joint {joint.name}, which moved by {distance}: locked"
        edit = lambda spec, name=joint.name, value=middle: fuse(spec, name, value)  # noqa: E731
        candidates.append((displacement, Candidate(CATEGORY, what, edit)))
    return [candidate for _, candidate in sorted(candidates, key=lambda pair: pair[0])]


def fuse(spec: mujoco.MjSpec, name: str, value: float) -> None:
    """Remove a hinge or slide that nothing acts on; its body keeps the pose of a joint value.

    Raises:
        NotApplicable: if there is no such joint, something acts on it, or its body has other joints, which
            would move with the body.
    """
    if spec.joint(name) is None:
        raise NotApplicable(f"joint {name} is removed already")
    require_unused(spec, name)
    fuse_joint_at(spec, name, np.array([value]))


def fuse_joint_at(spec: mujoco.MjSpec, name: str, value: Array) -> None:
    """Remove a joint; its body keeps the pose of joint coordinates, (1,) or of a ball (4,).

    Raises:
        NotApplicable: if its body has other joints, which would move with the body.
    """
    joint = spec.joint(name)
    model = plainly_compiled(spec)
    data, own = mujoco.MjData(model), model.joint(name)
    address = slice(int(own.qposadr[0]), int(own.qposadr[0]) + len(value))
    body = int(own.bodyid[0])
    if model.body_jntnum[body] > 1 and not np.array_equal(value, model.qpos0[address]):
        raise NotApplicable(f"joint {name} is one of several of a body, and not where it is at rest")
    data.qpos[address] = value
    mujoco.mj_kinematics(model, data)
    parent = int(model.body_parentid[body])
    rotation = data.xmat[parent].reshape(3, 3)
    model.body_pos[body] = rotation.T @ (data.xpos[body] - data.xpos[parent])
    inverse = np.empty(4)
    mujoco.mju_negQuat(inverse, data.xquat[parent])
    mujoco.mju_mulQuat(model.body_quat[body], inverse, data.xquat[body])
    spec.copy_back(model)
    spec.delete(joint)


def require_unused(spec: mujoco.MjSpec, name: str) -> None:
    """Reject a joint that an actuator, a tendon or a joint equality uses.

    Raises:
        NotApplicable: naming what uses it.
    """
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON and actuator.target == name:
            raise NotApplicable(f"actuator {actuator.name} acts on joint {name}")
    for tendon in spec.tendons:
        if name in joints_of(tendon):
            raise NotApplicable(f"tendon {tendon.name} acts on joint {name}")
    for equality in spec.equalities:
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and name in (equality.name1, equality.name2):
            raise NotApplicable(f"equality {equality.name} couples joint {name}")


def joints_of(tendon: mujoco.MjsTendon) -> dict[str, float]:
    """Return the joints of a fixed tendon and their coefficients; none for a spatial tendon."""
    return {
        wrap.target.name: float(wrap.coef) for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT
    }
