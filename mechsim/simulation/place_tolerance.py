"""How many steps a tolerance needs: foretold by short trials, kept by the run itself.

Measured in validation/choices/tolerance_study.py.
"""

from dataclasses import replace

import numpy as np

from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.run_result import Run
from mechsim.simulation.settings import Settings

# steps a turn of the first trial, the fewest of any run and the most that are spent
TRIAL_STEPS, LEAST_STEPS, MOST_STEPS = 100, 24, 100_000
# the settings err as a power of the step (measured in validation/choices/constraint_settings.py)
ORDER = 4.0
# part of the tolerance aimed at: the rest is for what a trial does not see
AIM = 0.5
# fewer steps than the first trial had are tried over this part of the way, so many turns at least and most
PART, TURNS = 0.2, (2.0, 20.0)
# errors settle within a few turns; where a turn errs this many times more than the one before, they grow.
# Settling: up to 2.7 times; growing: 4.4 times and more, in the study's trials of two turns
GROWING = 3.5
# with more than this part of the first trial's steps all mechanisms of the study have begun to converge;
# beyond the lower one a second guess saves less than a lost run would cost
ENOUGH, WORTH = 0.75, 0.6
# an order below the first says that nothing converges; an error below the other, in [m], is none
LEAST_ORDER, TINY = 1.0, 1e-300


def within(drive: DrivenRun, settings: Settings, tolerance: float) -> Run:
    """Return a run whose number of steps was chosen for a tolerance in [m], and its outcome."""
    settings = _with(settings, _steps(drive, settings, tolerance))
    run = drive.stepped(settings, tolerance)
    while run.outcome == "missed" and settings.steps_per_turn < MOST_STEPS:
        more = 1.3 * (run.estimate / tolerance) ** (1.0 / ORDER)
        steps = int(np.ceil(settings.steps_per_turn * max(more, 1.5)))
        if settings.steps_per_turn < TRIAL_STEPS:
            # too coarse to have begun to converge, it foretells nothing; the trial had this many
            steps = min(steps, TRIAL_STEPS)
        settings = _with(settings, min(MOST_STEPS, steps))
        better = drive.stepped(settings, tolerance)
        if better.outcome != "met" and better.estimate >= 0.5 * run.estimate:
            return min(run, better, key=lambda one: one.estimate)
        run = better
    return run


def _steps(drive: DrivenRun, settings: Settings, tolerance: float) -> int:
    """Return the steps a turn that a tolerance needs, by trials over a part of the way."""
    known = float(drive.first(1.0).tried(_with(settings, TRIAL_STEPS)).max())
    if not np.isfinite(known):
        return settings.steps_per_turn
    steps = _foretold(TRIAL_STEPS, known, AIM * tolerance, ORDER)
    turns = float(np.clip(PART * drive.profile.turns, *TURNS))
    part = drive.first(np.round(turns))
    if steps >= ENOUGH * TRIAL_STEPS or part.profile.turns > 0.5 * drive.profile.turns:
        return steps
    # no trial has shown that so few steps have begun to converge, nor that errors do not grow
    before, last = part.tried(_with(settings, steps))[-2:]
    if not last <= GROWING * before:
        return TRIAL_STEPS
    # what grew over the last turn goes on growing for a while
    whole = last * max(1.0, last / max(before, TINY)) ** 2
    if whole <= tolerance:
        return steps
    order = np.log(max(last, TINY) / max(known, TINY)) / np.log(TRIAL_STEPS / steps)
    steps = _foretold(steps, whole, tolerance, max(order, LEAST_ORDER))
    return steps if steps <= WORTH * TRIAL_STEPS else TRIAL_STEPS


def _foretold(steps: int, error: float, goal: float, order: float) -> int:
    """Return with how many steps an error falls, or may rise, to a goal."""
    return int(np.clip(np.ceil(steps * (error / goal) ** (1.0 / order)), LEAST_STEPS, MOST_STEPS))


def _with(settings: Settings, steps: int) -> Settings:
    return replace(settings, steps_per_turn=steps)
