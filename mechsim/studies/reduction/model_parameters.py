"""Physical parameters of a scene that can be fitted: one parameter for all elements that are alike."""

import copy
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import NotApplicable
from mechsim.studies.reduction.reduced_scene import ReducedScene
from mechsim.studies.reduction.stepping import IMPEDANCES

SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
ElementKind = Literal["joint", "freedom", "coordinate", "equality", "actuator"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that several elements share.

    Attributes:
        element: kind of the elements.
        names: of the elements in the specification; for "freedom" and "coordinate" those of their joints.
        fields: arrays of the model and their columns; None for one-dimensional arrays.
        unit: added to the number per unit value; 0 multiplies it by exp(value), "gap" multiplies one minus
            the number by exp(value).
    """

    element: ElementKind
    names: tuple[str, ...]
    fields: tuple[tuple[str, int | None], ...]
    unit: float | Literal["gap"] = dataclasses.field(default=0.0, compare=False)


def parameters_of(spec: mujoco.MjSpec, scene: ReducedScene, limited: frozenset[str]) -> tuple[Parameter, ...]:
    """Return the parameters of a scene: of joints, loops, reached limits and controlled actuators.

    Args:
        spec: of the scene.
        scene: the same, compiled.
        limited: joints that were at a limit.
    """
    model, parameters = scene.model, list[Parameter]()
    inertia = _inertia(model, scene.start[0])
    free = [
        model.joint(j).name
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in SINGLE and model.joint(j).name not in scene.drive
    ]
    joint_inertia = lambda name: float(inertia[int(model.joint(name).dofadr[0])])  # noqa: E731
    for names in _groups(free, lambda name: _joint_signature(model, name, joint_inertia(name))):
        parameters += _of_joints(model, names, joint_inertia(names[0]))
    loops = [equality.name for equality in spec.equalities if equality.active]
    for names in _groups(loops, lambda name: _constraint_signature(model, "equality", name)):
        parameters += _of_rows("equality", names, "eq_solref", "eq_solimp")
    limits = [name for name in free if name in limited and model.jnt_limited[model.joint(name).id]]
    for names in _groups(
        limits, lambda name: (*_constraint_signature(model, "joint", name), f"{joint_inertia(name):.4g}")
    ):
        parameters += _of_rows("joint", names, "jnt_solref", "jnt_solimp")
    for name in scene.ctrl:
        parameters += _of_actuator(model, name)
    return tuple(parameters)


def with_parameters(model: mujoco.MjModel, parameters: Sequence[Parameter], values: Array) -> mujoco.MjModel:
    """Return a copy of a model with parameters changed by values (k,)."""
    model = copy.copy(model)
    for parameter, value in zip(parameters, values, strict=True):
        rows = _addresses(model, parameter)
        for field, column in parameter.fields:
            array = getattr(model, field)
            index = rows if column is None else (rows, column)
            if parameter.unit == "gap":
                array[index] = 1.0 - np.clip((1.0 - array[index]) * np.exp(value), 1.0 - IMPEDANCES[1], 1.0)
                array[index] = np.clip(array[index], *IMPEDANCES)
            elif parameter.unit:
                array[index] += parameter.unit * value
            else:
                array[index] *= np.exp(value)
    model.dof_armature[:] = np.maximum(model.dof_armature, 0.0)
    model.dof_damping[:] = np.maximum(model.dof_damping, 0.0)
    # the compliance of constraints scales with the inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def set_in_spec(spec: mujoco.MjSpec, parameters: Sequence[Parameter], values: Array) -> None:
    """Change parameters in a specification.

    Raises:
        NotApplicable: if an element is missing, as a loop that a polynomial replaces.
    """
    try:
        spec.copy_back(with_parameters(plainly_compiled(spec), parameters, values))
    except KeyError as error:
        raise NotApplicable(str(error.args[0])) from None


def _inertia(model: mujoco.MjModel, qpos: Array) -> Array:
    """Return the diagonal of the mass matrix, (nv,)."""
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return np.diag(full).copy()


def _groups(names: Sequence[str], signature: Callable[[str], tuple[str, ...]]) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, ...], list[str]] = {}
    for name in names:
        groups.setdefault(signature(name), []).append(name)
    return [tuple(group) for group in groups.values()]


def _joint_signature(model: mujoco.MjModel, name: str, inertia: float) -> tuple[str, ...]:
    joint = model.joint(name)
    values = (inertia, joint.armature[0], joint.damping[0], joint.stiffness[0], joint.qpos_spring[0])
    return tuple(f"{float(value):.4g}" for value in values)


def _constraint_signature(model: mujoco.MjModel, kind: str, name: str) -> tuple[str, ...]:
    element = getattr(model, kind)(name)
    return (str(element.type), str(element.solref), str(element.solimp))


def _of_joints(model: mujoco.MjModel, names: tuple[str, ...], inertia: float) -> list[Parameter]:
    step = float(model.opt.timestep)
    parameters = [
        Parameter("freedom", names, (("dof_armature", None),), inertia),
        Parameter("freedom", names, (("dof_damping", None),), inertia / step),
    ]
    if model.joint(names[0]).stiffness[0]:
        parameters += [
            Parameter("joint", names, (("jnt_stiffness", None),)),
            Parameter("coordinate", names, (("qpos_spring", None),), 1.0),
        ]
    return parameters


def _of_rows(element: ElementKind, names: tuple[str, ...], reference: str, impedance: str) -> list[Parameter]:
    return [
        Parameter(element, names, ((reference, 0),)),
        Parameter(element, names, ((reference, 1),)),
        Parameter(element, names, ((impedance, 0),), "gap"),
        Parameter(element, names, ((impedance, 1),), "gap"),
    ]


def _of_actuator(model: mujoco.MjModel, name: str) -> list[Parameter]:
    parameters = [Parameter("actuator", (name,), (("actuator_gainprm", 0),))]
    actuator = model.actuator(name)
    if int(actuator.biastype[0]) == AFFINE:
        gain = float(actuator.biasprm[1])
        parameters[0] = Parameter("actuator", (name,), (("actuator_gainprm", 0), ("actuator_biasprm", 1)))
        parameters.append(Parameter("actuator", (name,), (("actuator_biasprm", 2),)))
        parameters.append(Parameter("actuator", (name,), (("actuator_biasprm", 0),), 0.01 * abs(gain) or 1.0))
    return parameters


def _addresses(model: mujoco.MjModel, parameter: Parameter) -> list[int]:
    """Return the row indices of a parameter's arrays."""
    if parameter.element in ("freedom", "coordinate"):
        field = "dofadr" if parameter.element == "freedom" else "qposadr"
        return [int(getattr(model.joint(name), field)[0]) for name in parameter.names]
    return [int(getattr(model, parameter.element)(name).id) for name in parameter.names]
