"""The initial state of a model whose drivers follow motion laws."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from mechsim.model.motion_laws import CrankProfile, MotionLaws
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.straight_path import move_drivers

Closed = TypeVar("Closed", bound=ClosedModel)


def parameter_profile(motion_laws: MotionLaws) -> CrankProfile:
    """Return the profile of the path parameter; its cycles count the steps and records of a run.

    Its `fastest` rate is that of the motion laws, which may reverse more or less often than the parameter.
    """
    return replace(motion_laws.clock, fastest=motion_laws.fastest)


def at_initial_state(closed: Closed, motion_laws: MotionLaws) -> Closed:
    """Return a model under motion laws, in the state at which these start.

    All drivers move there at once along a straight path in joint space; the assembly is kept.

    Raises:
        AssemblyError: where the loops do not close on that path.
    """
    loops, drive = closed.loops, closed.loops.drivers
    assert drive is not None
    there = np.array([motion_laws.first[name] for name in drive.names])
    start = move_drivers(loops, closed.qpos, there, "the start of the motion laws")
    under = loops.with_law(motion_laws.by_clock, lambda angle: f"{angle / motion_laws.pace:.6g} s")
    return replace(closed, loops=under, qpos=under.close(start[None])[0])
