"""Components of the difference between a stepped run and candidate data: formula, compliance, step, drive."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.mechanism.quantity import Quantity
from mechsim.numerics.arrays import REVOLUTION, Array, wrapped
from mechsim.simulation.settings import Settings
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.comparison import Scales, candidate_errors
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.motions import profile_of, simulated
from mechsim.studies.scene.errors import cubic_interpolation
from mechsim.studies.scene.own_settings import published_scene
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene

# steps per revolution of a generated model; ratio of the step sizes of the two runs
STEPS, STEP_RATIO = 1000, 4


# the exact motion at a run's own driver positions, and quantities of the run, (n, k) each
RunAtInstants = tuple[EvaluationPoints, Sequence[Array]]


def _own_runs(
    evaluation: EvaluationPoints, quantities: Sequence[Quantity]
) -> tuple[list[RunAtInstants], str]:
    """Return runs of the generated model of a mechanism, with a virtual drive inertia."""
    solver, samples = evaluation.solver, len(evaluation) - 1
    fastest = float(np.abs(evaluation.speed).max()) * float(np.sign(evaluation.speed[0] or 1.0))
    profile = profile_of(solver, fastest, solver.period / REVOLUTION)
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
        runs.append((exact, replace(exact, solved=motion).all(quantities)))
    return runs, f"the model of {solver.name}, {STEPS} steps a turn"


def _scene_runs(
    evaluation: EvaluationPoints, quantities: Sequence[Quantity]
) -> tuple[list[RunAtInstants], str]:
    """Return runs of a file with its own settings."""
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
    runs = [run_scene(scene, model, records=None) for model in (None, fine)]
    return [_at_instants(scene, run, evaluation, quantities) for run in runs], f"{how}, {controls}"


def _at_instants(
    scene: UserScene, run: SceneRun, evaluation: EvaluationPoints, quantities: Sequence[Quantity]
) -> RunAtInstants:
    """Return the values of a run of a scene at evaluation points, and the exact motion there."""
    solver, time = evaluation.solver, evaluation.time
    assert time is not None
    if run.broken:
        raise InputError(f"{solver.name}: {run.broken}")
    keep = run.time <= time[-1] + 2.0 * float(run.model.opt.timestep)
    qpos = cubic_interpolation(run.time[keep], run.qpos[keep], time)
    recorded = replace(run, time=time, qpos=qpos, qvel=np.zeros((len(time), run.qvel.shape[1])))
    joints = recorded.coordinates
    moved = dict(evaluation.motion.joints)
    for name in moved.keys() & {*solver.mechanism.drivers}:
        off = joints[name] - moved[name].value
        # in the revolution of the motion law
        value = moved[name].value + (wrapped(off) if moved[name].unit == "rad" else off)
        moved[name] = replace(moved[name], value=value)
    exact = replace(evaluation, solved=solver.solve_as(replace(evaluation.motion, joints=moved)))
    positions = dict(zip(scene.tracked, np.moveaxis(recorded.points, 1, 0), strict=True))
    values: list[Array] = []
    for compared in quantities:
        if compared.kind == "position":
            values.append(compared.select(positions[compared.subject]))
        elif compared.subject in joints:
            values.append(joints[compared.subject][:, None])
        else:
            raise InputError(f"a run of {solver.name} does not contain {compared.subject}")
    return exact, values


COMPONENTS = ("formula", "compliance", "time step", "drive", "rest")
KINDS = ("position", "joint")

# candidate values at other evaluation points
AskFunction = Callable[[EvaluationPoints], Sequence[Candidate]]


def attribution_data(
    evaluation: EvaluationPoints, candidates: Sequence[Candidate], scales: Scales, ask: AskFunction | None
) -> dict[str, Any]:
    """Return the differences between a run and candidates as plain data, the largest on top.

    Args:
        evaluation: the mechanism and the instants.
        candidates: values to compare; only point positions and joint coordinates are used.
        scales: scales of the differences of different kinds.
        ask: evaluates the function at the drivers of the run; None for a table.

    Returns:
        The components; a note if there is no run, nothing without such candidates.
    """
    positions = [candidate for candidate in candidates if candidate.quantity.kind in KINDS]
    if not positions:
        return {}
    try:
        if evaluation.time is None:
            raise InputError("the table has no times, so no run in time is possible")
        runs_of = _own_runs if evaluation.solver.source is None else _scene_runs
        # a run, and another one with a finer step and the same compliance
        runs, how = runs_of(evaluation, [candidate.quantity for candidate in positions])
        claims = {} if ask is None else {claim.quantity.name: claim for claim in ask(runs[0][0])}
        results: list[dict[str, Any]] = [
            _attribution(evaluation, runs, i, candidate, claims.get(candidate.quantity.name)) | {"run": how}
            for i, candidate in enumerate(positions)
        ]
    except MechsimError as error:
        return {"note": str(error)}
    scale = {candidate.quantity.name: scales.scale(candidate.quantity) for candidate in positions}
    results.sort(key=lambda result: -result["whole"] / scale[result["quantity"]])
    first = results[0]
    components = ", ".join(f"{name} {first[name]:.2g}" for name in COMPONENTS)
    summary = f"run against {first['quantity']}: {first['whole']:.2g} {first['unit']} = {components}"
    return {**first, "says": summary, "quantities": {result["quantity"]: result for result in results}}


def _attribution(
    requested: EvaluationPoints,
    runs: Sequence[RunAtInstants],
    i: int,
    candidate: Candidate,
    at_run: Candidate | None,
) -> dict[str, Any]:
    """Return the components of the difference of the i-th candidate where it is largest, as plain data.

    `at_run` has its values at the run; `largest` has the largest size of each component.
    """
    quantity = candidate.quantity
    law = requested.exact(quantity)
    plain, fine = (exact.exact(quantity) for exact, _ in runs)
    run, finer = (values[i] for _, values in runs)
    gap = partial(candidate_errors, quantity)
    whole, soft = gap(run, candidate.values), gap(finer, fine)
    components = {
        "formula": gap(law, candidate.values) if at_run is None else gap(plain, at_run.values),
        "compliance": soft,
        "time step": gap(gap(run, plain), soft),
        "drive": gap(plain, law),
    }
    components["rest"] = gap(whole, np.sum([*components.values()], axis=0))
    lengths = np.linalg.norm(whole, axis=1)
    index = int(np.argmax(lengths))
    along = whole[index] / lengths[index] if lengths[index] > 0.0 else np.zeros(whole.shape[1])
    return {
        **{name: float(difference[index] @ along) for name, difference in components.items()},
        "unit": quantity.unit,
        "whole": float(lengths[index]),
        "quantity": quantity.name,
        "at": float(requested.instants.value[index]),
        "at_unit": requested.instants.unit,
        "largest": {
            name: float(np.linalg.norm(difference, axis=1).max()) for name, difference in components.items()
        },
    }
