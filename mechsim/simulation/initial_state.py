"""The initial state of a model whose drivers follow motion laws."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from mechsim.model.crank_profile import CrankProfile
from mechsim.model.programs import Programs
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.straight_path import move_drivers

Closed = TypeVar("Closed", bound=ClosedModel)


def parameter_profile(programs: Programs) -> CrankProfile:
    """Return the profile of the path parameter; its cycles count the steps and records of a run.

    Its `fastest` rate is that of the motion laws, which may reverse more or less often than the parameter.
    """
    return replace(programs.clock, fastest=programs.fastest)


def at_initial_state(closed: Closed, programs: Programs) -> Closed:
    """Return a model under motion laws, in the state at which these start.

    All drivers move there at once along a straight path in joint space; the assembly is kept.

    Raises:
        AssemblyError: where the loops do not close on that path.
    """
    loops, drive = closed.loops, closed.loops.drivers
    assert drive is not None
    there = np.array([programs.first[name] for name in drive.names])
    start = move_drivers(loops, closed.qpos, there, "the start of the motion laws")
    under = loops.with_law(programs.by_clock, lambda angle: f"{angle / programs.pace:.6g} s")
    return replace(closed, loops=under, qpos=under.close(start[None])[0])
