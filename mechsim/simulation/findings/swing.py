"""The motion that a scene is asked for, or a swing of its drivers, as states of its own coordinates."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from mechsim.errors import MechsimError
from mechsim.model.motion_laws import MotionLaws, State, make_motion_laws
from mechsim.numerics.arrays import Array
from mechsim.simulation import closed_model
from mechsim.simulation.drivers import PARAMETER_JOINT
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.initial_state import at_initial_state, parameter_profile
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.poses.follow import follow
from mechsim.simulation.undetermined_dofs import require_determined, residual_mobility

# of a swing that nobody asked for: reach in [rad] or parts of the size, duration in [s], tries at half of it
REACH, STROKE, DURATION, TRIES = 0.3, 0.1, 1.0, 4
# states of a motion
SAMPLES = 101


@dataclass(frozen=True, slots=True)
class Swing:
    """States of a scene with its loops closed, evenly spaced in time.

    Attributes:
        time: (n,) in [s].
        qpos: (n, nq).
        qvel: (n, nv).
        qacc: (n, nv).
        description: what moves, in words.
    """

    time: Array
    qpos: Array
    qvel: Array
    qacc: Array
    description: str


@lru_cache(maxsize=1)
def swing(scene: Inspected) -> Swing | None:
    """Return the motion of a scene under its programs, else a swing of its drivers.

    None where the drivers do not settle one, or the loops let none be.
    """
    if scene.motion_laws is not None:
        with suppress(MechsimError, np.linalg.LinAlgError, FloatingPointError):
            return _moved(scene, scene.motion_laws, "the programs")
        return None
    for half in range(TRIES if scene.drivers else 0):
        displacements = reaches(scene, 0.5**half)
        swings = ", ".join(f"{name} by {by:.3g}" for name, by in displacements.items())
        description = f"a swing of {swings} in {DURATION:g} s"
        with suppress(MechsimError, np.linalg.LinAlgError, FloatingPointError):
            states = {
                name: wave(scene.read.mechanism.counted[name], by) for name, by in displacements.items()
            }
            return _moved(scene, make_motion_laws(scene.read.mechanism, states, DURATION), description)
    return None


def wave(start: float, reach: float) -> State:
    """Return the program of one swing from a start by a reach and back."""
    w = 2.0 * np.pi / DURATION

    def state(time: Array) -> tuple[Array, Array, Array]:
        return (
            start + 0.5 * reach * (1.0 - np.cos(w * time)),
            0.5 * reach * w * np.sin(w * time),
            0.5 * reach * w**2 * np.cos(w * time),
        )

    return state


def reaches(scene: Inspected, fraction: float = 1.0) -> Mapping[str, float]:
    """Return by how much each driver swings, to where its limits leave room."""
    mechanism, result = scene.read.mechanism, dict[str, float]()
    for name in mechanism.drivers:
        reach = fraction * (REACH if mechanism.unit(name) == "rad" else STROKE * scene.size)
        low, high = scene.read.limits.get(name, (-np.inf, np.inf))
        up, down = high - mechanism.counted[name], mechanism.counted[name] - low
        result[name] = min(reach, up) if up >= min(reach, down) else -min(reach, down)
    return result


@quiet()
def _moved(scene: Inspected, laws: MotionLaws, description: str) -> Swing:
    closed = closed_model.from_source(scene.read, drivers=laws.drivers)
    require_determined(closed, residual_mobility(closed))
    closed = at_initial_state(closed, laws)
    time = np.linspace(0.0, laws.duration, SAMPLES)
    angle, speed, _ = parameter_profile(laws).state(time)
    states = follow(closed.loops, closed.qpos, angle)
    rates = closed.loops.tangent(closed.loops.linearise(states)[1]) * speed[:, None]
    qpos, qvel = _without_clock(scene.model, closed.model, states, rates)
    return Swing(time, qpos, qvel, np.gradient(qvel, time, axis=0, edge_order=2), description)


def _without_clock(
    model: mujoco.MjModel, with_clock: mujoco.MjModel, states: Array, rates: Array
) -> tuple[Array, Array]:
    """Return states and rates of a model with a clock as those of the model without."""
    clock = with_clock.joint(PARAMETER_JOINT)
    qpos = np.delete(states, int(clock.qposadr[0]), axis=1)
    qvel = np.delete(rates, int(clock.dofadr[0]), axis=1)
    assert qpos.shape[1] == model.nq
    return qpos, qvel
