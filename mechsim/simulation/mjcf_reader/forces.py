"""Forces of a model: gravity, actuators, and springs, dampers and friction of joints and tendons.

Of MuJoCo 4, a stretch x of a spring has the force -(k0 + k1 x + k2 x^2) x, and a rate v of a damper the force
-(d0 + d1 |v| + d2 v^2) v; a tendon between two spring lengths has none.
Source: MuJoCo documentation, XML reference, attributes stiffness, damping and springlength.
"""

import copy
from collections.abc import Container, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Union

import mujoco
import numpy as np

from mechsim.mechanism.actuators import NO_LIMIT, Actuator, Range
from mechsim.mechanism.forces import Forces, Friction, JointSpring, LinkPoint, Load, Spring
from mechsim.mechanism.links import GROUND, vector
from mechsim.mechanism.load_profile import constant
from mechsim.numerics.arrays import Array
from mechsim.simulation.equality_rows import line_of
from mechsim.simulation.mjcf_reader import coordinates
from mechsim.simulation.mjcf_reader.coordinates import ON_TENDON, actuated_joints
from mechsim.simulation.mjcf_reader.equality_constraints import tendon_weights
from mechsim.simulation.mjcf_reader.kinematic_tree import Carrier
from mechsim.simulation.state import BALL, FREE, SCALAR, gravity, is_disabled

if TYPE_CHECKING:
    from mechsim.mechanism.nonlinear_springs import NonlinearSpring

# kinds of actuators with affine gain and bias; the first of each is constant, or has no state
GAINS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)
BIASES = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
# of MuJoCo 4
PID, DC_MOTOR = (int(getattr(mujoco.mjtGain, f"mjGAIN_{name}", -1)) for name in ("PID", "DCMOTOR"))
_STATES = "NONE", "INTEGRATOR", "FILTER", "FILTEREXACT"
DYNAMICS = tuple(int(getattr(mujoco.mjtDyn, f"mjDYN_{name}")) for name in _STATES)
JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
# number of groups of actuators that `actuatorgroupdisable` can switch off: 0 to 30 (MuJoCo, XML reference)
GROUPS = 31
# flag -> what it switches off
SWITCHED_OFF = {
    mujoco.mjtDisableBit.mjDSBL_SPRING: "jnt_stiffness tendon_stiffness",
    mujoco.mjtDisableBit.mjDSBL_DAMPER: "dof_damping tendon_damping actuator_damping",
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS: "dof_frictionloss tendon_frictionloss",
    mujoco.mjtDisableBit.mjDSBL_LIMIT: "jnt_limited tendon_limited",
}


Line = tuple[LinkPoint, LinkPoint]


