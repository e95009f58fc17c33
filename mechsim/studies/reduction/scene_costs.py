"""Costs of the elements of a user's scene: time and motion with each element switched or removed alone."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco

from mechsim.errors import InputError
from mechsim.model.progress import Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.plain_settings import INTEGRATORS, SOLVERS, UNCHANGED, PlainSettings, settings_of
from mechsim.simulation.state import data_at
from mechsim.studies.reduction.candidates import VISUAL_ONLY
from mechsim.studies.reduction.candidates.bodies import (
    NotApplicable,
    RemovalCandidate,
    count_text,
    with_candidate,
)
from mechsim.studies.reduction.reduced_scene import Evidence, ReducedSceneEvaluator, observe
from mechsim.studies.scene.run import step_times
from mechsim.studies.scene.scene import UserScene

# default number of timing rounds, each of which runs every scene once
TIMING_ROUNDS = 11


@dataclass(frozen=True, slots=True)
class SceneCost:
    """The cost of one element or option.

    Attributes:
        what: description of the change; the first row of a table is the unchanged scene.
        dofs: number of degrees of freedom of the model.
        rows: number of constraint rows at the start.
        step: processor time of a step, in [us].
        ratio: ratio of this time to that of the unchanged scene.
        error: largest distance of a tracked point from its position in the unchanged scene, in [m].
    """

    JSON: ClassVar[tuple[str, ...]] = (
        "what",
        "dofs",
        "rows",
        "us_per_step=step",
        "time_ratio=ratio",
        "error",
    )

    what: str
    dofs: int
    rows: int
    step: float
    ratio: float
    error: float


@quiet()
def scene_costs(
    scene: UserScene,
    spec: mujoco.MjSpec,
    rounds: int = TIMING_ROUNDS,
    progress: Progress = no_progress,
) -> list[SceneCost]:
    """Return the costs of all elements and options of a scene over its motion; the unchanged scene is first.

    Args:
        scene: the scene and its motion.
        spec: specification of its file; not changed.
        rounds: number of timing rounds, each of which runs every scene once.
        progress: callback after each timing round.

    Raises:
        InputError: for a diverging scene.
    """
    evaluator = ReducedSceneEvaluator.from_scene(scene, spec)
    if evaluator.run.broken:
        raise InputError(f"{scene.path} diverges: {evaluator.run.broken}; repair it or shorten the motion")
    observed = observe(evaluator.spec, evaluator.full, evaluator.tracked_bodies, 0.0)
    full = evaluator.full
    tried = {"as it is": full}
    for what, settings in _changed_settings(full.model).items():
        tried[what] = replace(full, model=settings.applied(full.model))
    for candidate in _removals(observed):
        with suppress(NotApplicable, ValueError):
            reduced = evaluator.scene(with_candidate(evaluator.spec, candidate))
            tried[f"without {candidate.what}"] = reduced
    times = step_times([(candidate, candidate.model) for candidate in tried.values()], rounds, progress)
    return [
        SceneCost(
            what,
            int(candidate.model.nv),
            int(data_at(candidate.model, candidate.start[0]).nefc),
            1e6 * float(seconds * candidate.model.opt.timestep),
            float(seconds / times[0]),
            evaluator.errors(candidate, compare_forces=False).trajectory,
        )
        for (what, candidate), seconds in zip(tried.items(), times, strict=True)
    ]


def _changed_settings(model: mujoco.MjModel) -> dict[str, PlainSettings]:
    """Return the flags and options of a model that can be changed: description -> settings."""
    own = settings_of(model)
    flags = {"contacts": "contact", "islands": "island", "energy": "energy"}
    if model.nsensor:
        flags["sensors"] = "sensor"
    changes = {
        f"{what} {'off' if getattr(own, flag) else 'on'}": replace(
            UNCHANGED, **{flag: not getattr(own, flag)}
        )
        for what, flag in flags.items()
    }
    matrices = "dense" if mujoco.mj_isSparse(model) else "sparse"
    changes[f"{matrices} matrices"] = replace(UNCHANGED, jacobian=matrices)
    for name, values in (("integrator", INTEGRATORS), ("solver", SOLVERS)):
        others = [value for value in values if value != getattr(own, name)]
        changes |= {f"{name} {value}": replace(UNCHANGED, **{name: value}) for value in others}
    return changes


def _removals(observed: Evidence) -> list[RemovalCandidate]:
    """Return the elements of a scene that can be removed."""
    candidates = [candidate for propose in VISUAL_ONLY for candidate in propose(observed)]
    loops = sum(bool(equality.active) for equality in observed.spec.equalities)
    if loops:
        candidates.append(RemovalCandidate("rows", count_text(loops, "loop"), _no_loops))
    return candidates


def _no_loops(spec: mujoco.MjSpec) -> None:
    for equality in list(spec.equalities):
        spec.delete(equality)
