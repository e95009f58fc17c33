"""Sources of the distance between a run in time and candidate values: formula, compliance, step, drive."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.model.motion_laws import CrankProfile
from mechsim.model.quantities import Quantity
from mechsim.numerics.angles import REVOLUTION, wrapped
from mechsim.numerics.arrays import Array
from mechsim.simulation import Settings
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.misfit import Scales, candidate_errors
from mechsim.studies.reference import profile_of, simulated
from mechsim.studies.scene.errors import cubic_interpolation
from mechsim.studies.scene.published_run import published_scene
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene
from mechsim.subjects.mjcf_source import MjcfForm

# steps a turn of a mechanism's own model, and how much finer the second run is
STEPS, FINER = 1000, 4


@dataclass(frozen=True)
class RunAtInstants:
    """A run, and what is exact where its drivers were.

    Attributes:
        exact: the exact motion at the run's own drivers.
        values: what the run had of each quantity, (n, k) each.
    """

    exact: EvaluationPoints
    values: tuple[Array, ...]


@dataclass(frozen=True)
class TwoRuns:
    """A run as it is, and one with a finer step and loops as soft.

    Attributes:
        plain: the run.
        fine: with the finer step.
        requested: the exact motion at the motion laws of the drivers.
        how: what was run, in words.
    """

    plain: RunAtInstants
    fine: RunAtInstants
    requested: EvaluationPoints
    how: str


def runs_of(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    """Return two runs of a mechanism at evaluation points.

    Raises:
        MechsimError: where it cannot be run; says why.
    """
    if evaluation.time is None:
        raise InputError("the table has no times, so that nothing is run in time")
    if isinstance(evaluation.solver, MjcfForm) and evaluation.solver.source is not None:
        return _scene_runs(evaluation, quantity)
    return _own_runs(evaluation, quantity)


def _own_runs(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    """Return runs of the model that mechsim makes of a mechanism, with a virtual drive inertia."""
    solver, samples = evaluation.solver, len(evaluation) - 1
    profile = _profile(evaluation)
    runs: list[RunAtInstants] = []
    for steps in (STEPS, FINER * STEPS):
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
    """Return the motion of the crank from which evaluation points were taken."""
    solver, speed = evaluation.solver, float(evaluation.speed[0])
    if not solver.motion_laws.crank:
        return profile_of(solver, 1.0, 1.0)
    assert evaluation.time is not None
    fastest = float(np.abs(evaluation.speed).max()) * float(np.sign(speed or 1.0))
    return profile_of(solver, fastest, solver.period / REVOLUTION)


def _scene_runs(evaluation: EvaluationPoints, quantity: list[Quantity]) -> TwoRuns:
    solver = evaluation.solver
    assert isinstance(solver, MjcfForm)
    assert solver.source is not None
    if solver.motion_laws.crank:
        raise InputError(f"{solver.name}: no motion law says how its drivers move in time")
    scene, controls = published_scene(solver)
    fine = _finer(scene)
    how = f"{scene.path} as published, step {float(scene.model.opt.timestep) * 1e3:g} ms"
    runs = [
        _at_instants(scene, run_scene(scene, model, records=None), evaluation, quantity)
        for model in (None, fine)
    ]
    return TwoRuns(runs[0], runs[1], evaluation, f"{how}, {controls}")


def _finer(scene: UserScene) -> mujoco.MjModel:
    """Return a scene's model with a finer step, and loops as soft as they are with its own."""
    model = copy.copy(scene.model)
    step = float(model.opt.timestep)
    if not int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_REFSAFE):
        # the coarser step limits the time constant; that is compliance
        soft = model.eq_solref[:, 0] > 0.0
        model.eq_solref[soft, 0] = np.maximum(model.eq_solref[soft, 0], 2.0 * step)
    model.opt.timestep = step / FINER
    return model