def forces_of_model(
    model: mujoco.MjModel, carriers: Sequence[Carrier], locked: Container[str]
) -> tuple[Forces, tuple[str, ...]]:
    """Return the forces of a model, and in a few words each those that MuJoCo simulates and they omit.

    Args:
        model: the compiled model.
        carriers: carrier of each body, the world first.
        locked: locked joints.
    """
    model = _as_switched(model)
    lines = [_line(model, carriers, t) for t in range(model.ntendon)]
    # actuators that are switched on and can move joints; None for one of another kind
    acting: dict[str, Actuator | None] = {}
    disabled = is_disabled(model, mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    for i, name in enumerate(() if disabled else coordinates.actuator_names(model)):
        joints, group = actuated_joints(model, i), int(model.actuator_group[i])
        off = model.opt.disableactuator >> group & 1 if 0 <= group < GROUPS else False
        if not off and not (joints and all(joint in locked for joint in joints)):
            target = int(model.actuator_trnid[i, 0])
            line = lines[target] if int(model.actuator_trntype[i]) == ON_TENDON else None
            acting[name] = _actuator(model, i, name, line, locked)
    elements: list[Any] = [element for j in range(model.njnt) for element in _in_joint(model, j, locked)]
    elements += [actuator for actuator in acting.values() if actuator is not None]
    elements += [_in_tendon(model, t, line, locked) for t, line in enumerate(lines)]

    def every(kind: type[Any]) -> tuple[Any, ...]:
        return tuple(element for element in elements if isinstance(element, kind))

    forces = Forces(
        gravity=vector(gravity(model)),
        friction=every(Friction),
        springs=every(Spring),
        joint_springs=every(JointSpring),
        # compensation of a share of the weights at the centres of mass
        loads=tuple(
            Load(
                (carriers[body].link, carriers[body].point(model.body_ipos[body])),
                constant(-model.body_gravcomp[body] * model.body_mass[body] * gravity(model)),
            )
            for body in np.flatnonzero(model.body_gravcomp).tolist()
            if carriers[body].link != GROUND
        ),
        nonlinear_springs=tuple(element for element in elements if hasattr(element, "law")),
        actuators=every(Actuator),
        armature={
            model.joint(j).name: float(inertia)
            for j, inertia in enumerate(model.dof_armature[model.jnt_dofadr])
            if inertia and int(model.jnt_type[j]) in SCALAR and model.joint(j).name not in locked
        },
    )
    omitted = [name for name, actuator in acting.items() if actuator is None]
    return forces, (*_left_out(model, omitted), *every(str))


# an element of forces, or what is omitted in words
Element = Union[Friction, JointSpring, "NonlinearSpring", Spring, Actuator, str, None]


def _in_joint(model: mujoco.MjModel, j: int, locked: Container[str]) -> Iterator[Element]:
    """Yield spring, damper and Coulomb friction of a joint."""
    name, dof, kind = model.joint(j).name, model.jnt_dofadr[j], int(model.jnt_type[j])
    viscous, coulomb = _linear(model.dof_damping[dof]), float(model.dof_frictionloss[dof])
    scalar = kind in SCALAR
    if (viscous and kind == BALL) or (scalar and (viscous or coulomb)):
        yield Friction(name, viscous, coulomb if scalar else 0.0)
    if not scalar:
        return
    stiffness, rest = _linear(model.jnt_stiffness[j]), float(model.qpos_spring[model.jnt_qposadr[j]])
    powers = _powers(model, "jnt_stiffness", j), _powers(model, "dof_damping", dof)
    if any(map(any, powers)) and name not in locked:
        text = _text(f"(l-{rest!r})", *powers)
        yield _nonlinear(name, f"spring in {name}", stiffness=stiffness, rest=rest, text=text)
    elif stiffness:
        yield JointSpring(name, stiffness, rest)


def _as_switched(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model without what its flags switch off."""
    model = copy.copy(model)
    for flag, names in SWITCHED_OFF.items():
        if is_disabled(model, flag):
            for name in names.split():
                getattr(model, name)[:] = getattr(model, f"{name}poly", np.zeros(1))[:] = 0
    return model


def _nonlinear(ends: Line | str, name: str, **law: Any) -> "NonlinearSpring":
    from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SpringLaw

    return NonlinearSpring(ends, SpringLaw(**law), name)


def _powers(model: mujoco.MjModel, name: str, i: int) -> tuple[float, float]:
    """Return k1 and k2 of a stiffness, or d1 and d2 of a damping; zeros before MuJoCo 4."""
    values = getattr(model, f"{name}poly", None)
    return (0.0, 0.0) if values is None else (float(values[i][0]), float(values[i][1]))


def _text(stretch: str, stiffness: Sequence[float], damping: Sequence[float]) -> str:
    """Return the force of higher powers as an expression of length l and rate v."""
    (k1, k2), (d1, d2) = stiffness, damping
    return f"{k1!r}*{stretch}**2 + {k2!r}*{stretch}**3 + {d1!r}*abs(v)*v + {d2!r}*v**3"


def _line(model: mujoco.MjModel, carriers: Sequence[Carrier], t: int) -> Line | None:
    """Return the ends of a tendon that is a line between two sites; None for another."""
    line = line_of(model, t)
    if line is None:
        return None
    a, b = ((carriers[body].link, carriers[body].point(local)) for body, local in zip(*line, strict=True))
    return a, b


def _in_tendon(model: mujoco.MjModel, t: int, line: Line | None, locked: Container[str]) -> Element:
    """Return spring and damper of a tendon, what is omitted in words, or None without them."""
    stiffness, damping = _linear(model.tendon_stiffness[t]), _linear(model.tendon_damping[t])
    powers = _powers(model, "tendon_stiffness", t), _powers(model, "tendon_damping", t)
    inertia, higher = float(model.tendon_armature[t]), any(map(any, powers))
    if not (stiffness or damping or higher or inertia) or (line and line[0][0] == line[1][0]):
        return None
    name = f"tendon {model.tendon(t).name or t}"
    low, high = (float(value) for value in model.tendon_lengthspring[t])
    weights = tendon_weights(model, t) if model.wrap_type[model.tendon_adr[t]] == JOINT else {}
    if weights and low == high and not (higher or any(joint in locked for joint in weights)):
        return Actuator(name, weights, bias=(stiffness * low, -stiffness, -damping), inertia=inertia)
    if line is None or inertia:
        return f"spring, damper and armature of {name}"
    if low == high and not higher:
        return Spring(*line, stiffness, low, damping)
    stretch = f"(max(l-{high!r},0)+min(l-{low!r},0))" if low != high else f"(l-{low!r})"
    text = f"{stiffness!r}*{stretch} + {_text(stretch, *powers)}"
    return _nonlinear(line, name, damping=damping, text=text)


def _transmission(
    model: mujoco.MjModel, i: int, line: Line | None, locked: Container[str]
) -> dict[str, Any] | None:
    """Return what an actuator acts on as attributes of `Actuator`; None for another transmission."""
    ratio, joints = float(model.actuator_gear[i, 0]), actuated_joints(model, i)
    if line is not None:
        return {"gear": {}, "ends": line, "pull": ratio} if line[0][0] != line[1][0] else None
    if any(int(model.joint(joint).type[0]) not in SCALAR or joint in locked for joint in joints):
        return None
    weights = dict.fromkeys(joints, 1.0)
    if int(model.actuator_trntype[i]) == ON_TENDON and joints:
        weights = tendon_weights(model, int(model.actuator_trnid[i, 0]))
    return {"gear": {joint: ratio * weight for joint, weight in weights.items()}} if joints else None


def _actuator(
    model: mujoco.MjModel, i: int, name: str, line: Line | None, locked: Container[str]
) -> Actuator | None:
    """Return an actuator on joints, or between two sites, with affine gain and bias; None for others."""
    transmission = _transmission(model, i, line, locked)
    kinds = int(model.actuator_gaintype[i]), int(model.actuator_biastype[i]), int(model.actuator_dyntype[i])
    regulated = _regulated(model, i, kinds)
    affine = kinds[0] in GAINS and kinds[1] in BIASES and kinds[2] in DYNAMICS
    rotor = float(model.actuator_armature[i])
    unread = (line and rotor) or any(_powers(model, "actuator_damping", i))
    if transmission is None or unread or not (affine or regulated):
        return None
    gain, bias = model.actuator_gainprm[i, :3].copy(), model.actuator_biasprm[i, :3] * (kinds[1] == BIASES[1])
    gain[1:] *= kinds[0] == GAINS[1]
    first = int(model.actuator_ctrladr[i]) if hasattr(model, "actuator_ctrladr") else i
    inflow, direct = None, (0.0, 0.0)
    if regulated:
        gain, bias, inflow, direct = regulated
    elif kinds[2] != DYNAMICS[0]:
        time = max(float(model.actuator_dynprm[i, 0]), float(mujoco.mjMINVAL))
        inflow = (1.0, 0.0, 0.0, 0.0) if kinds[2] == DYNAMICS[1] else (1.0 / time, -1.0 / time, 0.0, 0.0)
    # viscous friction of the actuator itself
    bias[2] -= _linear(model.actuator_damping[i])
    clamped = not is_disabled(model, mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    return Actuator(
        name,
        **transmission,
        gain=vector(gain),
        bias=vector(bias),
        inflow=inflow,
        direct=direct,
        control_range=_range(clamped and model.actuator_ctrllimited[first], model.actuator_ctrlrange[first]),
        state_range=_range(model.actuator_actlimited[i], model.actuator_actrange[i]),
        force_range=_force_range(model, i),
        inertia=rotor,
    )


def _force_range(model: mujoco.MjModel, i: int) -> Range:
    """Return the limits of an actuator's force, also those of the joint or tendon on which it acts."""
    low, high = _range(model.actuator_forcelimited[i], model.actuator_forcerange[i])
    target, name = model.actuator_trnid[i, 0], "tendon" if model.actuator_trntype[i] == ON_TENDON else "jnt"
    if getattr(model, f"{name}_actfrclimited")[target]:
        own = getattr(model, f"{name}_actfrcrange")[target] / abs(float(model.actuator_gear[i, 0]) or 1.0)
        low, high = max(low, float(own[0])), min(high, float(own[1]))
    return low, high


def _regulated(model: mujoco.MjModel, i: int, kinds: tuple[int, int, int]) -> Any:
    """Return gain, bias, inflow and direct gains of a `pid`, or of a `dcmotor` without states; or None.

    The force of a `pid` is kp (u - l) - kv l' + ki w with w' = u - l; that of a `dcmotor`, K (u - K l') / R.
    """
    gain, bias, dynamics = model.actuator_gainprm[i], model.actuator_biasprm[i], model.actuator_dynprm[i]
    if kinds[0] == PID and kinds[1] == BIASES[1] and not (dynamics.any() or gain[1:].any() or bias[3:].any()):
        inflow = (1.0, 0.0, -1.0, 0.0) if model.actuator_actnum[i] else None
        return (float(gain[0]), 0.0, 0.0), bias[:3].copy(), inflow, (-float(bias[1]), 0.0)
    if kinds[0] == DC_MOTOR and not np.any([*dynamics, *gain[2:], *bias, model.actuator_actnum[i]]):
        resistance, constant = gain[:2].tolist()
        slowing = -(constant**2) / resistance
        return (constant / resistance, 0.0, 0.0), np.array([0.0, 0.0, slowing]), None, (0.0, 0.0)
    return None


def _range(limited: bool, values: Array) -> Range:
    return (float(values[0]), float(values[1])) if limited else NO_LIMIT


def _left_out(model: mujoco.MjModel, actuators: Sequence[str]) -> list[str]:
    """Return what is omitted besides springs and dampers of tendons; `actuators` are those that are."""
    first, kinds, present = model.jnt_dofadr, model.jnt_type, list[str]()
    rotating, damped = ~np.isin(kinds, SCALAR), np.array([_linear(row) for row in model.dof_damping])[first]
    targets = model.actuator_trnid[np.isin(model.actuator_trntype, coordinates.ON_JOINT), 0]
    shared = np.bincount(targets, minlength=model.njnt) > 1
    powers = np.array([any(_powers(model, "dof_damping", dof)) for dof in first], bool)
    omitted = {
        ("friction", "joint"): rotating & (model.dof_frictionloss[first] > 0.0),
        ("armature", "joint"): rotating & (model.dof_armature[first] > 0.0),
        ("damping", "joint"): ((kinds == FREE) & (damped > 0.0)) | (rotating & powers),
        ("springs", "joint"): rotating & (np.array([_linear(row) for row in model.jnt_stiffness]) != 0.0),
        ("limits", "joint"): rotating & (model.jnt_limited != 0),
        ("limits", "tendon"): model.tendon_limited,
        ("limits of all actuators", "joint"): model.jnt_actfrclimited & shared,
        ("friction", "tendon"): model.tendon_frictionloss,
    }
    for (what, kind), chosen in omitted.items():
        names = [str(getattr(model, kind)(i).name) or f"{i}" for i in np.flatnonzero(chosen)]
        present += [f"{what} of the {kind}s {coordinates.listed(names)}"] if names else []
    present += [f"actuators {coordinates.listed(actuators)}"] if actuators else []
    return [*present, "fluid"] if model.opt.density or model.opt.viscosity else present


def _linear(value: Array | float) -> float:
    """Return the linear part of a stiffness or damping, which may be a polynomial."""
    return float(np.ravel(value)[0])
