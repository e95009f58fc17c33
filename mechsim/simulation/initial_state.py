"""From where a model stands to where its drivers' programs begin, and the model under these programs."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from mechsim.model.crank_profile import CrankProfile
from mechsim.model.programs import Programs
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.straight_path import move_drivers

Closed = TypeVar("Closed", bound=ClosedModel)


def parameter_profile(programs: Programs) -> CrankProfile:
    """Return the profile of the clock, whose turns count the steps and records of a run.

    Where the programs turn round more often than their clock does, or not once, `fastest` is as if it did.
    """
    return replace(programs.clock, fastest=programs.fastest)


def at_initial_state(closed: Closed, programs: Programs) -> Closed:
    """Return a model whose drivers stand, as yet, under programs, in the state in which these begin.

    The drivers go there straight, all at once, and the assembly is kept.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    loops, drive = closed.loops, closed.loops.drivers
    assert drive is not None
    there = np.array([programs.first[name] for name in drive.names])
    start = move_drivers(loops, closed.qpos, there, "where the programs begin")
    under = loops.with_law(programs.by_clock, lambda angle: f"{angle / programs.pace:.6g} s")
    return replace(closed, loops=under, qpos=under.close(start[None])[0])
