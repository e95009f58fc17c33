"""Drivers brought straight from where they stand to where they are wanted, the assembly kept."""

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow

# parts of the way before its start and after its end at which it still goes straight
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, there: Array, whither: str) -> Array:
    """Return the closed state in which the drivers stand where they are wanted, (nq,), the clock at zero.

    They go there straight, all at once.

    Args:
        loops: of drivers under a clock.
        state: closed, (nq,).
        there: values of the drivers, (k,) in [m] or [rad].
        whither: where that is, in words.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    drive = loops.drivers
    assert drive is not None
    start = state.copy()
    start[loops.crank_address] = 0.0
    here = start[drive.addresses]
    far = float(np.abs((there - here) / np.where(drive.slides, loops.characteristic_length, 1.0)).max(initial=0.0))
    if far > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            part = np.clip(angle / far, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(here), len(angle)))
            way = (there - here)[:, None]
            return here[:, None] + way * part, way / far + none, none

        def along(angle: float) -> str:
            stands = straight(np.array([angle]))[0][:, 0]
            where = ", ".join(f"{name} = {at:.6g}" for name, at in zip(drive.names, stands, strict=True))
            return f"{where} on the way to {whither}"

        start = follow.follow(loops.with_law(straight, along), start, [far])[0]
    start[loops.crank_address], start[drive.addresses] = 0.0, there
    return start
