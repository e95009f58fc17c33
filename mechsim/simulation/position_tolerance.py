"""The number of steps that a position tolerance requires: estimated by short trials, verified by the run.

Steps are counted per revolution, or over the whole of a shorter motion. Measured in
validation/choices/tolerance_study.py.
"""

from dataclasses import replace

import numpy as np

from mechsim.errors import BudgetError
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.convergence import plausible_order
from mechsim.numerics.rounding import TINY
from mechsim.simulation.configurations import lag_distance
from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.result import Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.tolerance import (
    MAX_STEPS,
    MIN_FACTOR,
    TARGET_FRACTION,
    Attempt,
    ToleranceReport,
    improving_compliance,
    rounded,
    run_within_tolerance,
    steps_for,
)

# steps per cycle of the first trial, and the minimum of any run
TRIAL_STEPS, MIN_STEPS = 100, 24
# order of convergence of the default settings (measured in validation/choices/constraint_settings.py)
ORDER = 4.0
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
    settings, first, spent = steps_needed(driven, settings, tolerance)
    run, report = _run_to_tolerance(driven, settings, tolerance, first, spent)
    run = (
        _with_report(run, report)
        if run.outcome != "failed"
        else _with_affordable_compliance(driven, settings, run, report)
    )
    return replace(run, note="; ".join(note for note in (run.note, _lag_note(driven, run)) if note))


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


def _with_affordable_compliance(
    driven: DrivenRun, settings: Settings, run: Run, report: ToleranceReport
) -> Run:
    """Return the result of `_with_other_compliance`, or the run unchanged if the budget ends first."""
    budget = driven.budget
    if budget is not None and not budget.affords(run.seconds):
        return _with_report(run, report)
    try:
        return _with_other_compliance(driven, settings, run, report)
    except BudgetError as error:
        return _with_report(run, replace(report, reason=f"{report.reason}; other compliances: {error}"))


def _with_other_compliance(driven: DrivenRun, settings: Settings, run: Run, report: ToleranceReport) -> Run:
    """Return a run with a compliance that satisfies the tolerance; if the user set one, only suggest it."""
    steps = round(run.steps * driven.cycle / driven.profile.turns)
    tolerance, attempts = report.tolerance, list[Run]()

    def error(compliance: float) -> float:
        attempts.append(
            driven.stepped(replace(_with_steps(driven, settings, steps), compliance=compliance), tolerance)
        )
        return attempts[-1].estimate

    estimate = report.estimate
    improvement = improving_compliance(error, settings.compliance_used, estimate, tolerance)
    steps_spent = report.trials + sum(attempt.steps for attempt in attempts)
    if improvement is None:
        return _with_report(run, replace(report, trials=steps_spent))
    compliance, remaining = improvement
    if settings.compliance is not None:
        reason = f"{report.reason}, and by compliance {compliance:.2g} {remaining:.2g} m"
        return _with_report(run, replace(report, trials=steps_spent, reason=reason))
    note = (
        f"loops have compliance {compliance:.2g}: "
        f"{settings.compliance_used:.2g} leaves a position error of {estimate:.2g} m"
    )
    settings, steps_spent = replace(settings, compliance=compliance), steps_spent + run.steps
    if attempts[-1].outcome == "passed":
        final_report = replace(report, estimate=remaining, trials=steps_spent - run.steps, reason="")
        return _with_report(attempts[-1], final_report, note)
    return _with_report(*_run_to_tolerance(driven, settings, tolerance, steps, steps_spent), note)


def _with_report(run: Run, report: ToleranceReport, *notes: str) -> Run:
    """Return a run with its tolerance report and with notes added."""
    note = "; ".join(filter(None, (run.note, *notes, report.reason)))
    return replace(run, tolerance_report=report, note=note)


def _run_to_tolerance(
    driven: DrivenRun, settings: Settings, tolerance: float, first: int, spent: int
) -> tuple[Run, ToleranceReport]:
    """Return the run that satisfies a tolerance, or has the smallest error, and its tolerance report."""

    def attempt(steps: int) -> Attempt[Run]:
        run = driven.stepped(_with_steps(driven, settings, steps), tolerance)
        final = run.outcome not in ("passed", "failed", "diverged")
        return Attempt(
            run=run,
            steps=run.steps,
            estimate=run.estimate,
            order=ORDER,
            final=final,
            diverged=run.outcome == "diverged",
        )

    def reason(steps: int, estimate: float) -> str:
        return f"{round(steps / driven.cycle)} steps a turn leave a position error of {estimate:.2g} m"

    max_steps = max(MAX_STEPS, int(MAX_STEPS_OF_MOTION * driven.cycle / driven.profile.turns))
    return run_within_tolerance(
        attempt,
        tolerance,
        first,
        reason,
        trials=spent,
        trial_steps=_trial_steps(driven),
        max_steps=max_steps,
        budget=driven.budget,
    )


def steps_needed(driven: DrivenRun, settings: Settings, tolerance: float) -> tuple[Settings, int, int]:
    """Return settings, the steps per cycle that a tolerance requires, and the steps of trial revolutions."""
    short, trial = driven.over_first_turns(1.0), _trial_steps(driven)
    error = float(short.errors_by_turn(_with_steps(driven, settings, trial)).max())
    spent = round(trial * short.profile.turns / driven.cycle)
    if not np.isfinite(error):
        return _after_diverging(driven, short, settings, tolerance, spent)
    steps = _whole_steps(driven, steps_for(trial, error, TARGET_FRACTION * tolerance, ORDER))
    trial_run = driven.over_first_turns(
        np.round(float(np.clip(TRIAL_FRACTION * driven.profile.turns, *TRIAL_TURNS)))
    )
    if steps >= CONVERGED_FRACTION * trial or trial_run.profile.turns > 0.5 * driven.profile.turns:
        return settings, steps, spent
    # trials with so few steps do not show convergence or bounded errors
    previous, last = trial_run.errors_by_turn(_with_steps(driven, settings, steps))[-2:]
    spent += round(steps * trial_run.profile.turns)
    if not last <= MAX_GROWTH * previous:
        return settings, trial, spent
    # assume that an error with growth over the last revolution continues to grow
    predicted_error = last * max(1.0, last / max(previous, TINY)) ** 2
    if predicted_error > tolerance:
        order = plausible_order(last, error, trial / steps)
        steps = _whole_steps(driven, steps_for(steps, predicted_error, tolerance, order))
        steps = steps if steps <= WORTHWHILE_FRACTION * trial else trial
    return settings, steps, spent


def _after_diverging(
    driven: DrivenRun, short: DrivenRun, settings: Settings, tolerance: float, spent: int
) -> tuple[Settings, int, int]:
    """Return settings, steps per cycle from trials after divergence of the first one, and the trial steps.

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
        spent += round(trial * short.profile.turns / driven.cycle)
        if np.isfinite(error):
            steps = _whole_steps(driven, steps_for(trial, error, TARGET_FRACTION * tolerance, ORDER))
            return tried, max(trial, steps), spent
    return settings, settings.steps_per_turn, spent


def _trial_steps(driven: DrivenRun) -> int:
    """Return the steps per cycle of the first trial."""
    return max(TRIAL_STEPS, driven.min_steps)


def _whole_steps(driven: DrivenRun, steps: float) -> int:
    return max(MIN_STEPS, driven.min_steps, rounded(steps))


def _with_steps(driven: DrivenRun, settings: Settings, steps: int) -> Settings:
    return replace(settings, steps_per_turn=round(steps / driven.cycle))
