"""A time step that is given: used as it is, or rejected with the limit and the remedy."""

from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.model.limits import require_steps
from mechsim.simulation.driven_run import DrivenRun
from mechsim.simulation.settings import Settings
from mechsim.simulation.stepping import check_step

# part of a step by which a duration may miss a whole number of steps and still count as one
WHOLE = 1e-6


def with_timestep(run: DrivenRun, settings: Settings, timestep: float) -> tuple[DrivenRun, Settings]:
    """Return a run of whole steps of a given length, and the settings of such a run.

    The run ends with the last whole step within its duration.

    Args:
        run: the motion to be stepped.
        settings: how to step; their number of steps is replaced.
        timestep: in [s].

    Raises:
        InputError: for a step that is too long or too short for the motion, or that does not fit the records.
    """
    profile, laws = run.profile, run.closed.loops.drivers is not None
    steps = check_step(timestep, profile, "a cycle of the motion laws" if laws else "a turn of the crank")
    total = int(np.floor(profile.duration / timestep + WHOLE))
    require_steps(
        f"a motion of {profile.duration:g} s in steps of {timestep:g} s", total, "take longer steps"
    )
    if total < profile.least:
        most = profile.duration / profile.least
        raise InputError(
            f"time step is {timestep:g} s, but the motion lasts {profile.duration:.6g} s and needs "
            f"{profile.least} steps at least; take {most:.3g} s at the most"
        )
    if run.samples is not None and total % run.samples:
        fitting = _divisors(total)
        near = sorted(
            {fitting[fitting <= run.samples].max(), fitting[fitting >= min(run.samples, total)].min()}
        )
        intervals, rows = (" or ".join(str(count + more) for count in near) for more in (0, 1))
        raise InputError(
            f"{run.samples} equal intervals between records do not fit {total} steps of {timestep:g} s; take "
            f"{intervals} intervals (--samples {rows}), or leave the time step out"
        )
    end = total * timestep
    note = ""
    if profile.duration - end > WHOLE * timestep:
        note = f"the run ends at {end:.9g} s, with the last whole step within {profile.duration:.9g} s"
    fixed = replace(run, profile=replace(profile, duration=end), total=total, ending=note)
    return fixed, replace(settings, steps_per_turn=steps)


def _divisors(total: int) -> np.ndarray:
    """Return all divisors of a number, rising."""
    low = np.arange(1, int(np.sqrt(total)) + 1)
    low = low[total % low == 0]
    return np.unique(np.concatenate([low, total // low]))
