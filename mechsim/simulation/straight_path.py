"""Moves drivers along a straight path in joint space to target values; the assembly is kept."""

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow

# fraction of the path by which the straight line extends beyond both of its ends
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, there: Array, whither: str) -> Array:
    """Return the closed state with the drivers at their targets, (nq,), and the path parameter at zero.

    All drivers move at once along a straight path.

    Args:
        loops: with drivers that follow a path parameter.
        state: closed, (nq,).
        there: values of the drivers, (k,) in [m] or [rad].
        whither: where that is, in words.

    Raises:
        AssemblyError: where the loops do not close on the path.
    """
    drive = loops.drivers
    assert drive is not None
    start = state.copy()
    start[loops.crank_address] = 0.0
    here = start[drive.addresses]
    far = float(
        np.abs((there - here) / np.where(drive.slides, loops.characteristic_length, 1.0)).max(initial=0.0)
    )
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
