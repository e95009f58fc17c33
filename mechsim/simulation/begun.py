"""From where a model stands to where its drivers' programs begin, and the model under these programs."""

from dataclasses import replace

import numpy as np

from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.crank_profile import CrankProfile
from mechsim.model.programs import Programs
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.poses import follow

# parts of the way before its start and after its end at which it still goes straight
BEYOND = 0.5
# times at which programs are probed for how quickly they turn round
PROBES = 2048


def clock_of(programs: Programs) -> CrankProfile:
    """Return the profile of the clock, whose turns count the steps and records of a run.

    Where the programs turn round more often than their clock does, or not once, `fastest` is as if it did.
    """
    _, rate, second = programs.state(np.linspace(0.0, programs.duration, PROBES))
    quick, quicker = (np.sqrt((one**2).mean(1)) for one in (rate, second))
    round_again = np.divide(quicker, quick, out=np.zeros_like(quick), where=quick > 0.0)
    fastest = max(programs.pace, float(round_again.max()), TURN / programs.duration)
    return replace(programs.clock, fastest=fastest)


def begun(closed: ClosedModel, programs: Programs) -> ClosedModel:
    """Return a model whose drivers stand, as yet, under programs, in the state in which these begin.

    The drivers go there straight, all at once, and the assembly is kept.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    loops, drive = closed.loops, closed.loops.drive
    assert drive is not None
    here = closed.closed[drive.places]
    there = np.array([programs.first[name] for name in drive.names])
    far = float(np.abs((there - here) / np.where(drive.slides, loops.size, 1.0)).max())
    start = closed.closed.copy()
    if far > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            part = np.clip(angle / far, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(here), len(angle)))
            way = (there - here)[:, None]
            return here[:, None] + way * part, way / far + none, none

        def along(angle: float) -> str:
            stands = straight(np.array([angle]))[0][:, 0]
            where = ", ".join(f"{name} = {at:.6g}" for name, at in zip(drive.names, stands, strict=True))
            return f"{where} on the way to where the programs begin"

        start = follow.follow(loops.under(straight, along), start, [far])[0]
    start[loops.crank_place], start[drive.places] = 0.0, there
    under = loops.under(programs.by_clock, lambda angle: f"{angle / programs.pace:.6g} s")
    return replace(closed, loops=under, closed=under.close(start[None])[0])
