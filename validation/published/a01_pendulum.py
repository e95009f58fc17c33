"""A01, simple pendulum: a point mass of 1 kg on 1 m, let go horizontally; exact by elliptic functions.

Problem: IFToMM library of computational multibody benchmarks, A01. Period 4 sqrt(l / g) K(1/2) =
2.367841947576237 s. The point is a ball of 1e-12 kg m2, which lengthens the period by 5e-13 of itself.

Run: python validation/published/a01_pendulum.py
"""

import sys
from pathlib import Path

import numpy as np
from scipy.special import ellipj, ellipk

sys.path.insert(0, str(Path(__file__).parent))

from table import Row, energy_error, show

import mechsim as ms
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.links import Inertia
from mechsim.simulation.dynamics.forward_run import stepped_run

GRAVITY = 9.81
PERIOD = 2.367841947576237
STEPS = 1000  # a period


def pendulum() -> ms.Mechanism:
    ball = ((1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12))
    return ms.Mechanism(
        "simple pendulum",
        (ms.Link("arm", outline=((1.0, 0.0, 0.0),), inertia=Inertia(1.0, (1.0, 0.0, 0.0), ball)),),
        (ms.Joint("pivot", "revolute", ms.End("ground"), ms.End("arm")),),
        "pivot",
        {"P": ("arm", (1.0, 0.0, 0.0))},
    )


def exact(time: np.ndarray) -> np.ndarray:
    """Return the swing from hanging down, (n,): sin(angle / 2) = k sn(K + t sqrt(g / l)), k2 = 1/2."""
    sine, *_ = ellipj(ellipk(0.5) + time * np.sqrt(GRAVITY), 0.5)
    return 2.0 * np.arcsin(np.sqrt(0.5) * sine)


def rows() -> list[Row]:
    period = 4.0 / np.sqrt(GRAVITY) * ellipk(0.5)
    times, weight = np.linspace(0.0, 10.0 * PERIOD, 201), Forces(gravity=(0.0, -GRAVITY, 0.0))
    run = stepped_run(pendulum(), weight, {"pivot": 0.0}, {"pivot": 0.0}, times, STEPS // 20)
    assert run.motion.time is not None
    error = float(np.abs(run.motion.angle + np.pi / 2.0 - exact(run.motion.time)).max())
    return [
        Row("period by K(1/2) against the published one", abs(period - PERIOD), 1e-14, "s", "rounding"),
        Row("angle over 10 periods", error, 1e-8, "rad", "fourth order at 1,000 steps a period: 1.1e-9"),
        Row("energy", energy_error(run), 1e-9, "1", "the same"),
    ]


if __name__ == "__main__":
    sys.exit(show("A01 simple pendulum, MuJoCo", rows()))
