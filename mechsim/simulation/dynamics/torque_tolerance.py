"""Steps per revolution for a tolerance of torque and joint forces, and the check that they satisfy it.

There are two estimates, independent of each other and of closed-form solutions. One compares with the same
crank motion solved pose by pose, whose inverse dynamics has no time-stepping error. The other compares with
half the steps; the difference falls with the observed order. The larger estimate counts.
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

# number of instants per revolution that trials compare; halving needs multiples of twice as many steps
TRIAL_SAMPLES = 24
# steps per revolution are multiples of EVEN, which can be halved and recorded evenly; steps of the two trials
EVEN = 2 * TRIAL_SAMPLES
TRIALS = (2 * EVEN, 4 * EVEN)
# minimum scale of torque errors, as a fraction of the largest kinetic energy; a smaller torque counts as zero
IDLE = 1e-3
# difference of crank accelerations, relative to the squared speed, up to which two runs have the same motion
SAME_TOLERANCE = 1e-8


def torque_within(
    loaded: LoadedModel,
    tolerance: float,
    whole: Callable[[int], Driven],
    trial: Callable[[int], Driven],
) -> Driven:
    """Return a run whose torque and reactions satisfy a tolerance, or the best run, with a tolerance report.

    Errors of torque are relative to its root mean square over the run. Errors of forces are relative to the
    largest root mean square of any joint's force. Errors of moments are relative to that force times the
    characteristic length. The report has the estimates `torque` and `reactions`, relative to solved poses,
    of components that rigid links determine. Its estimate `halving` is the larger of both from half the
    steps.

    Args:
        loaded: the mechanism and its forces.
        tolerance: relative, as above.
        whole: steps per revolution -> the requested run.
        trial: steps per revolution -> a run of the same crank motion, recorded at `TRIAL_SAMPLES` instants
            per revolution; only one revolution at constant speed.
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
    """Return why a tolerance is not satisfied."""
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
        # poses that do not close give no forces for a comparison
        return np.inf, np.inf
    return _errors(loaded, _gaps(loaded, run.forces, true, determined), true)


def _halved(loaded: LoadedModel, coarse: Driven, fine: Driven, determined: DeterminedComponents) -> float:
    """Return the largest difference of torque or reactions between two runs at the same instants.

    At variable speed the drive's acceleration differs from run to run, which is no error of the forces. Its
    effect on solved poses is subtracted.
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
    """Return the forces of a run's crank motion, by solved poses."""
    motion = run.motion
    if run.outcome == "diverged" or motion.time is None:
        raise AssemblyError("the run diverged")
    return inverse_dynamics(loaded, motion.time, motion.angle, motion.speed, motion.acceleration).forces


def _gaps(
    loaded: LoadedModel, estimate: ForceRecord, true: ForceRecord, determined: DeterminedComponents
) -> list[tuple[str, Array]]:
    """Return differences of torque [N m], of forces, and of moments per characteristic length [N], (n, k)."""
    length = loaded.mechanism.characteristic_length
    # forces jump where a joint with dry friction reverses
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
    """Return the largest errors of torque and of reactions, as in `torque_within`."""
    torque = max(rms(true.torque), IDLE * worst(true.kinetic))
    force = max(rms(np.linalg.norm(reaction.force, axis=1)) for reaction in true.reactions.values())
    scale = {"torque": torque, "force": force or torque / loaded.mechanism.characteristic_length}
    errors = dict.fromkeys(scale, 0.0)
    for kind, gap in gaps:
        errors[kind] = max(errors[kind], worst(np.linalg.norm(gap, axis=1)) / scale[kind])
    return errors["torque"], errors["force"]
