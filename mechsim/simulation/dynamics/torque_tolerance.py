"""Steps a turn that a tolerance of torque and joint forces needs, and the proof that they keep it.

Two estimates that know nothing of each other nor of a closed form: the same crank motion pose by pose,
whose inverse dynamics has no error of time; and half the steps, whose distance from the whole number
falls with the order observed. The worse of the two counts.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.force_record import ForceRecord
from mechsim.numerics.arrays import Array, rms, worst
from mechsim.numerics.convergence import plausible_order
from mechsim.simulation.dynamics.determinacy import DeterminedComponents, determined_components
from mechsim.simulation.dynamics.inverse_dynamics import inverse_dynamics
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.result import Driven
from mechsim.simulation.tolerance import (
    MAX_STEPS,
    TARGET_FRACTION,
    Attempt,
    rounded,
    run_within_tolerance,
    steps_for,
)

# instants compared in a turn of a trial; halving asks for multiples of twice as many steps
TRIAL_SAMPLES = 24
# of steps a turn multiples are taken that can be halved and recorded evenly; steps of the two trials
EVEN = 2 * TRIAL_SAMPLES
TRIALS = (2 * EVEN, 4 * EVEN)
# a torque that is a smaller part of the energy of motion counts as none
IDLE = 1e-3
# crank accelerations of two runs that are nearer than this part of the speed squared are the same
SAME_TOLERANCE = 1e-8


def within(
    loaded: LoadedModel,
    tolerance: float,
    whole: Callable[[int], Driven],
    trial: Callable[[int], Driven],
) -> Driven:
    """Return a run whose torque and reactions keep a tolerance, or the best there is; with its promise.

    Errors of torque are parts of its root mean square over the run; those of forces parts of the
    largest root mean square of any joint's force; those of moments parts of that times the mechanism's
    size. The estimates of the promise: `torque` and `reactions`, of what rigid links determine, against
    solved poses; `halving`, the larger of both by halving the steps.

    Args:
        loaded: the mechanism.
        tolerance: relative, as above.
        whole: steps a turn -> the run asked for.
        trial: steps a turn -> a run of the same crank motion, one turn of it where its speed is steady,
            recorded at `TRIAL_SAMPLES` instants a turn.
    """
    determined = determined_components(loaded)
    runs = [trial(steps) for steps in TRIALS]
    first, second = (max(against_poses(loaded, run, determined)) for run in runs)
    order = plausible_order(first, second, TRIALS[1] / TRIALS[0])

    def attempt(steps: int) -> Attempt[Driven]:
        run = whole(steps)
        torque, reactions = against_poses(loaded, run, determined)
        halving, spent = np.inf, 0
        if run.outcome == "done":
            coarse, fine = trial(steps // 2), trial(steps)
            halving = _halved(loaded, coarse, fine, determined) / (2.0**order - 1.0)
            spent = coarse.steps + fine.steps
        estimates = {"torque": torque, "reactions": reactions, "halving": halving}
        return Attempt(run=run, steps=run.steps, estimates=estimates, order=order, trials=spent)

    run, report = run_within_tolerance(
        attempt,
        tolerance,
        rounded(steps_for(TRIALS[1], second, TARGET_FRACTION * tolerance, order), EVEN),
        _reason,
        trials=sum(trial.steps for trial in runs),
        trial_steps=TRIALS[1],
        multiple=EVEN,
    )
    outcome = "diverged" if run.outcome == "diverged" else "failed"
    return replace(run, outcome="passed" if report.satisfied else outcome, tolerance_report=report)


def _reason(steps: int, estimate: float) -> str:
    """Return why a tolerance is not kept."""
    if steps >= MAX_STEPS:
        return f"{MAX_STEPS} steps a turn, the most that are spent, leave {estimate:.2g}"
    return (
        f"{steps} steps a turn are no better than fewer: {estimate:.2g} is left of rounding and of "
        "how softly loops are held; solved poses have neither (method pose)"
    )


def against_poses(loaded: LoadedModel, run: Driven, determined: DeterminedComponents) -> tuple[float, float]:
    """Return the errors of torque and reactions of a stepped run relative to solved poses."""
    try:
        true = _posed(loaded, run)
    except AssemblyError:
        # a pose that does not close says nothing of the forces there
        return np.inf, np.inf
    return _errors(loaded, _gaps(loaded, run.forces, true, determined), true)


def _halved(loaded: LoadedModel, coarse: Driven, fine: Driven, determined: DeterminedComponents) -> float:
    """Return how far torque or reactions of two runs are apart at the same instants.

    Where the drive is not steady its acceleration differs from run to run; that is no error of the
    forces, and what solved poses make of it is taken off.
    """
    if "diverged" in (coarse.outcome, fine.outcome):
        return np.inf
    gaps = _gaps(loaded, coarse.forces, fine.forces, determined)
    true = fine.forces
    change = np.abs(coarse.motion.acceleration - fine.motion.acceleration).max()
    if change > SAME_TOLERANCE * np.abs(fine.motion.speed).max() ** 2:
        estimate, true = _posed(loaded, coarse), _posed(loaded, fine)
        driven = _gaps(loaded, estimate, true, determined)
        gaps = [(kind, gap - moved) for (kind, gap), (_, moved) in zip(gaps, driven, strict=True)]
    return max(_errors(loaded, gaps, true))


def _posed(loaded: LoadedModel, run: Driven) -> ForceRecord:
    """Return what the crank motion of a run needs, by solved poses."""
    motion = run.motion
    if run.outcome == "diverged" or motion.time is None:
        raise AssemblyError("the run diverged")
    return inverse_dynamics(loaded, motion.time, motion.angle, motion.speed, motion.acceleration).forces


def _gaps(
    loaded: LoadedModel, estimate: ForceRecord, true: ForceRecord, determined: DeterminedComponents
) -> list[tuple[str, Array]]:
    """Return the differences of torque [N m], and of forces and moments over the size [N]; (n, k) each."""
    length = loaded.mechanism.characteristic_length
    # where a joint with dry friction turns round, forces jump from one value to another
    fair = (estimate.sliding == true.sliding).all(1)[:, None]
    gaps = [("torque", (estimate.torque - true.torque)[:, None])]
    for name, expected in true.reactions.items():
        other = estimate.reactions[name]
        gaps.append(("force", np.where(determined[name][:3], other.force - expected.force, 0.0)))
        gaps.append(("force", np.where(determined[name][3:], (other.moment - expected.moment) / length, 0.0)))
    gaps += [
        ("force", (estimate.gears[name] - expected)[:, None] / length)
        for name, expected in true.gears.items()
    ]
    return [(kind, np.where(fair, gap, 0.0)) for kind, gap in gaps]


def _errors(loaded: LoadedModel, gaps: list[tuple[str, Array]], true: ForceRecord) -> tuple[float, float]:
    """Return the largest errors of torque and of reactions, as in `within`."""
    torque = max(rms(true.torque), IDLE * worst(true.kinetic))
    force = max(rms(np.linalg.norm(reaction.force, axis=1)) for reaction in true.reactions.values())
    scale = {"torque": torque, "force": force or torque / loaded.mechanism.characteristic_length}
    errors = dict.fromkeys(scale, 0.0)
    for kind, gap in gaps:
        errors[kind] = max(errors[kind], worst(np.linalg.norm(gap, axis=1)) / scale[kind])
    return errors["torque"], errors["force"]
