"""Inertias of links, gravity, and springs, dampers and Coulomb friction of joints."""

from collections.abc import Container, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mechsim.mechanism.actuators import NO_LIMIT, Actuator, Range
from mechsim.mechanism.forces import Forces, Friction, JointSpring
from mechsim.mechanism.links import Inertia, Link, combine, rows, vector
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.simulation.mjcf_reader.coordinates import actuated_joints, actuator_names, listed
from mechsim.simulation.mjcf_reader.equality_constraints import tendon_weights
from mechsim.simulation.mjcf_reader.kinematic_tree import Carrier
from mechsim.simulation.state import SCALAR, gravity, rotation_matrix

# kinds of actuators with affine gain and bias; the first of each is constant, or has no state
GAINS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)
BIASES = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
# of MuJoCo 4
PID, DC_MOTOR = (int(getattr(mujoco.mjtGain, f"mjGAIN_{name}", -1)) for name in ("PID", "DCMOTOR"))
DYNAMICS = tuple(
    int(kind)
    for kind in (
        mujoco.mjtDyn.mjDYN_NONE,
        mujoco.mjtDyn.mjDYN_INTEGRATOR,
        mujoco.mjtDyn.mjDYN_FILTER,
        mujoco.mjtDyn.mjDYN_FILTEREXACT,
    )
)


def with_inertias(
    model: mujoco.MjModel,
    links: Sequence[Link],
    carriers: Sequence[Carrier],
    raised: float = 0.0,
) -> tuple[Link, ...]:
    """Return links with the inertias of all their bodies.

    Args:
        model: the compiled model.
        links: the moving links.
        carriers: carrier of each body, the world first.
        raised: mass in [kg] assigned to massless bodies; 0 if there are none.
    """
    bodies = {link.name: list[int]() for link in links}
    for i, carrier in enumerate(carriers):
        if carrier.link in bodies:
            bodies[carrier.link].append(i)
    if not any(model.body_mass[i] > 0.0 for own in bodies.values() for i in own):
        return tuple(links)

    def inertia(own: Sequence[int]) -> Inertia:
        """Return the inertia of the bodies on one link, in its frame."""
        inertias: list[Inertia] = []
        for i in own if any(model.body_mass[i] > 0.0 for i in own) else ():
            axes = carriers[i].pose.rotation @ rotation_matrix(model.body_iquat[i])
            moments = rows(axes @ np.diag(model.body_inertia[i]) @ axes.T)
            inertias.append(
                Inertia(float(model.body_mass[i]), vector(carriers[i].point(model.body_ipos[i])), moments)
            )
        whole = combine(inertias)
        return replace(whole, negligible=not whole.mass > raised * len(own) * (1.0 + ROUNDING))

    return tuple(replace(link, inertia=inertia(bodies[link.name])) for link in links)


def forces_of_model(model: mujoco.MjModel, locked: Container[str]) -> Forces:
    """Return gravity, actuators, and dampers, springs, Coulomb friction and armature of hinges and slides."""
    armature: dict[str, float] = {}
    friction: list[Friction] = []
    springs: list[JointSpring] = []
    for j in range(model.njnt):
        if int(model.jnt_type[j]) not in SCALAR:
            continue
        name, dof, address = model.joint(j).name, model.jnt_dofadr[j], model.jnt_qposadr[j]
        if model.dof_armature[dof] and name not in locked:
            armature[name] = float(model.dof_armature[dof])
        viscous, coulomb = _linear(model.dof_damping[dof]), float(model.dof_frictionloss[dof])
        if viscous or coulomb:
            friction.append(Friction(name, viscous, coulomb))
        stiffness = _linear(model.jnt_stiffness[j])
        if stiffness:
            springs.append(JointSpring(name, stiffness, float(model.qpos_spring[address])))
    actuators = (_actuator(model, i, name) for i, name in enumerate(actuator_names(model)))
    return Forces(
        gravity=vector(gravity(model)),
        friction=tuple(friction),
        joint_springs=tuple(springs),
        actuators=tuple(a for a in actuators if a is not None and not any(name in locked for name in a.gear)),
        armature=armature,
    )


