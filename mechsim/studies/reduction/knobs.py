"""Numbers of a scene that say how its parts act: one knob for all parts that are alike."""

import copy
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import NotThere
from mechsim.studies.reduction.lean_scene import LeanScene
from mechsim.studies.reduction.stepping import IMPEDANCES

SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
Of = Literal["joint", "freedom", "coordinate", "equality", "actuator"]


@dataclass(frozen=True, slots=True)
class Knob:
    """A number that all of some parts share.

    Attributes:
        of: what the parts are.
        names: of these, as in the specification; of freedoms and coordinates those of their joints.
        fields: arrays of the model and columns in them; None where they have none.
        unit: by which it is added to for each turn; 0 where it is multiplied by exp(turns), "gap" where one
            less it is.
    """

    of: Of
    names: tuple[str, ...]
    fields: tuple[tuple[str, int | None], ...]
    unit: float | Literal["gap"] = dataclasses.field(default=0.0, compare=False)


def knobs_of(spec: mujoco.MjSpec, scene: LeanScene, limited: frozenset[str]) -> tuple[Knob, ...]:
    """Return the knobs of a scene: of joints, loops, limits that were reached, and actuators that are fed.

    Args:
        spec: of the scene.
        scene: the same, compiled.
        limited: joints that were at a limit.
    """
    model, found = scene.model, list[Knob]()
    inertia = _inertia(model, scene.start[0])
    free = [
        model.joint(j).name
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in SINGLE and model.joint(j).name not in scene.drive
    ]
    own = lambda name: float(inertia[int(model.joint(name).dofadr[0])])  # noqa: E731
    for names in _alike(free, lambda name: _joint_signature(model, name, own(name))):
        found += _of_joints(model, names, own(names[0]))
    loops = [one.name for one in spec.equalities if one.active]
    for names in _alike(loops, lambda name: _rows(model, "equality", name)):
        found += _of_rows("equality", names, "eq_solref", "eq_solimp")
    limits = [name for name in free if name in limited and model.jnt_limited[model.joint(name).id]]
    for names in _alike(limits, lambda name: (*_rows(model, "joint", name), f"{own(name):.4g}")):
        found += _of_rows("joint", names, "jnt_solref", "jnt_solimp")
    for name in scene.ctrl:
        found += _of_actuator(model, name)
    return tuple(found)


def turned(model: mujoco.MjModel, knobs: Sequence[Knob], values: Array) -> mujoco.MjModel:
    """Return a copy of a model with knobs turned by values (k,)."""
    model = copy.copy(model)
    for knob, value in zip(knobs, values, strict=True):
        rows = _places(model, knob)
        for field, column in knob.fields:
            array = getattr(model, field)
            at = rows if column is None else (rows, column)
            if knob.unit == "gap":
                array[at] = 1.0 - np.clip((1.0 - array[at]) * np.exp(value), 1.0 - IMPEDANCES[1], 1.0)
                array[at] = np.clip(array[at], *IMPEDANCES)
            elif knob.unit:
                array[at] += knob.unit * value
            else:
                array[at] *= np.exp(value)
    model.dof_armature[:] = np.maximum(model.dof_armature, 0.0)
    model.dof_damping[:] = np.maximum(model.dof_damping, 0.0)
    # how soft rows are goes with the inertia that they hold
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def turned_in(spec: mujoco.MjSpec, knobs: Sequence[Knob], values: Array) -> None:
    """Turn knobs in a specification.

    Raises:
        NotThere: where it lacks a part, as the polynomial that stands for a loop.
    """
    try:
        spec.copy_back(turned(plainly_compiled(spec), knobs, values))
    except KeyError as error:
        raise NotThere(str(error.args[0])) from None


def _inertia(model: mujoco.MjModel, qpos: Array) -> Array:
    """Return the inertia that each freedom feels by itself, (nv,)."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return np.diag(full).copy()


def _alike(names: Sequence[str], signature: Callable[[str], tuple[str, ...]]) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        groups.setdefault(signature(name), []).append(name)
    return [tuple(group) for group in groups.values()]


def _joint_signature(model: mujoco.MjModel, name: str, inertia: float) -> tuple[str, ...]:
    joint = model.joint(name)
    parts = (inertia, joint.armature[0], joint.damping[0], joint.stiffness[0], joint.qpos_spring[0])
    return tuple(f"{float(part):.4g}" for part in parts)


def _rows(model: mujoco.MjModel, of: str, name: str) -> tuple[str, ...]:
    part = getattr(model, of)(name)
    return (str(part.type), str(part.solref), str(part.solimp))


def _of_joints(model: mujoco.MjModel, names: tuple[str, ...], inertia: float) -> list[Knob]:
    step = float(model.opt.timestep)
    found = [
        Knob("freedom", names, (("dof_armature", None),), inertia),
        Knob("freedom", names, (("dof_damping", None),), inertia / step),
    ]
    if model.joint(names[0]).stiffness[0]:
        found += [
            Knob("joint", names, (("jnt_stiffness", None),)),
            Knob("coordinate", names, (("qpos_spring", None),), 1.0),
        ]
    return found


def _of_rows(of: Of, names: tuple[str, ...], reference: str, impedance: str) -> list[Knob]:
    return [
        Knob(of, names, ((reference, 0),)),
        Knob(of, names, ((reference, 1),)),
        Knob(of, names, ((impedance, 0),), "gap"),
        Knob(of, names, ((impedance, 1),), "gap"),
    ]


def _of_actuator(model: mujoco.MjModel, name: str) -> list[Knob]:
    found = [Knob("actuator", (name,), (("actuator_gainprm", 0),))]
    actuator = model.actuator(name)
    if int(actuator.biastype[0]) == AFFINE:
        gain = float(actuator.biasprm[1])
        found[0] = Knob("actuator", (name,), (("actuator_gainprm", 0), ("actuator_biasprm", 1)))
        found.append(Knob("actuator", (name,), (("actuator_biasprm", 2),)))
        found.append(Knob("actuator", (name,), (("actuator_biasprm", 0),), 0.01 * abs(gain) or 1.0))
    return found


def _places(model: mujoco.MjModel, knob: Knob) -> list[int]:
    """Return the rows of a knob's arrays."""
    if knob.of in ("freedom", "coordinate"):
        field = "dofadr" if knob.of == "freedom" else "qposadr"
        return [int(getattr(model.joint(name), field)[0]) for name in knob.names]
    return [int(getattr(model, knob.of)(name).id) for name in knob.names]
