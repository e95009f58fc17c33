"""The number of steps that a position tolerance requires: estimated by short trials, verified by the run.

Steps are counted per revolution, or over the whole of a shorter motion. Measured in
validation/choices/tolerance_study.py.
"""

from dataclasses import replace

import numpy as np

from mechsim.errors import BudgetError
from mechsim.numerics.arrays import REVOLUTION, TINY
from mechsim.numerics.convergence import plausible_order, refine
from mechsim.simulation.configurations import lag_distance
from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.result import Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.tolerance import (
    MAX_STEPS,
    MIN_FACTOR,
    TARGET_FRACTION,
    NextSteps,
    improving_compliance,
    rounded,
    steps_for,
)

# steps per cycle of the first trial, and the minimum of any run
TRIAL_STEPS, MIN_STEPS = 100, 24
# fraction of the revolutions in a trial with fewer steps than the first, and limits of their number
TRIAL_FRACTION, TRIAL_TURNS = 0.2, (2.0, 20.0)
# ratio of the errors of successive revolutions above which errors grow instead of levelling off;
# in the study's trials of two revolutions: levelling off up to 2.7, growing from 4.4
MAX_GROWTH = 3.5
# fraction of the first trial's steps from which all mechanisms of the study converge; and the fraction above
# which a second estimate saves less than a failed run would cost
CONVERGED_FRACTION, WORTHWHILE_FRACTION = 0.75, 0.6
# steps of a whole motion up to which the maximum per revolution may be exceeded: a linkage that passes a
# nearly singular pose 450 times as fast as its crank requires a million (verdicts.py --case 235)
MAX_STEPS_OF_MOTION = 2_000_000


def run_within(driven: DrivenRun, settings: Settings, tolerance: float) -> Run:
    """Return a run, with its outcome, whose number of steps is chosen for a tolerance in [m]."""
    settings, first = steps_needed(driven, settings, tolerance)
    run = _run_to_tolerance(driven, settings, tolerance, first)
    if run.outcome == "failed" and (driven.budget is None or driven.budget.affords(run.seconds)):
        try:
            run = _with_other_compliance(driven, settings, run)
        except BudgetError as error:
            run = replace(run, shortfall=f"{run.shortfall}; other compliances: {error}")
    return replace(run, note=_joined(run.note, run.shortfall, _lag_note(driven, run)))


def _joined(*notes: str) -> str:
    return "; ".join(filter(None, notes))


def _lag_note(driven: DrivenRun, run: Run) -> str:
    """Return a note about the lag of the drivers behind their motion laws; empty within tolerance."""
    time = run.motion.time
    if driven.closed.loops.drivers is None or time is None or run.outcome != "passed":
        return ""
    distance = lag_distance(driven.closed, run.motion, driven.profile.state(time)[0])
    if distance <= run.tolerance:
        return ""
    return (
        f"positions differ by up to {distance:.2g} m from those of the motion laws at the same time: the "
        "drivers lag, which this tolerance does not include; the lag falls with the square of the steps"
    )


def _with_other_compliance(driven: DrivenRun, settings: Settings, run: Run) -> Run:
    """Return a run with a compliance that satisfies the tolerance; if the user set one, only suggest it."""
    steps = round(run.steps * driven.cycle / driven.profile.turns)
    tolerance, attempts = run.tolerance, list[Run]()

    def error(compliance: float) -> float:
        tried = replace(_with_steps(driven, settings, steps), compliance=compliance)
        attempts.append(driven.stepped(tried, tolerance))
        return attempts[-1].estimate

    improvement = improving_compliance(error, settings.compliance_used, run.estimate, tolerance)
    if improvement is None:
        return run
    compliance, remaining = improvement
    if settings.compliance is not None:
        return replace(
            run, shortfall=f"{run.shortfall}, and by compliance {compliance:.2g} {remaining:.2g} m"
        )
    note = (
        f"loops have compliance {compliance:.2g}: "
        f"{settings.compliance_used:.2g} leaves a position error of {run.estimate:.2g} m"
    )
    better = attempts[-1]
    if better.outcome != "passed":
        better = _run_to_tolerance(driven, replace(settings, compliance=compliance), tolerance, steps)
    return replace(better, note=_joined(better.note, note))


