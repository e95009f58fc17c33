"""Other motions of the same inputs, at other speeds and over smaller ranges: to verify and to fit."""

from dataclasses import replace

import numpy as np

from mechsim.model.motion_laws import State
from mechsim.numerics.arrays import Array
from mechsim.studies.scenes import UserScene

# range of the second motion relative to the user's, and the relative variation of its speed
RANGE_RATIO, SPEED_VARIATION = 0.9, 0.3
# the same for the second motion to which longer steps are fitted
FITTED_RANGE_RATIO, FITTED_SPEED_VARIATION = 0.6, -0.3


def second_motion(scene: UserScene) -> UserScene:
    """Return a scene over a second motion from the same start; only the final check uses it."""
    return other_motion(scene, RANGE_RATIO, SPEED_VARIATION)


def motion_to_fit(scene: UserScene) -> UserScene:
    """Return a scene over another motion from the same start, for fitting."""
    return other_motion(scene, FITTED_RANGE_RATIO, FITTED_SPEED_VARIATION)


def other_motion(scene: UserScene, range_ratio: float, speed_variation: float) -> UserScene:
    """Return a scene over its motion with another range and speed, from the same start.

    Args:
        scene: with its motion.
        range_ratio: range relative to that of the motion.
        speed_variation: largest relative change of the speed.
    """
    count = len(scene.drive)
    motion_laws = [
        {
            name: _warped_law(state, scene.duration, number, range_ratio, speed_variation)
            for number, (name, state) in enumerate(states.items(), first)
        }
        for states, first in ((scene.drive, 0), (scene.ctrl, count))
    ]
    qpos, qvel = scene.start
    # rates that keep loops closed are proportional to the driver speeds
    return replace(
        scene,
        drive=motion_laws[0],
        ctrl=motion_laws[1],
        start=(qpos, range_ratio * qvel if scene.drive else qvel),
    )


def _warped_law(
    state: State, duration: float, number: int, range_ratio: float, speed_variation: float
) -> State:
    """Return a motion law whose time runs at 1 - speed_variation sin(w t) and ends at the same value.

    The number selects the frequency w.
    """
    w = 2.0 * np.pi * (1 + number % 3) / duration

    def other(time: Array) -> tuple[Array, Array, Array]:
        time = np.asarray(time, dtype=np.float64)
        warped = time - speed_variation / w * (1.0 - np.cos(w * time))
        speed, speed_rate = 1.0 - speed_variation * np.sin(w * time), -speed_variation * w * np.cos(w * time)
        value, rate, acceleration = (np.broadcast_to(values, time.shape) for values in state(warped))
        start = state(np.zeros(1))[0][0]
        return (
            start + range_ratio * (value - start),
            range_ratio * rate * speed,
            range_ratio * (acceleration * speed**2 + rate * speed_rate),
        )

    return other
