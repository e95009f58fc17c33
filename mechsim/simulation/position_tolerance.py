"""The number of steps that a position tolerance requires: estimated by short trials, checked by the run.

Steps are counted per revolution, or over the whole of a shorter motion. Measured in
validation/choices/tolerance_study.py.
"""

from dataclasses import replace

import numpy as np

from mechsim.errors import BudgetError
from mechsim.numerics.angles import TURN
from mechsim.numerics.convergence import believed_order
from mechsim.simulation.compliance_search import improving_compliance
from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.pose_errors import lag_distance
from mechsim.simulation.refine import (
    MOST,
    TARGET_FRACTION,
    Attempt,
    ToleranceReport,
    refine,
    rounded,
    steps_for,
)
from mechsim.simulation.run_result import Run
from mechsim.simulation.settings import Settings

# steps per cycle of the first trial, and the minimum of any run
TRIAL_STEPS, LEAST_STEPS = 100, 24
# order of convergence of the default settings (measured in validation/choices/constraint_settings.py)
ORDER = 4.0
# a trial with fewer steps than the first covers this fraction of the revolutions, within these limits
PART, TURNS = 0.2, (2.0, 20.0)
# ratio of the errors of successive revolutions above which errors grow instead of levelling off;
# in the study's trials of two revolutions: levelling off up to 2.7, growing from 4.4
MAX_GROWTH = 3.5
# fraction of the first trial's steps from which all mechanisms of the study converge; and the fraction above
# which a second estimate saves less than a failed run would cost
ENOUGH, WORTH = 0.75, 0.6
# steps of a whole motion up to which the maximum per revolution may be exceeded: a linkage that passes a
# nearly singular pose 450 times as fast as its crank needs a million (verdicts.py --case 235)
MAX_STEPS_OF_MOTION = 2_000_000
# error in [m] that avoids a division by zero
TINY = 1e-300


def run_within(drive: DrivenRun, settings: Settings, tolerance: float) -> Run:
    """Return a run, with its outcome, whose number of steps is chosen for a tolerance in [m]."""
    first, spent = steps_needed(drive, settings, tolerance)
    run, promise = _run_to_tolerance(drive, settings, tolerance, first, spent)
    run = (
        _with_report(run, promise)
        if run.outcome != "failed"
        else _with_affordable_compliance(drive, settings, run, promise)
    )
    return replace(run, note="; ".join(one for one in (run.note, _lag_note(drive, run)) if one))


def _lag_note(drive: DrivenRun, run: Run) -> str:
    """Return a note about the lag of the drivers behind their motion laws; empty within tolerance."""
    time = run.motion.time
    if drive.closed.loops.drivers is None or time is None or run.outcome != "passed":
        return ""
    far = lag_distance(drive.closed, run.motion, drive.profile.state(time)[0])
    if far <= run.tolerance:
        return ""
    return (
        f"places are up to {far:.2g} m from where programs want them by then: drivers lag, which this "
        "tolerance does not count; more steps bring them nearer by their square"
    )


def _with_affordable_compliance(
    drive: DrivenRun, settings: Settings, run: Run, promise: ToleranceReport
) -> Run:
    """Return the result of `_with_other_compliance`, or the run unchanged if the budget ends first."""
    budget = drive.budget
    if budget is not None and not budget.affords(run.seconds):
        return _with_report(run, promise)
    try:
        return _with_other_compliance(drive, settings, run, promise)
    except BudgetError as error:
        return _with_report(run, replace(promise, reason=f"{promise.reason}; other compliances: {error}"))


def _with_other_compliance(drive: DrivenRun, settings: Settings, run: Run, promise: ToleranceReport) -> Run:
    """Return a run with a compliance that satisfies the tolerance; if the user set one, only suggest it."""
    steps, tolerance, tried = _per_cycle(drive, run), promise.tolerance, list[Run]()

    def error(compliance: float) -> float:
        tried.append(
            drive.stepped(replace(_with_steps(drive, settings, steps), compliance=compliance), tolerance)
        )
        return tried[-1].estimate

    known = promise.estimate
    found = improving_compliance(error, settings.compliance_used, known, tolerance)
    spent = promise.trials + sum(one.steps for one in tried)
    if found is None:
        return _with_report(run, replace(promise, trials=spent))
    compliance, left = found
    if settings.compliance is not None:
        reason = f"{promise.reason}, and by compliance {compliance:.2g} {left:.2g} m"
        return _with_report(run, replace(promise, trials=spent, reason=reason))
    how = (
        f"loops are held by compliance {compliance:.2g}: "
        f"{settings.compliance_used:.2g} leaves places off by {known:.2g} m"
    )
    settings, spent = replace(settings, compliance=compliance), spent + run.steps
    if tried[-1].outcome == "passed":
        kept = replace(promise, estimates={"place": left}, trials=spent - run.steps, reason="")
        return _with_report(tried[-1], kept, how)
    return _with_report(*_run_to_tolerance(drive, settings, tolerance, steps, spent), how)