def _at_instants(
    scene: UserScene, run: SceneRun, evaluation: EvaluationPoints, quantity: list[Quantity]
) -> RunAtInstants:
    """Return the values of a run of a scene at evaluation points, and the exact motion there."""
    solver, time = evaluation.solver, evaluation.time
    assert isinstance(solver, MjcfForm)
    assert time is not None
    if run.broken:
        raise InputError(f"{solver.name}: {run.broken}")
    keep = run.time <= time[-1] + 2.0 * float(run.model.opt.timestep)
    qpos = cubic_interpolation(run.time[keep], run.qpos[keep], time)
    recorded = replace(run, time=time, qpos=qpos, qvel=np.zeros((len(time), run.qvel.shape[1])))
    joints = _coordinates(scene, run.model, qpos)
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
            raise InputError(f"a run of {solver.name} does not give {compared.subject}")
    return RunAtInstants(exact, tuple(values))


def _coordinates(scene: UserScene, model: mujoco.MjModel, qpos: Array) -> Mapping[str, Array]:
    """Return the hinges and slides of a scene by their names, (n,) each."""
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    names = [joint.name for joint in scene.mechanism.joints[: model.njnt]]
    return {
        name: qpos[:, int(model.jnt_qposadr[i])]
        for i, name in enumerate(names)
        if int(model.jnt_type[i]) in single
    }


def _nearest_revolution(value: Array, reference: Array) -> Array:
    return reference + wrapped(value - reference)


COMPONENTS = ("formula", "compliance", "time step", "drive", "rest")
KINDS = ("position", "joint")

# candidate values at other evaluation points
AskFunction = Callable[[EvaluationPoints], Sequence[Candidate]]


@dataclass(frozen=True)
class Attribution:
    """The distance of one quantity, taken apart.

    Attributes:
        name: of the quantity.
        unit: of all components.
        instant: crank angle in [rad], or time of motion laws in [s], where the distance is largest.
        at_unit: of it; "row" where a table has no times.
        whole: the largest distance between run and claim.
        components: component -> its displacement of the run from the candidate there, along the
            distance: they add up to it.
        largest: component -> the most that it is anywhere, by itself.
        how: what was run.
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
        """Return it as `mechsim validate --json` prints it."""
        attribution_data = {"unit": self.unit, "whole": self.whole, "quantity": self.name, "at": self.instant}
        attribution_data["at_unit"] = self.at_unit
        return {**self.components, **attribution_data, "largest": self.largest, "run": self.how}

    @property
    def text(self) -> str:
        """The parts in one line."""
        components = ", ".join(f"{name} {self.components[name]:.2g}" for name in COMPONENTS)
        return f"run against {self.name}: {self.whole:.2g} {self.unit} = {components}"


def attributions(
    evaluation: EvaluationPoints,
    candidates: Sequence[Candidate],
    scales: Scales,
    ask: AskFunction | None = None,
) -> list[Attribution]:
    """Return where the distances between a run and claims come from, the largest first.

    Args:
        evaluation: what moves, and when.
        candidates: what is said of it; places of points and coordinates of joints count.
        scales: by which distances of several kinds are compared.
        ask: evaluates the function at the drivers of the run; None for a table.

    Raises:
        MechsimError: where nothing can be run; says why.
    """
    positions = [candidate for candidate in candidates if candidate.quantity.kind in KINDS]
    if not positions:
        return []
    runs = runs_of(evaluation, [candidate.quantity for candidate in positions])
    at_run = None
    if ask is not None:
        at_run = {candidate.quantity.name: candidate for candidate in ask(runs.plain.exact)}
    results = [
        _of_one(runs, i, candidate, None if at_run is None else at_run[candidate.quantity.name])
        for i, candidate in enumerate(positions)
    ]
    return sorted(
        results,
        key=lambda result: (
            -result.whole
            / scales.scale(next(c.quantity for c in positions if c.quantity.name == result.name))
        ),
    )


def _of_one(runs: TwoRuns, i: int, candidate: Candidate, at_run: Candidate | None) -> Attribution:
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
    """Return the attribution of the quantity farthest off as plain data, with all; a note where none is."""
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
