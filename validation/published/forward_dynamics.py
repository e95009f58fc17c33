"""Forward dynamics of mechsim's analytic side on published problems: error, energy drift and cost.

A01 simple pendulum (elliptic functions), A02 two four-bars (exact reduced equation), A03 Andrews' squeezer
(published angles), A04 Bricard and R-S-U-P slider-crank (energy). Problems: IFToMM library of computational
multibody benchmarks; IVP test set of Bari.

Run: python validation/published/forward_dynamics.py [periods of the pendulum, default 100]
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parent))

import a01_pendulum
import a02_four_bars
import a03_squeezer
import a04_bricard
import rsup

import mechsim as ms
from mechsim.mechanism.forces import Forces

# of the cranks of A02 at the start, in [rad/s]
SPEEDS = (-0.7, -0.9, -1.0, -1.1, -1.3, -1.5)
# relative error of an integration step of Bricard's linkage; at 3e-13 its energy drifts by 5e-10
BRICARD = 3e-14
WEIGHT = Forces(gravity=(0.0, -9.81, 0.0))


def light_pendulum() -> ms.Mechanism:
    """Return the pendulum of A01 with a point mass of 1e-20 kg m2."""
    pendulum = a01_pendulum.pendulum()
    inertia = pendulum.links[0].inertia
    assert inertia is not None
    point = tuple(tuple(1e-8 * value for value in row) for row in inertia.moments)
    return replace(pendulum, links=(replace(pendulum.links[0], inertia=replace(inertia, moments=point)),))


def a02_rates(_: float, state: np.ndarray) -> list[float]:
    """Return the rates of A02 with two four-bars, all cranks parallel: I a'' = -P g cos a."""
    return [state[1], -3.5 * a02_four_bars.GRAVITY / 3.0 * np.cos(state[0])]


def cases(periods: float) -> Iterator[tuple[str, str, float, int]]:
    """Yield name, error, energy error and number of steps of each problem."""
    run = ms.dynamics.run(light_pendulum(), WEIGHT, duration=periods * a01_pendulum.PERIOD, samples=400)
    swing = run.motion.joints["pivot"].value + np.pi / 2.0
    error = np.abs(swing - a01_pendulum.exact(run.time)).max() / (np.pi / 2.0)
    yield f"A01 pendulum, {periods:g} periods", f"{error:.1e}", run.energy_error, run.steps
    # the error depends on the distance of the steps from the singular configuration: the worst of six speeds
    worst, energy, steps = 0.0, 0.0, 0
    for speed in SPEEDS:
        initial_rate = {"A0.v": speed}
        run = ms.dynamics.run(a02_four_bars.chain(2), WEIGHT, initial=initial_rate, duration=6.0, samples=40)
        initial, times = [np.pi / 2.0, speed], run.time
        exact = solve_ivp(a02_rates, (0.0, 6.0), initial, "DOP853", times, rtol=2.3e-14, atol=1e-14)
        distance = run.motion.points["B0"].position[:, :2] - a02_four_bars.tip(exact.y[0])
        worst, energy = max(worst, float(np.abs(distance).max())), max(energy, run.energy_error)
        steps = max(steps, run.steps)
    yield "A02, worst of six speeds, 6 s [m]", f"{worst:.1e}", energy, steps
    squeezer = a03_squeezer.squeezer(), a03_squeezer.forces()
    run = ms.dynamics.run(*squeezer, duration=a03_squeezer.END, samples=2)
    angles = np.array([run.motion.joints[name].value[-1] for name in a03_squeezer.NAMES])
    yield "A03 squeezer [correct digits]", f"{a03_squeezer.digits(angles):.1f}", run.energy_error, run.steps
    run = ms.dynamics.run(a04_bricard.bricard(), WEIGHT, duration=10.0, samples=2, tolerance=BRICARD)
    yield "A04 Bricard, 10 s", "-", run.energy_error, run.steps
    run = ms.dynamics.run(rsup.rsup(), rsup.FORCES, initial={"shaft.v": 6.0}, duration=5.0, samples=2)
    yield "R-S-U-P slider-crank, 5 s", "-", run.energy_error, run.steps


def main(periods: float) -> None:
    print(f"{'problem':34s} {'error':>10s} {'energy':>10s} {'steps':>8s} {'cpu s':>8s}")
    start = process_time()
    for name, error, energy, steps in cases(periods):
        seconds = process_time() - start
        print(f"{name:34s} {error:>10s} {energy:10.1e} {steps:8,d} {seconds:8.1f}", flush=True)
        start = process_time()


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 100.0)
