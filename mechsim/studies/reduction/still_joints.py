"""Freedoms that do not move, or hardly: their joints are fused where they stand."""

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import Candidate, NotThere
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "still joints"
SINGLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
# how far a joint may go and still be tried, in [rad] or sizes
HARDLY = 0.02


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to fuse each hinge and slide that hardly moves, the stillest first."""
    found: list[tuple[float, Candidate]] = []
    for joint in seen.spec.joints:
        if joint.type not in SINGLE or joint.name in seen.scene.drive:
            continue
        values = seen.values(joint.name)
        unit = seen.size if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else 1.0
        far = float(np.ptp(values)) / unit
        if far > HARDLY:
            continue
        middle = 0.5 * float(values.min() + values.max())
        what = f"joint {joint.name}, which moved by {far * unit:.2g} {'rad' if unit == 1.0 else 'm'}: fused"
        edit = lambda spec, name=joint.name, at=middle: fuse(spec, name, at)  # noqa: E731
        found.append((far, Candidate(FAMILY, what, edit)))
    return [one for _, one in sorted(found, key=lambda pair: pair[0])]


def fuse(spec: mujoco.MjSpec, name: str, value: float) -> None:
    """Take a hinge or slide away that nothing acts on, its body standing as with the joint at a value.

    Raises:
        NotThere: where there is no such joint, something acts on it, or its body has others that moving
            the body would move too.
    """
    if spec.joint(name) is None:
        raise NotThere(f"joint {name} is left out already")
    require_unused(spec, name)
    fuse_at(spec, name, np.array([value]))


def fuse_at(spec: mujoco.MjSpec, name: str, value: Array) -> None:
    """Take a joint away, its body standing as with the joint at coordinates, (1,) or of a ball (4,).

    Raises:
        NotThere: where its body has other joints, which moving the body would move too.
    """
    joint = spec.joint(name)
    model = plainly_compiled(spec)
    data, own = mujoco.MjData(model), model.joint(name)
    place = slice(int(own.qposadr[0]), int(own.qposadr[0]) + len(value))
    body = int(own.bodyid[0])
    if model.body_jntnum[body] > 1 and not np.array_equal(value, model.qpos0[place]):
        raise NotThere(f"joint {name} is one of several of a body, and not where it is at rest")
    data.qpos[place] = value
    mujoco.mj_kinematics(model, data)
    parent = int(model.body_parentid[body])
    turn = data.xmat[parent].reshape(3, 3)
    model.body_pos[body] = turn.T @ (data.xpos[body] - data.xpos[parent])
    back = np.empty(4)
    mujoco.mju_negQuat(back, data.xquat[parent])
    mujoco.mju_mulQuat(model.body_quat[body], back, data.xquat[body])
    spec.copy_back(model)
    spec.delete(joint)


def require_unused(spec: mujoco.MjSpec, name: str) -> None:
    """Refuse a joint that an actuator, a tendon or a joint equality is made of.

    Raises:
        NotThere: naming what uses it.
    """
    for actuator in spec.actuators:
        if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON and actuator.target == name:
            raise NotThere(f"actuator {actuator.name} acts on joint {name}")
    for tendon in spec.tendons:
        if name in joints_of(tendon):
            raise NotThere(f"tendon {tendon.name} runs over joint {name}")
    for equality in spec.equalities:
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and name in (equality.name1, equality.name2):
            raise NotThere(f"equality {equality.name} couples joint {name}")


def joints_of(tendon: mujoco.MjsTendon) -> dict[str, float]:
    """Return the joints of a fixed tendon and their weights; none of one through sites."""
    return {
        part.target.name: float(part.coef) for part in tendon.path if part.type == mujoco.mjtWrap.mjWRAP_JOINT
    }
