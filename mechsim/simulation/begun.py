"""From where a model stands to where its drivers' programs begin, and the model under these programs."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from mechsim.maths.angles import TURN
from mechsim.model.crank_profile import CrankProfile
from mechsim.model.programs import Programs
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.straight_way import brought

# times at which programs are probed for how quickly they turn round
PROBES = 2048

Closed = TypeVar("Closed", bound=ClosedModel)


def clock_of(programs: Programs) -> CrankProfile:
    """Return the profile of the clock, whose turns count the steps and records of a run.

    Where the programs turn round more often than their clock does, or not once, `fastest` is as if it did.
    """
    _, rate, second = programs.state(np.linspace(0.0, programs.duration, PROBES))
    quick, quicker = (np.sqrt((one**2).mean(1)) for one in (rate, second))
    round_again = np.divide(quicker, quick, out=np.zeros_like(quick), where=quick > 0.0)
    fastest = max(programs.pace, float(round_again.max()), TURN / programs.duration)
    return replace(programs.clock, fastest=fastest)


def begun(closed: Closed, programs: Programs) -> Closed:
    """Return a model whose drivers stand, as yet, under programs, in the state in which these begin.

    The drivers go there straight, all at once, and the assembly is kept.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    loops, drive = closed.loops, closed.loops.drive
    assert drive is not None
    there = np.array([programs.first[name] for name in drive.names])
    start = brought(loops, closed.closed, there, "where the programs begin")
    under = loops.under(programs.by_clock, lambda angle: f"{angle / programs.pace:.6g} s")
    return replace(closed, loops=under, closed=under.close(start[None])[0])
