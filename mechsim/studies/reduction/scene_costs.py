"""Costs of the elements of a user's scene: time and motion with each element switched or removed alone."""

from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.stepping import Progress, no_progress
from mechsim.studies.reduction.candidates import VISUAL_ONLY
from mechsim.studies.reduction.candidates.bodies import (
    NotApplicable,
    RemovalCandidate,
    count_text,
    set_spec_options,
    with_candidate,
)
from mechsim.studies.reduction.reduced_scene import Evidence, ReducedSceneEvaluator, observe
from mechsim.studies.scene.run import step_times
from mechsim.studies.scene.scene import UserScene

OFF, ON = mujoco.mjtDisableBit, mujoco.mjtEnableBit
INTEGRATORS = ("EULER", "IMPLICITFAST", "IMPLICIT", "RK4")
SOLVERS = ("NEWTON", "CG", "PGS")
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
    tried = {"as it is": evaluator.full}
    for candidate in _candidates(observed):
        try:
            tried[candidate.what] = evaluator.scene(with_candidate(evaluator.spec, candidate))
        except (NotApplicable, ValueError):
            continue
    times = step_times([(candidate, candidate.model) for candidate in tried.values()], rounds, progress)
    return [
        SceneCost(
            what,
            int(candidate.model.nv),
            _rows(candidate.model, candidate.start[0]),
            1e6 * float(seconds * candidate.model.opt.timestep),
            float(seconds / times[0]),
            evaluator.errors(candidate, compare_forces=False).trajectory,
        )
        for (what, candidate), seconds in zip(tried.items(), times, strict=True)
    ]


def _candidates(observed: Evidence) -> list[RemovalCandidate]:
    """Return all elements and options of a scene that can be switched or removed."""
    option = observed.spec.option
    candidates = [
        _flag("contacts", "disableflags", int(OFF.mjDSBL_CONTACT), option.disableflags, disables=True),
        _flag("islands", "disableflags", int(OFF.mjDSBL_ISLAND), option.disableflags, disables=True),
        _flag("energy", "enableflags", int(ON.mjENBL_ENERGY), option.enableflags, disables=False),
    ]
    if observed.spec.sensors:
        candidates.append(
            _flag("sensors", "disableflags", int(OFF.mjDSBL_SENSOR), option.disableflags, disables=True)
        )
    for propose in VISUAL_ONLY:
        candidates += [
            replace(candidate, what=f"without {candidate.what}") for candidate in propose(observed)
        ]
    sparse = mujoco.mj_isSparse(observed.model)
    kind = mujoco.mjtJacobian.mjJAC_DENSE if sparse else mujoco.mjtJacobian.mjJAC_SPARSE
    what = f"{'dense' if sparse else 'sparse'} matrices"
    candidates.append(RemovalCandidate("options", what, partial(set_spec_options, jacobian=int(kind))))
    for field, names, kinds, prefix in (
        ("integrator", INTEGRATORS, mujoco.mjtIntegrator, "mjINT_"),
        ("solver", SOLVERS, mujoco.mjtSolver, "mjSOL_"),
    ):
        for name in names:
            value = getattr(kinds, prefix + name)
            if int(getattr(option, field)) != int(value):
                edit = partial(set_spec_options, **{field: int(value)})
                candidates.append(RemovalCandidate("options", f"{field} {name}", edit))
    loops = [candidate.name for candidate in observed.spec.equalities if candidate.active]
    if loops:
        what = f"without {count_text(len(loops), 'loop')}"
        candidates.append(RemovalCandidate("rows", what, _no_loops))
    return candidates


def _flag(what: str, field: str, bit: int, flags: int, *, disables: bool) -> RemovalCandidate:
    """Return the candidate that toggles a flag."""
    enabled = bool(flags & bit) != disables
    return RemovalCandidate(
        "flags", f"{what} {'off' if enabled else 'on'}", partial(set_spec_options, **{field: flags ^ bit})
    )


def _no_loops(spec: mujoco.MjSpec) -> None:
    for equality in list(spec.equalities):
        spec.delete(equality)


def _rows(model: mujoco.MjModel, qpos: np.ndarray) -> int:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return int(data.nefc)