def _actuator(model: mujoco.MjModel, i: int, name: str) -> Actuator | None:
    """Return an actuator on hinges and slides with affine gain and bias; None for others."""
    target, joints = int(model.actuator_trnid[i, 0]), actuated_joints(model, i)
    kinds = int(model.actuator_gaintype[i]), int(model.actuator_biastype[i]), int(model.actuator_dyntype[i])
    regulated = _regulated(model, i, kinds)
    affine = kinds[0] in GAINS and kinds[1] in BIASES and kinds[2] in DYNAMICS
    if not joints or not (affine or regulated):
        return None
    if any(int(model.joint(joint).type[0]) not in SCALAR for joint in joints):
        return None
    ratio = float(model.actuator_gear[i, 0])
    on_tendon = int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_TENDON)
    weights = tendon_weights(model, target) if on_tendon else {joints[0]: 1.0}
    gain, bias = model.actuator_gainprm[i, :3].copy(), model.actuator_biasprm[i, :3].copy()
    gain[1:] *= kinds[0] == GAINS[1]
    bias *= kinds[1] == BIASES[1]
    # viscous friction of the actuator itself
    bias[2] -= _linear(model.actuator_damping[i])
    first = int(model.actuator_ctrladr[i]) if hasattr(model, "actuator_ctrladr") else i
    inflow, direct = None, (0.0, 0.0)
    if regulated:
        gain, bias, inflow, direct = regulated
        bias = np.array(bias) - [0.0, 0.0, _linear(model.actuator_damping[i])]
    elif kinds[2] != DYNAMICS[0]:
        time = max(float(model.actuator_dynprm[i, 0]), float(mujoco.mjMINVAL))
        inflow = (1.0, 0.0, 0.0, 0.0) if kinds[2] == DYNAMICS[1] else (1.0 / time, -1.0 / time, 0.0, 0.0)
    low, high = _range(model.actuator_forcelimited[i], model.actuator_forcerange[i])
    if not on_tendon and model.jnt_actfrclimited[target]:
        joint_range = model.jnt_actfrcrange[target] / abs(ratio or 1.0)
        low, high = max(low, float(joint_range[0])), min(high, float(joint_range[1]))
    return Actuator(
        name,
        {joint: ratio * weight for joint, weight in weights.items()},
        gain=vector(gain),
        bias=vector(bias),
        inflow=inflow,
        direct=direct,
        control_range=_range(model.actuator_ctrllimited[first], model.actuator_ctrlrange[first]),
        state_range=_range(model.actuator_actlimited[i], model.actuator_actrange[i]),
        force_range=(low, high),
        inertia=float(model.actuator_armature[i]),
    )


def _regulated(model: mujoco.MjModel, i: int, kinds: tuple[int, int, int]) -> Any:
    """Return gain, bias, inflow and direct gains of a `pid`, or of a `dcmotor` without states; or None.

    The force of a `pid` is kp (u - l) - kv l' + ki w with w' = u - l; that of a `dcmotor`, K (u - K l') / R.
    """
    gain, bias, dynamics = model.actuator_gainprm[i], model.actuator_biasprm[i], model.actuator_dynprm[i]
    if kinds[0] == PID and kinds[1] == BIASES[1] and not (dynamics.any() or gain[1:].any() or bias[3:].any()):
        inflow = (1.0, 0.0, -1.0, 0.0) if model.actuator_actnum[i] else None
        return (float(gain[0]), 0.0, 0.0), bias[:3].copy(), inflow, (-float(bias[1]), 0.0)
    if kinds[0] == DC_MOTOR and not (
        dynamics.any() or gain[2:].any() or bias.any() or model.actuator_actnum[i]
    ):
        resistance, constant = gain[:2].tolist()
        slowing = -(constant**2) / resistance
        return (constant / resistance, 0.0, 0.0), np.array([0.0, 0.0, slowing]), None, (0.0, 0.0)
    return None


def _range(limited: bool, values: Array) -> Range:
    return (float(values[0]), float(values[1])) if limited else NO_LIMIT


def left_out_of_dynamics(model: mujoco.MjModel) -> list[str]:
    """Return the effects that MuJoCo simulates and the dynamics of this package omit, in a few words each."""
    others = [name for i, name in enumerate(actuator_names(model)) if _actuator(model, i, name) is None]
    tendons = bool(model.tendon_stiffness.any() or model.tendon_damping.any())
    ropes = [str(model.tendon(t).name) or f"{t}" for t in np.flatnonzero(model.tendon_limited)]
    present = {
        "fluid": bool(model.opt.density or model.opt.viscosity),
        "springs and dampers of tendons": tendons,
        f"limits of the tendons {listed(ropes)}": bool(ropes),
        "friction of tendons": bool(model.tendon_frictionloss.any()),
        "gravity compensation": bool(model.body_gravcomp.any()),
        f"actuators {listed(others)}": bool(others),
    }
    return [name for name, acts in present.items() if acts]


def _linear(value: Array | float) -> float:
    """Return the linear part of a stiffness or damping, which may be a polynomial."""
    return float(np.ravel(value)[0])
