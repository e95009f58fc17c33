"""Drivers moved to other values along a straight path, in the assembly of the start."""

from dataclasses import replace

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.follow import follow

# fraction of the path by which the straight line extends beyond both of its ends
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, target: Array, target_text: str) -> Array:
    """Return the closed state with the drivers at their targets, (nq,), and the path parameter at zero.

    All drivers move at once along a straight path.

    Args:
        loops: with drivers that follow a path parameter.
        state: closed, (nq,).
        target: values of the drivers, (k,) in [m] or [rad].
        target_text: where that is, in words.

    Raises:
        AssemblyError: where the loops do not close on the path.
    """
    drivers = loops.drivers
    assert drivers is not None
    start = state.copy()
    start[loops.crank_address] = 0.0
    current = start[drivers.addresses]
    distance = float(
        np.abs((target - current) / np.where(drivers.slides, loops.characteristic_length, 1.0)).max(
            initial=0.0
        )
    )
    if distance > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            fraction = np.clip(angle / distance, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(current), len(angle)))
            displacement = (target - current)[:, None]
            return current[:, None] + displacement * fraction, displacement / distance + none, none

        def along(angle: float) -> str:
            values = straight(np.array([angle]))[0][:, 0]
            text = ", ".join(
                f"{name} = {value:.6g}" for name, value in zip(drivers.names, values, strict=True)
            )
            return f"{text} on the way to {target_text}"

        start = follow(replace(loops, drivers=drivers.with_law(straight, along)), start, [distance])[0]
    start[loops.crank_address], start[drivers.addresses] = 0.0, target
    return start
