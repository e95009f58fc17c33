"""A second motion of the same inputs, which chose nothing: other speeds, other paces, nine tenths as far."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.programs import State
from mechsim.studies.scenes import UserScene

# how far a second motion goes, and by how much its speed differs within it
REACH, UNEVEN = 0.9, 0.3


def second_motion(scene: UserScene) -> UserScene:
    """Return a scene put through a second motion, from the same start."""
    count = len(scene.drive)
    drive = _programs(scene.drive, scene.duration, 0)
    qpos, qvel = scene.start
    # rates that keep loops closed go with those of the drivers
    return replace(
        scene,
        drive=drive,
        ctrl=_programs(scene.ctrl, scene.duration, count),
        start=(qpos, REACH * qvel if count else qvel),
    )


def _programs(states: Mapping[str, State], duration: float, first: int) -> dict[str, State]:
    """Return other programs of the same inputs, numbered from `first`: each has a pace of its own."""
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
