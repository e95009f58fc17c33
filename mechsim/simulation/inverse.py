"""States and efforts of a machine at given crank motion, each pose solved by itself: no time, no steps."""

import numpy as np
from numpy.typing import NDArray

from mechsim.motion import join
from mechsim.simulation import pose
from mechsim.simulation.bench import Bench
from mechsim.simulation.efforts import Efforts, efforts, needed, situation, tangent
from mechsim.simulation.record import CHUNK, States

Array = NDArray[np.float64]


def started(bench: Bench, angle: float, speed: float) -> tuple[Array, Array]:
    """Return the closed state at a crank angle and its rates at a crank speed, (nq,) and (nv,)."""
    qpos = pose.follow(bench.loops, bench.begun, [angle])
    return qpos[0], (_rates(bench, qpos) * speed)[0]


def required(
    bench: Bench, time: Array, angle: Array, speed: Array, acceleration: Array
) -> tuple[States, Efforts]:
    """Return the closed states of a crank motion, (n,) each in SI, and what it needs, by inverse dynamics.

    Raises:
        AssemblyError: where the loops do not close.

    Accuracy: rounding.
    """
    qpos = pose.follow(bench.loops, bench.begun, angle)
    parts = []
    for first in range(0, len(time), CHUNK):
        part = slice(first, first + CHUNK)
        states = States(time[part], qpos[part], _rates(bench, qpos[part]) * speed[part, None])
        at = situation(bench, states)
        parts.append((states, efforts(bench, at, *needed(bench, at, acceleration[part]))))
    return join([states for states, _ in parts]), join([found for _, found in parts])


def _rates(bench: Bench, qpos: Array) -> Array:
    """Return the rates per radian of the crank at closed states, (n, nv)."""
    n = len(qpos)
    rest = States(np.zeros(n), qpos, np.zeros((n, bench.model.nv)))
    return tangent(bench, qpos, bench.look(bench.looking(), rest, bench.nothing(n))["inertia"])
