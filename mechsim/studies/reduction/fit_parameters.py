"""Physical parameters of a scene, fitted so that longer time steps reproduce the motion of the full scene.

A longer step changes the motion: light bodies jump, constraints yield, servos react late. Fitted parameters
compensate for most of this. The fit uses two motions; a third one verifies it.
"""

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Literal

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.state import SCALAR, data_at, mass_matrix
from mechsim.studies.reduction.candidates.bodies import NotApplicable, RemovalCandidate
from mechsim.studies.reduction.candidates.stepping import (
    EULER,
    IMPEDANCES,
    IMPLICITFAST,
    LONGER_STEPS,
    set_longer_steps,
    stepping_text,
)
from mechsim.studies.reduction.reduced_scene import Evidence, ReducedSceneEvaluator
from mechsim.studies.scene.errors import deviation
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.scene import UserScene

AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
ElementKind = Literal["joint", "freedom", "coordinate", "equality", "actuator"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that several elements share.

    Attributes:
        element: kind of the elements.
        names: names of the elements in the specification; for "freedom" and "coordinate" those of their
            joints.
        fields: arrays of the model and their columns; None for one-dimensional arrays.
        unit: increment of the number per unit value. 0 multiplies the number by exp(value); "gap" multiplies
            one minus the number by exp(value).
    """

    element: ElementKind
    names: tuple[str, ...]
    fields: tuple[tuple[str, int | None], ...]
    unit: float | Literal["gap"] = dataclasses.field(default=0.0, compare=False)


def parameters_of(spec: mujoco.MjSpec, scene: UserScene, limited: frozenset[str]) -> tuple[Parameter, ...]:
    """Return the parameters of a scene's joints, loops, reached limits and controlled actuators.

    Args:
        spec: specification of the scene.
        scene: the compiled scene.
        limited: joints that reached a limit.
    """
    model, parameters = scene.model, list[Parameter]()
    inertia = np.diag(mass_matrix(data_at(model, scene.start[0])))
    free = [
        model.joint(j).name
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in SCALAR and model.joint(j).name not in scene.joint_laws
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
        NotApplicable: if an element is missing, such as a loop that another candidate replaces.
    """
    try:
        spec.copy_back(with_parameters(plainly_compiled(spec), parameters, values))
    except KeyError as error:
        raise NotApplicable(str(error.args[0])) from None


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


# processor time of one fit, in [s]
SECONDS = 30.0
# iterations between checks, and smallest relative reduction of the sum of squares by them for the fit to
# continue
MAX_ITERATIONS, MIN_COST_REDUCTION = 6, 0.1
# difference step of a parameter for the Jacobian; residual of a diverged run, in tolerances
DIFFERENCE_STEP, DIVERGED_RESIDUAL = 1e-6, 1e3
# effect of a unit change of a parameter, in tolerances, at or below which the parameter is dropped
MIN_EFFECT = 0.05
# fraction of the tolerance at which the fit stops
GOAL = 0.3
INTEGRATORS = (EULER, IMPLICITFAST)


@dataclass(frozen=True)
class Refit:
    """Longer steps and the parameters fitted to them.

    Attributes:
        candidate: the change of the scene.
        error: largest error over the fitted motions, in [m].
        values: parameter -> fitted value; the initial value for still longer steps.
    """

    candidate: RemovalCandidate
    error: float
    values: dict[Parameter, float]


@quiet()
def refit(
    evaluators: Sequence[ReducedSceneEvaluator],
    observed: Evidence,
    times: int,
    start: Mapping[Parameter, float],
) -> Refit | None:
    """Return longer steps for a scene, with parameters fitted to preserve the motion.

    Args:
        evaluators: evaluators of the full scene over the fitted motions.
        observed: observations of the scene with its own steps.
        times: ratio of the new step to the scene's own.
        start: parameter -> initial value; 0 for other parameters.

    Returns:
        The fit; None if it takes too long, or no parameter has an effect.
    """
    fits: list[_Fit] = []
    for kind in INTEGRATORS:
        spec = observed.spec.copy()
        set_longer_steps(spec, times, kind)
        fits.append(_Fit(evaluators, spec, observed, start))
    # the median, since light bodies jump at the start with any integrator
    best = min(fits, key=lambda fit: float(np.median(np.abs(fit.residuals(fit.start)))))
    if best.seconds > SECONDS or not best.drop_ineffective():
        return None
    values, worst = best.fitted()
    kind = int(best.spec.option.integrator)
    what = (
        f"{stepping_text(observed.spec, times, kind)}, and {len(best.parameters)} fitted parameters of "
        "inertia, dampers, springs, constraints and servos"
    )
    edit = partial(_refitted, times=times, integrator=kind, parameters=best.parameters, values=values)
    values_of = dict(zip(best.parameters, values.tolist(), strict=True))
    return Refit(RemovalCandidate(LONGER_STEPS, what, edit), worst * observed.tolerance, values_of)


def _refitted(
    spec: mujoco.MjSpec, times: int, integrator: int, parameters: Sequence[Parameter], values: Array
) -> None:
    set_longer_steps(spec, times, integrator)
    set_in_spec(spec, parameters, values)


class _Fit:
    """Least-squares fit of a scene's parameters to the full scene's motion."""

    def __init__(
        self,
        evaluators: Sequence[ReducedSceneEvaluator],
        spec: mujoco.MjSpec,
        observed: Evidence,
        start: Mapping[Parameter, float],
    ):
        self.spec, self.tolerance = spec, observed.tolerance
        self.runs = [(evaluator, evaluator.scene(spec)) for evaluator in evaluators]
        self.parameters = parameters_of(spec, self.runs[0][1], observed.limited)
        self.start = np.array([start.get(parameter, 0.0) for parameter in self.parameters])
        began = process_time()
        self.residuals(self.start)
        # processor time of one round of iterations
        self.seconds = MAX_ITERATIONS * len(self.parameters) * (process_time() - began)

    def drop_ineffective(self) -> bool:
        """Drop parameters without effect at the start; return whether any remains."""
        if not self.parameters:
            return False
        effects = np.abs(self._jacobian(self.start)).max(0) > MIN_EFFECT
        self.parameters = tuple(
            parameter for parameter, effective in zip(self.parameters, effects, strict=True) if effective
        )
        self.start = self.start[effects]
        return bool(effects.any())

    def fitted(self) -> tuple[Array, float]:
        """Return the best values, and the largest error with them in tolerances."""
        from scipy.optimize import least_squares

        ends, values, cost = process_time() + SECONDS, self.start, np.inf
        while True:
            solution = least_squares(self.residuals, values, jac=self._jacobian, max_nfev=MAX_ITERATIONS)  # pyright: ignore[reportArgumentType]
            values, worst = solution.x, self._worst(solution.x)
            if worst <= GOAL or process_time() > ends or solution.cost > (1.0 - MIN_COST_REDUCTION) * cost:
                return values, worst
            cost = float(solution.cost)

    def residuals(self, values: Array) -> Array:
        """Return deviations of tracked points from those of the full scene, in tolerances, flattened."""
        return np.concatenate([self._deviation(evaluator, scene, values) for evaluator, scene in self.runs])

    def _deviation(self, evaluator: ReducedSceneEvaluator, scene: UserScene, values: Array) -> Array:
        run = run_scene(
            replace(scene, model=with_parameters(scene.model, self.parameters, values)), records=None
        )
        if run.broken:
            steps = int(np.ceil(scene.duration / float(scene.model.opt.timestep) - 1e-6))
            return np.full(3 * len(scene.tracked) * (steps + 1), DIVERGED_RESIDUAL)
        return (deviation(run, evaluator.run) / self.tolerance).ravel()

    def _worst(self, values: Array) -> float:
        return float(np.linalg.norm(self.residuals(values).reshape(-1, 3), axis=1).max())

    def _jacobian(self, values: Array) -> Array:
        current = self.residuals(values)
        steps = DIFFERENCE_STEP * np.eye(len(values))
        return np.stack([(self.residuals(values + step) - current) / DIFFERENCE_STEP for step in steps], 1)
