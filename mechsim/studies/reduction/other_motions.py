"""Other motions of the same inputs, at other paces and less far: one that chooses nothing, one to fit to."""

from dataclasses import replace

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.programs import State
from mechsim.studies.scenes import UserScene

# how far a second motion goes, and by how much its speed differs within it
REACH, UNEVEN = 0.9, 0.3
# likewise of the motion that longer steps are fitted to beside the user's
FITTED_REACH, FITTED_UNEVEN = 0.6, -0.3


def second_motion(scene: UserScene) -> UserScene:
    """Return a scene put through a second motion, from the same start; it judges and chooses nothing."""
    return other_motion(scene, REACH, UNEVEN)


def motion_to_fit(scene: UserScene) -> UserScene:
    """Return a scene put through another motion, from the same start, to fit to."""
    return other_motion(scene, FITTED_REACH, FITTED_UNEVEN)


def other_motion(scene: UserScene, reach: float, uneven: float) -> UserScene:
    """Return a scene put through its motion at another pace, from the same start.

    Args:
        scene: and its motion.
        reach: how far it goes, in parts of it.
        uneven: by how much its pace differs within it, either way.
    """
    count = len(scene.drive)
    programs = [
        {
            name: _program(state, scene.duration, number, reach, uneven)
            for number, (name, state) in enumerate(states.items(), first)
        }
        for states, first in ((scene.drive, 0), (scene.ctrl, count))
    ]
    qpos, qvel = scene.start
    # rates that keep loops closed go with those of the drivers
    return replace(
        scene, drive=programs[0], ctrl=programs[1], start=(qpos, reach * qvel if scene.drive else qvel)
    )


def _program(state: State, duration: float, number: int, reach: float, uneven: float) -> State:
    """Return a program whose time runs by 1 - uneven sin(w t), so that it ends where it ended.

    Each number has a pace w of its own.
    """
    w = 2.0 * np.pi * (1 + number % 3) / duration

    def other(time: Array) -> tuple[Array, Array, Array]:
        time = np.asarray(time, dtype=np.float64)
        at = time - uneven / w * (1.0 - np.cos(w * time))
        pace, change = 1.0 - uneven * np.sin(w * time), -uneven * w * np.cos(w * time)
        value, rate, acceleration = (np.broadcast_to(one, time.shape) for one in state(at))
        start = state(np.zeros(1))[0][0]
        return (
            start + reach * (value - start),
            reach * rate * pace,
            reach * (acceleration * pace**2 + rate * change),
        )

    return other