def _run_to_tolerance(driven: DrivenRun, settings: Settings, tolerance: float, first: int) -> Run:
    """Return the run that satisfies a tolerance, or has the smallest error and states how far it is off."""
    max_steps = max(MAX_STEPS, int(MAX_STEPS_OF_MOTION * driven.cycle / driven.profile.turns))
    following = NextSteps(TARGET_FRACTION * tolerance, _trial_steps(driven), max_steps)

    def attempt(steps: int) -> Run:
        return driven.stepped(_with_steps(driven, settings, steps), tolerance)

    result = refine(attempt, first, following, tolerance, driven.budget)
    run, steps = result.best, round(result.level / driven.cycle)
    if run.estimate <= tolerance:
        return run
    reason = f"{steps} steps a turn leave a position error of {run.estimate:.2g} m"
    return replace(run, shortfall=_joined(result.ended, reason))


def steps_needed(driven: DrivenRun, settings: Settings, tolerance: float) -> tuple[Settings, int]:
    """Return settings and the steps per cycle that a tolerance requires."""
    short, trial = driven.over_first_turns(1.0), _trial_steps(driven)
    error = float(short.errors_by_turn(_with_steps(driven, settings, trial)).max())
    if not np.isfinite(error):
        return _after_diverging(driven, short, settings, tolerance)
    steps = _whole_steps(driven, steps_for(trial, error, TARGET_FRACTION * tolerance))
    trial_run = driven.over_first_turns(
        np.round(float(np.clip(TRIAL_FRACTION * driven.profile.turns, *TRIAL_TURNS)))
    )
    if steps >= CONVERGED_FRACTION * trial or trial_run.profile.turns > 0.5 * driven.profile.turns:
        return settings, steps
    # trials with so few steps do not show convergence or bounded errors
    previous, last = trial_run.errors_by_turn(_with_steps(driven, settings, steps))[-2:]
    if not last <= MAX_GROWTH * previous:
        return settings, trial
    # assume that an error with growth over the last revolution continues to grow
    predicted_error = last * max(1.0, last / max(previous, TINY)) ** 2
    if predicted_error > tolerance:
        order = plausible_order(last, error, trial / steps)
        steps = _whole_steps(driven, steps_for(steps, predicted_error, tolerance, order))
        steps = steps if steps <= WORTHWHILE_FRACTION * trial else trial
    return settings, steps


def _after_diverging(
    driven: DrivenRun, short: DrivenRun, settings: Settings, tolerance: float
) -> tuple[Settings, int]:
    """Return settings and the steps per cycle from trials after divergence of the first one.

    For a custom model the file's own time step is one of the trials. If all diverge, the last is softer: of a
    rod with a small inertia about its line, the rounding of stiff constraints turns it ever faster.
    """
    finer = {settings.steps_per_turn}
    if driven.closed.custom:
        cycle = driven.cycle * REVOLUTION / driven.profile.max_speed
        finer.add(round(min(cycle / float(driven.closed.model.opt.timestep), MAX_STEPS)))
    trials = [(settings, steps) for steps in sorted(finer) if steps > _trial_steps(driven)]
    if settings.compliance is None:
        softer = replace(settings, compliance=MIN_FACTOR * settings.compliance_used)
        trials.append((softer, settings.steps_per_turn))
    for tried, trial in trials:
        error = float(short.errors_by_turn(_with_steps(driven, tried, trial)).max())
        if np.isfinite(error):
            steps = _whole_steps(driven, steps_for(trial, error, TARGET_FRACTION * tolerance))
            return tried, max(trial, steps)
    return settings, settings.steps_per_turn


def _trial_steps(driven: DrivenRun) -> int:
    """Return the steps per cycle of the first trial."""
    return max(TRIAL_STEPS, driven.min_steps)


def _whole_steps(driven: DrivenRun, steps: float) -> int:
    return max(MIN_STEPS, driven.min_steps, rounded(steps))


def _with_steps(driven: DrivenRun, settings: Settings, steps: int) -> Settings:
    return replace(settings, steps_per_turn=round(steps / driven.cycle))
