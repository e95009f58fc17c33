"""Components of the difference between a stepped run and candidate data: formula, compliance, step, drive."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.model.motion_laws import CrankProfile
from mechsim.model.quantity import Quantity
from mechsim.numerics.angles import REVOLUTION, wrapped
from mechsim.numerics.arrays import Array
from mechsim.simulation.settings import Settings
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.misfit import Scales, candidate_errors
from mechsim.studies.motions import profile_of, simulated
from mechsim.studies.scene.errors import cubic_interpolation
from mechsim.studies.scene.own_settings import published_scene
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene

# steps per revolution of a generated model; ratio of the step sizes of the two runs
STEPS, STEP_RATIO = 1000, 4


@dataclass(frozen=True)
class RunAtInstants:
    """A run, and the exact motion at its driver positions.

    Attributes:
        exact: the exact motion at the run's own driver positions.
        values: quantities of the run, (n, k) each.
    """

    exact: EvaluationPoints
    values: tuple[Array, ...]


@dataclass(frozen=True)
class TwoRuns:
    """A run, and another one with a finer step and the same constraint compliance.

    Attributes:
        plain: the run.
        fine: the run with the finer step.
        requested: the exact motion at the motion laws of the drivers.
        how: description of the run.
    """

    plain: RunAtInstants
    fine: RunAtInstants
    requested: EvaluationPoints
    how: str


def runs_of(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    """Return two runs of a mechanism at evaluation points.

    Raises:
        MechsimError: for a mechanism that cannot be run.
    """
    if evaluation.time is None:
        raise InputError("the table has no times, so no run in time is possible")
    if evaluation.solver.source is not None:
        return _scene_runs(evaluation, quantity)
    return _own_runs(evaluation, quantity)


def _own_runs(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    """Return runs of the generated model of a mechanism, with a virtual drive inertia."""
    solver, samples = evaluation.solver, len(evaluation) - 1
    profile = _profile(evaluation)
    runs: list[RunAtInstants] = []
    for steps in (STEPS, STEP_RATIO * STEPS):
        run = simulated(solver, profile, settings=Settings(steps_per_turn=steps), samples=samples)
        if run.outcome == "diverged":
            raise InputError(f"{solver.name}: the run in time diverged")
        motion = run.motion
        exact = replace(
            evaluation, angle=motion.angle, speed=motion.speed, acceleration=motion.acceleration, solved=None
        )
        if motion.drivers:
            exact = replace(exact, solved=solver.solve_as(motion))
        values = replace(exact, solved=motion)
        runs.append(RunAtInstants(exact, tuple(values.exact(compared) for compared in quantity)))
    return TwoRuns(runs[0], runs[1], evaluation, f"the model of {solver.name}, {STEPS} steps a turn")


def _profile(evaluation: EvaluationPoints) -> CrankProfile:
    """Return the crank motion of the evaluation points."""
    solver, speed = evaluation.solver, float(evaluation.speed[0])
    if not solver.motion_laws.crank:
        return profile_of(solver, 1.0, 1.0)
    assert evaluation.time is not None
    fastest = float(np.abs(evaluation.speed).max()) * float(np.sign(speed or 1.0))
    return profile_of(solver, fastest, solver.period / REVOLUTION)


def _scene_runs(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    solver = evaluation.solver
    if solver.motion_laws.crank:
        raise InputError(f"{solver.name}: its drivers have no motion law")
    scene, controls = published_scene(solver)
    # the model with a finer step and unchanged constraint compliance
    fine = copy.copy(scene.model)
    step = float(fine.opt.timestep)
    if not int(fine.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        # MuJoCo limits the time constant by the coarser step; keep that compliance
        soft = fine.eq_solref[:, 0] > 0.0
        fine.eq_solref[soft, 0] = np.maximum(fine.eq_solref[soft, 0], 2.0 * step)
    fine.opt.timestep = step / STEP_RATIO
    how = f"{scene.path} as published, step {float(scene.model.opt.timestep) * 1e3:g} ms"
    runs = [
        _at_instants(scene, run_scene(scene, model, records=None), evaluation, quantity)
        for model in (None, fine)
    ]
    return TwoRuns(runs[0], runs[1], evaluation, f"{how}, {controls}")


def _at_instants(
    scene: UserScene, run: SceneRun, evaluation: EvaluationPoints, quantity: list[Quantity]
) -> RunAtInstants:
    """Return the values of a run of a scene at evaluation points, and the exact motion there."""
    solver, time = evaluation.solver, evaluation.time
    assert time is not None
    if run.broken:
        raise InputError(f"{solver.name}: {run.broken}")
    keep = run.time <= time[-1] + 2.0 * float(run.model.opt.timestep)
    qpos = cubic_interpolation(run.time[keep], run.qpos[keep], time)
    recorded = replace(run, time=time, qpos=qpos, qvel=np.zeros((len(time), run.qvel.shape[1])))
    # joint name -> coordinate (n,) of the hinges and slides of a scene
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    names = [joint.name for joint in scene.mechanism.joints[: run.model.njnt]]
    joints = {
        name: qpos[:, int(run.model.jnt_qposadr[i])]
        for i, name in enumerate(names)
        if int(run.model.jnt_type[i]) in single
    }
    drivers = {
        name: replace(
            motion,
            value=_nearest_revolution(joints[name], motion.value) if motion.unit == "rad" else joints[name],
        )
        for name, motion in evaluation.motion.joints.items()
        if name in solver.mechanism.drivers
    }
    record = replace(evaluation.motion, joints={**evaluation.motion.joints, **drivers})
    exact = replace(evaluation, solved=solver.solve_as(record))
    positions = dict(zip(scene.tracked, np.moveaxis(recorded.points, 1, 0), strict=True))
    values: list[Array] = []
    for compared in quantity:
        if compared.kind == "position":
            values.append(compared.select(positions[compared.subject]))
        elif compared.subject in joints:
            values.append(joints[compared.subject][:, None])
        else:
            raise InputError(f"a run of {solver.name} does not contain {compared.subject}")
    return RunAtInstants(exact, tuple(values))


def _nearest_revolution(value: Array, reference: Array) -> Array:
    return reference + wrapped(value - reference)


COMPONENTS = ("formula", "compliance", "time step", "drive", "rest")
KINDS = ("position", "joint")

# candidate values at other evaluation points
AskFunction = Callable[[EvaluationPoints], Sequence[Candidate]]


@dataclass(frozen=True)
class Attribution:
    """The difference of one quantity, split into components.

    Attributes:
        name: name of the quantity.
        unit: unit of all components.
        instant: crank angle in [rad], or time of motion laws in [s], of the largest difference.
        at_unit: unit of `instant`; "row" for a table without times.
        whole: largest difference between the run and the candidate.
        components: component -> its projection on the largest difference; they add up to `whole`.
        largest: component -> its own largest magnitude over all instants.
        how: description of the run.
    """

    name: str
    unit: str
    instant: float
    at_unit: str
    whole: float
    components: dict[str, float]
    largest: dict[str, float]
    how: str

    def as_dict(self) -> dict[str, Any]:
        """Return the attribution in the format of `mechsim validate --json`."""
        attribution_data = {"unit": self.unit, "whole": self.whole, "quantity": self.name, "at": self.instant}
        attribution_data["at_unit"] = self.at_unit
        return {**self.components, **attribution_data, "largest": self.largest, "run": self.how}

    @property
    def text(self) -> str:
        """The components in one line."""
        components = ", ".join(f"{name} {self.components[name]:.2g}" for name in COMPONENTS)
        return f"run against {self.name}: {self.whole:.2g} {self.unit} = {components}"


def attributions(
    evaluation: EvaluationPoints,
    candidates: Sequence[Candidate],
    scales: Scales,
    ask: AskFunction | None = None,
) -> list[Attribution]:
    """Split the differences between a run and candidates into components, the largest difference first.

    Args:
        evaluation: the mechanism and the instants.
        candidates: values to compare; only point positions and joint coordinates are used.
        scales: scales of the differences of different kinds.
        ask: evaluates the function at the drivers of the run; None for a table.

    Raises:
        MechsimError: for a mechanism that cannot be run.
    """
    positions = [candidate for candidate in candidates if candidate.quantity.kind in KINDS]
    if not positions:
        return []
    runs = runs_of(evaluation, [candidate.quantity for candidate in positions])
    at_run = None
    if ask is not None:
        at_run = {candidate.quantity.name: candidate for candidate in ask(runs.plain.exact)}
    results = [
        _attribution(runs, i, candidate, None if at_run is None else at_run[candidate.quantity.name])
        for i, candidate in enumerate(positions)
    ]
    return sorted(
        results,
        key=lambda result: (
            -result.whole
            / scales.scale(next(c.quantity for c in positions if c.quantity.name == result.name))
        ),
    )


def _attribution(runs: TwoRuns, i: int, candidate: Candidate, at_run: Candidate | None) -> Attribution:
    quantity = candidate.quantity

    def gap(first: Array, other: Array) -> Array:
        return candidate_errors(quantity, first, other)

    requested = runs.requested.exact(quantity)
    plain, fine = (run.exact.exact(quantity) for run in (runs.plain, runs.fine))
    run, finer = runs.plain.values[i], runs.fine.values[i]
    whole = gap(run, candidate.values)
    soft = gap(finer, fine)
    components = {
        "formula": gap(requested, candidate.values) if at_run is None else gap(plain, at_run.values),
        "compliance": soft,
        "time step": gap(gap(run, plain), soft),
        "drive": gap(plain, requested),
    }
    components["rest"] = gap(whole, np.sum([*components.values()], axis=0))
    lengths = np.linalg.norm(whole, axis=1)
    index = int(np.argmax(lengths))
    along = whole[index] / lengths[index] if lengths[index] > 0.0 else np.zeros(whole.shape[1])
    instants = runs.requested.instants
    return Attribution(
        name=quantity.name,
        unit=quantity.unit,
        instant=float(instants.value[index]),
        at_unit=instants.unit,
        whole=float(lengths[index]),
        components={name: float(difference[index] @ along) for name, difference in components.items()},
        largest={
            name: float(np.linalg.norm(difference, axis=1).max()) for name, difference in components.items()
        },
        how=runs.how,
    )


def attribution_data(
    evaluation: EvaluationPoints, candidates: Sequence[Candidate], scales: Scales, ask: AskFunction | None
) -> dict[str, Any]:
    """Return the attributions as plain data, the largest difference on top; a note if there is no run."""
    try:
        results = attributions(evaluation, candidates, scales, ask)
    except MechsimError as error:
        return {"note": str(error)}
    if not results:
        return {}
    return {
        **results[0].as_dict(),
        "says": results[0].text,
        "quantities": {result.name: result.as_dict() for result in results},
    }
