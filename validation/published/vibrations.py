"""Modes against the nonlinear run and against MuJoCo's finite differences, with springs and dampers.

Ring-down: the nonlinear run starts on a mode's own free vibration; the largest distance from that vibration
over a period, relative to the amplitude, falls in proportion to the amplitude. Finite differences: the
eigenvalues of mjd_transitionFD over a step of MuJoCo's implicit integrator give s = log(z) / step; two steps
extrapolate its error of first order in the step.

Run: python validation/published/vibrations.py
"""

import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from natural_frequencies import CASES, Case

import mechsim as ms
from mechsim.simulation.dynamics.forward_run import free_model

AMPLITUDES = (1e-2, 1e-3, 1e-4)
STEPS = (4e-4, 2e-4)
# impedance of the loops' constraints, and step of the differences
HARD, DIFFERENCE = 0.999999, 1e-5
SAMPLES = 40


def near_equilibrium(case: Case) -> tuple[ms.dynamics.DynamicModel, dict[str, float]]:
    """Return the model of a case, and coordinates near its equilibrium."""
    model = ms.dynamics.dynamic_model(ms.load(case.name), case.forces)
    return model, {f"{name}.q": q for name, q in zip(model.mechanism.drivers, case.guess, strict=True)}


def ring_down(case: Case, number: int, amplitude: float) -> float:
    """Return the largest distance of the run from the mode's vibration over a period, per amplitude."""
    model, initial = near_equilibrium(case)
    drivers = model.mechanism.drivers
    equilibrium = ms.dynamics.nearest_equilibrium(model, initial=initial)
    mode = equilibrium.modes[number]
    start = {
        f"{name}.{letter}": (equilibrium.q[name] if letter == "q" else 0.0)
        + amplitude * (mode.shape[name] * factor).real
        for name in drivers
        for letter, factor in (("q", 1.0), ("v", mode.eigenvalue))
    }
    run = ms.dynamics.run(model, initial=start, duration=1.0 / mode.frequency, samples=SAMPLES)
    worst = 0.0
    for name in drivers:
        vibration = (mode.shape[name] * np.exp(mode.eigenvalue * run.time)).real
        displacement = (run.motion.joints[name].value - equilibrium.q[name]) / amplitude
        worst = max(worst, float(np.abs(displacement - vibration).max()))
    return worst


def transition_eigenvalues(case: Case, timestep: float) -> Any:
    """Return s = log(z) / step of the eigenvalues z of MuJoCo's transition matrix about the equilibrium."""
    described, initial = near_equilibrium(case)
    equilibrium = ms.dynamics.nearest_equilibrium(described, initial=initial)
    model = free_model(described.mechanism, case.forces, set()).model
    model.opt.timestep, model.opt.integrator = timestep, mujoco.mjtIntegrator.mjINT_IMPLICIT
    model.opt.tolerance, model.opt.iterations = 0.0, 100
    model.eq_solref[:] = 2.0 * timestep, 1.0
    model.eq_solimp[:] = HARD, HARD, 1.0, 0.5, 2.0
    data = mujoco.MjData(model)
    data.qpos[:] = ms.closed_qpos(model, {name: equilibrium.q[name] for name in described.mechanism.drivers})
    matrix = np.zeros((2 * model.nv, 2 * model.nv))
    mujoco.mjd_transitionFD(model, data, DIFFERENCE, True, matrix, None, None, None)
    values = np.linalg.eigvals(matrix).astype(complex)
    return np.log(values) / timestep


def nearest(values: Any, target: complex) -> complex:
    return complex(values[np.argmin(np.abs(values - target))])


def main() -> None:
    for case in CASES:
        model, initial = near_equilibrium(case)
        modes = ms.dynamics.modes(model, initial=initial)
        eigenvalues = [transition_eigenvalues(case, step) for step in STEPS]
        for number, mode in enumerate(modes):
            result = [nearest(values, mode.eigenvalue) for values in eigenvalues]
            extrapolated = 2.0 * result[1] - result[0]
            errors = [abs(value / mode.eigenvalue - 1.0) for value in (*result, extrapolated)]
            distances = [ring_down(case, number, amplitude) for amplitude in AMPLITUDES]
            ringing, differences = (
                ", ".join(f"{value:.1e}" for value in values) for values in (distances, errors)
            )
            print(f"{case.name:13s} mode {number + 1} {mode.frequency:9.5f} Hz", flush=True)
            print(f"    ring-down, distance per amplitude {ringing}; transitionFD {differences}", flush=True)


if __name__ == "__main__":
    main()
