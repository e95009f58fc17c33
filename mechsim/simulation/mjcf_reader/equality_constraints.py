"""Equality constraints of a model as joints and couplings: connect, weld, joint and fixed-tendon equality."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.couplings import Coupling
from mechsim.model.joints import End, Joint
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.kinematic_tree import FRAMES, POINTS, Carrier
from mechsim.simulation.state import rotation_matrix

CONNECT, WELD, JOINT, TENDON = (
    int(kind)
    for kind in (
        mujoco.mjtEq.mjEQ_CONNECT,
        mujoco.mjtEq.mjEQ_WELD,
        mujoco.mjtEq.mjEQ_JOINT,
        mujoco.mjtEq.mjEQ_TENDON,
    )
)


@dataclass
class Equalities:
    """What the equality constraints of a model say.

    Attributes:
        joints: of connect and weld constraints.
        couplings: of joint and tendon constraints.
        remarks: sentences on those that are off or say nothing.
    """

    joints: list[Joint] = field(default_factory=list[Joint])
    couplings: list[Coupling] = field(default_factory=list[Coupling])
    remarks: list[str] = field(default_factory=list[str])


def equalities(model: mujoco.MjModel, carriers: Sequence[Carrier]) -> Equalities:
    """Return the active equality constraints of a model as joints and couplings.

    Raises:
        InputError: for one of another kind, or of a tendon that is none of joints.
    """
    result = Equalities()
    off = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    names = {model.joint(j).name for j in range(model.njnt)}
    for i in range(model.neq):
        name, kind = model.equality(i).name, int(model.eq_type[i])
        if off or not model.eq_active0[i]:
            result.remarks.append(f"equality {name!r} is not active and was left out")
        elif kind in (CONNECT, WELD):
            joint = _closing_joint(model, i, carriers, f"{name}_loop" if name in names else name)
            if joint is None:
                result.remarks.append(f"equality {name!r} joins bodies that do not move against each other")
            else:
                result.joints.append(joint)
        elif kind in (JOINT, TENDON):
            result.couplings.append(_coupling(model, i, name))
        else:
            what = str(mujoco.mjtEq(kind).name).removeprefix("mjEQ_").lower()
            raise InputError(
                f"equality {name!r} is of kind {what}, which joins no links; "
                "connect, weld, joint and tendon are read: leave it out or make it inactive"
            )
    return result


def _closing_joint(model: mujoco.MjModel, i: int, carried: Sequence[Carrier], name: str) -> Joint | None:
    """Return the joint of a connect or weld; None where both its bodies are one link."""
    data, weld = model.eq_data[i], int(model.eq_type[i]) == WELD
    first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
    if int(model.eq_objtype[i]) == int(mujoco.mjtObj.mjOBJ_SITE):
        bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        points = model.site_pos[first], model.site_pos[second]
        rotations = rotation_matrix(model.site_quat[first]), rotation_matrix(model.site_quat[second])
    else:
        bodies = first, max(second, 0)
        # of a weld the anchor comes first, in body 2; then where body 2 is in body 1
        points = (data[3:6], data[0:3]) if weld else (data[0:3], data[3:6])
        rotations = rotation_matrix(data[6:10]) if weld else np.eye(3), np.eye(3)
    carriers = [carried[body] for body in bodies]
    if carriers[0].link == carriers[1].link:
        return None
    # without torque a weld holds the point alone
    kind = FRAMES if weld and data[10] != 0.0 else POINTS
    ends = [
        End(
            carrier.link,
            carrier.point(point),
            carrier.direction(rotation_[:, 2]),
            carrier.direction(rotation_[:, 0]),
        )
        for carrier, point, rotation_ in zip(carriers, points, rotations, strict=True)
    ]
    return Joint(name, kind, ends[0], ends[1])


def _coupling(model: mujoco.MjModel, i: int, name: str) -> Coupling:
    """Return what a joint or tendon equality says, both sides counted from the reference configuration."""
    tendons = int(model.eq_type[i]) == TENDON
    sides = [
        (_tendon if tendons else _one_joint)(model, int(ids[i])) for ids in (model.eq_obj1id, model.eq_obj2id)
    ]
    (dependent, first), (independent, second) = sides
    return Coupling(name, dependent, independent, coefficients(model.eq_data[i, :5]), (first, second))


def coefficients(polynomial: Array) -> tuple[float, ...]:
    """Return the coefficients of a polynomial without the noughts at its end."""
    last = int(np.flatnonzero(polynomial).max(initial=0))
    return tuple(polynomial[: last + 1].tolist())


def _one_joint(model: mujoco.MjModel, j: int) -> tuple[dict[str, float], float]:
    if j < 0:
        return {}, 0.0
    return {model.joint(j).name: 1.0}, float(model.qpos0[model.jnt_qposadr[j]])


def _tendon(model: mujoco.MjModel, t: int) -> tuple[dict[str, float], float]:
    if t < 0:
        return {}, 0.0
    return tendon_joints(model, t), float(model.tendon_length0[t])


def tendon_joints(model: mujoco.MjModel, t: int) -> dict[str, float]:
    """Return the joints of a fixed tendon and their weights in its length.

    Raises:
        InputError: for a tendon through sites.
    """
    name = model.tendon(t).name
    first = int(model.tendon_adr[t])
    weights: dict[str, float] = {}
    for k in range(first, first + int(model.tendon_num[t])):
        if int(model.wrap_type[k]) != int(mujoco.mjtWrap.mjWRAP_JOINT):
            raise InputError(
                f"tendon {name!r} runs through sites and is held by an equality; "
                "only tendons of joints (fixed) are read: leave the equality out or make it inactive"
            )
        joint = model.joint(int(model.wrap_objid[k])).name
        weights[joint] = weights.get(joint, 0.0) + float(model.wrap_prm[k])
    return weights
