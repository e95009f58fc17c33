"""A second motion of the same inputs, which chose nothing: other speeds, other paces, nine tenths as far."""

from collections.abc import Mapping

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.programs import State

# how far a second motion goes, and by how much its speed differs within it
REACH, UNEVEN = 0.9, 0.3


def second_programs(states: Mapping[str, State], duration: float, first: int = 0) -> dict[str, State]:
    """Return other programs of the same inputs: from the same start, each at a pace of its own.

    Args:
        states: of the inputs.
        duration: of the motion in [s], beyond which no program is asked.
        first: number of the first input, by which paces differ.
    """
    return {
        name: _second(state, duration, number) for number, (name, state) in enumerate(states.items(), first)
    }


def _second(state: State, duration: float, number: int) -> State:
    """Return a program whose time runs unevenly: by 1 - UNEVEN sin(w t), so that it ends where it ended."""
    w = 2.0 * np.pi * (1 + number % 3) / duration

    def second(time: Array) -> tuple[Array, Array, Array]:
        time = np.asarray(time, dtype=np.float64)
        at = time - UNEVEN / w * (1.0 - np.cos(w * time))
        pace, change = 1.0 - UNEVEN * np.sin(w * time), -UNEVEN * w * np.cos(w * time)
        value, rate, acceleration = (np.broadcast_to(one, time.shape) for one in state(at))
        start = state(np.zeros(1))[0][0]
        return (
            start + REACH * (value - start),
            REACH * rate * pace,
            REACH * (acceleration * pace**2 + rate * change),
        )

    return second
