"""The number of steps that a position tolerance requires: estimated by short trials, verified by the run.

Steps are counted per revolution, or over the whole of a shorter motion. Measured in
validation/choices/tolerance_study.py.
"""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import BudgetError
from mechsim.numerics.arrays import REVOLUTION
from mechsim.numerics.convergence import refine
from mechsim.simulation.configurations import lag_distance
from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.result import Run
from mechsim.simulation.settings import Settings

# order of convergence of the default settings (measured in validation/choices/constraint_settings.py)
ORDER = 4.0
# target of attempts as a fraction of the tolerance, as a margin for errors that trials do not show
TARGET_FRACTION = 0.5
# minimum and maximum ratio of the steps of successive attempts; maximum number of steps per revolution, which
# a short motion may exceed if its predicted number of steps is larger
MIN_STEP_FACTOR, MAX_STEP_FACTOR, MAX_STEPS = 1.5, 4.0, 100_000
# steps per revolution up to which a finer run follows one that diverges
MAX_STEPS_AFTER_DIVERGENCE = 25_000
# ratio of successive errors below which more steps help
MIN_GAIN = 0.5


@dataclass
class NextSteps:
    """Chooses the steps of the next run from the last run; None if more steps do not help.

    Attributes:
        goal: target of the error estimate, in [m].
        trial_steps: steps per revolution of the finest trial. A run with fewer steps may not converge yet; a
            run with this number of steps follows it for any predicted error.
        max_steps: limit on the steps per revolution if the prediction lies between `MAX_STEPS` and it.
        remaining: error of the last run; None before the first.
    """

    goal: float
    trial_steps: int = 0
    max_steps: int = 0
    remaining: float | None = None

    def __call__(self, steps: int, run: Run) -> int | None:
        diverged = run.outcome == "diverged" and steps < MAX_STEPS_AFTER_DIVERGENCE
        gained = self.remaining is None or run.estimate < MIN_GAIN * self.remaining
        predicted = max(steps_for(steps, run.estimate, self.goal), MIN_STEP_FACTOR * steps)
        limit = self.max_steps if MAX_STEPS < predicted <= self.max_steps else MAX_STEPS
        final = run.outcome not in ("passed", "failed", "diverged")
        if final or not (gained or diverged) or steps >= limit:
            return None
        self.remaining = run.estimate
        most = self.trial_steps if steps < self.trial_steps else MAX_STEP_FACTOR * steps
        return rounded(min(predicted, most), limit)


def steps_for(steps: int, error: float, goal: float) -> float:
    """Return the unrounded number of steps at which an error equals a goal."""
    return steps * ((error / goal) ** (1.0 / ORDER) if np.isfinite(error) else MAX_STEP_FACTOR)


def rounded(steps: float, max_steps: int = MAX_STEPS) -> int:
    """Return the number of steps rounded up, at most the maximum."""
    return max(1, int(np.ceil(min(steps, max_steps) - 1e-9)))


# limits of the compliance: MuJoCo's minimum, and MuJoCo's default
MIN_COMPLIANCE, MAX_COMPLIANCE = 1e-16, 1.0
# smallest factor by which the compliance changes
MIN_FACTOR = 100.0


def other_compliances(used: float, error: float, tolerance: float) -> list[float]:
    """Return other compliances for an error in [m]: in proportion to it, inversely, and a little softer."""
    factor = max(MIN_FACTOR, error / (TARGET_FRACTION * tolerance))
    tried = np.clip((used / factor, used * factor, used * MIN_FACTOR), MIN_COMPLIANCE, MAX_COMPLIANCE)
    return [compliance for compliance in dict.fromkeys(tried.tolist()) if compliance != used]


# steps per cycle of the trial, and the minimum of any run
TRIAL_STEPS, MIN_STEPS = 100, 24
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
    if driven.closed.loops.drivers.crank or time is None or run.outcome != "passed":
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
    steps, used = round(run.steps * driven.cycle / driven.profile.turns), settings.compliance_used
    for compliance in other_compliances(used, run.estimate, run.tolerance):
        other = replace(settings, compliance=compliance)
        better = driven.stepped(_with_steps(driven, other, steps), run.tolerance)
        if better.estimate <= max(run.tolerance, MIN_GAIN * run.estimate):
            break
    else:
        return run
    if settings.compliance is not None:
        more = f"and by compliance {compliance:.2g} {better.estimate:.2g} m"
        return replace(run, shortfall=f"{run.shortfall}, {more}")
    if better.outcome != "passed":
        better = _run_to_tolerance(driven, other, run.tolerance, steps)
    error_text = f"{used:.2g} leaves a position error of {run.estimate:.2g} m"
    return replace(better, note=_joined(better.note, f"loops have compliance {compliance:.2g}: {error_text}"))


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
    """Return settings and the steps per cycle that a tolerance requires, by a trial of the first turn.

    Others follow one that diverges. For a custom model the file's own time step is one of them. If all
    diverge, the last is softer: of a rod with a small inertia about its line, the rounding of stiff
    constraints turns it ever faster.
    """
    short, first = driven.over_first_turn(), _trial_steps(driven)
    finer = {settings.steps_per_turn}
    if driven.closed.custom:
        cycle = driven.cycle * REVOLUTION / driven.profile.max_speed
        finer.add(round(min(cycle / float(driven.closed.model.opt.timestep), MAX_STEPS)))
    trials = [(settings, first), *((settings, steps) for steps in sorted(finer) if steps > first)]
    if settings.compliance is None:
        softer = replace(settings, compliance=MIN_FACTOR * settings.compliance_used)
        trials.append((softer, settings.steps_per_turn))
    for tried, trial in trials:
        error = short.position_error(_with_steps(driven, tried, trial))
        if np.isfinite(error):
            steps = rounded(steps_for(trial, error, TARGET_FRACTION * tolerance))
            # after a divergence fewer steps than the trial's may diverge, too
            least = MIN_STEPS if trial == first else trial
            return tried, max(least, driven.min_steps, steps)
    return settings, settings.steps_per_turn


def _trial_steps(driven: DrivenRun) -> int:
    """Return the steps per cycle of the trial."""
    return max(TRIAL_STEPS, driven.min_steps)


def _with_steps(driven: DrivenRun, settings: Settings, steps: int) -> Settings:
    return replace(settings, steps_per_turn=round(steps / driven.cycle))