def _with_report(run: Run, promise: ToleranceReport, *said: str) -> Run:
    """Return a run with its tolerance report and with notes added."""
    note = "; ".join(one for one in (run.note, *said, promise.reason) if one)
    return replace(run, tolerance_report=promise, note=note)


def _run_to_tolerance(
    drive: DrivenRun, settings: Settings, tolerance: float, first: int, spent: int
) -> tuple[Run, ToleranceReport]:
    """Return the run that satisfies a tolerance, or has the least error, and its tolerance report."""

    def attempt(steps: int) -> Attempt[Run]:
        run = drive.stepped(_with_steps(drive, settings, steps), tolerance)
        final = run.outcome not in ("passed", "failed", "diverged")
        return Attempt(
            run=run,
            steps=run.steps,
            estimates={"place": run.estimate},
            order=ORDER,
            final=final,
            diverged=run.outcome == "diverged",
        )

    def why(steps: int, estimate: float) -> str:
        return f"{round(steps / drive.cycle)} steps a turn leave the places off by {estimate:.2g} m"

    most = max(MOST, int(MAX_STEPS_OF_MOTION * drive.cycle / drive.profile.turns))
    return refine(
        attempt,
        tolerance,
        first,
        why,
        trials=spent,
        tried=_trial_steps(drive),
        most=most,
        budget=drive.budget,
    )


def steps_needed(drive: DrivenRun, settings: Settings, tolerance: float) -> tuple[int, int]:
    """Return the steps per cycle that a tolerance requires, by trials over revolutions; and steps spent."""
    short, trial = drive.over_first_turns(1.0), _trial_steps(drive)
    known = float(short.errors_by_turn(_with_steps(drive, settings, trial)).max())
    spent = round(trial * short.profile.turns / drive.cycle)
    if not np.isfinite(known):
        return _after_diverging(drive, short, settings, tolerance, spent)
    steps = _whole_steps(drive, steps_for(trial, known, TARGET_FRACTION * tolerance, ORDER))
    part = drive.over_first_turns(np.round(float(np.clip(PART * drive.profile.turns, *TURNS))))
    if steps >= ENOUGH * trial or part.profile.turns > 0.5 * drive.profile.turns:
        return steps, spent
    # no trial has shown that so few steps converge, nor that errors do not grow
    before, last = part.errors_by_turn(_with_steps(drive, settings, steps))[-2:]
    spent += round(steps * part.profile.turns)
    if not last <= MAX_GROWTH * before:
        return trial, spent
    # an error that grew over the last revolution continues to grow
    whole = last * max(1.0, last / max(before, TINY)) ** 2
    if whole > tolerance:
        order = believed_order(last, known, trial / steps)
        steps = _whole_steps(drive, steps_for(steps, whole, tolerance, order))
        steps = steps if steps <= WORTH * trial else trial
    return steps, spent


def _after_diverging(
    drive: DrivenRun, short: DrivenRun, settings: Settings, tolerance: float, spent: int
) -> tuple[int, int]:
    """Return the steps per cycle by finer trials, where the first trial diverges; and steps spent.

    For a custom model the file's own time step is one of the trials.
    """
    finer = {settings.steps_per_turn}
    if drive.closed.custom:
        cycle = drive.cycle * TURN / drive.profile.fastest
        finer.add(round(min(cycle / float(drive.closed.model.opt.timestep), MOST)))
    for trial in sorted(one for one in finer if one > _trial_steps(drive)):
        known = float(short.errors_by_turn(_with_steps(drive, settings, trial)).max())
        spent += round(trial * short.profile.turns / drive.cycle)
        if np.isfinite(known):
            return max(
                trial, _whole_steps(drive, steps_for(trial, known, TARGET_FRACTION * tolerance, ORDER))
            ), spent
    return settings.steps_per_turn, spent


def _trial_steps(drive: DrivenRun) -> int:
    """Return the steps per cycle of the first trial."""
    return max(TRIAL_STEPS, drive.min_steps)


def _whole_steps(drive: DrivenRun, steps: float) -> int:
    return max(LEAST_STEPS, drive.min_steps, rounded(steps))


def _per_cycle(drive: DrivenRun, run: Run) -> int:
    return round(run.steps * drive.cycle / drive.profile.turns)


def _with_steps(drive: DrivenRun, settings: Settings, steps: int) -> Settings:
    return replace(settings, steps_per_turn=round(steps / drive.cycle))
