"""The same MJCF models under each engine that is installed, against the exact closure.

Problem: mechanisms of the catalogue as `mechsim export` writes them, one revolution at 600 rpm from a
consistent initial state. Settings: as exported (time constant 2 ms, impedance .9999, RK4, references not
adapted to the step), with a time constant of a tenth of a revolution, and MuJoCo's own loops and integrator.
The solver takes two iterations; with equalities alone one is exact. Reference: the closed form at the crank
angles of the run, exact to rounding. MuJoCo's kinematics in float64 computes positions from the recorded
coordinates, so the error is that of the stepping.

    python validation/engines/compare.py
"""

import copy
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "choices"))

import study_table
from engines import Engine, installed

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.simulation import loop_jacobian
from mechsim.simulation.mjcf.compiling import compiled, quiet
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.source import assembled

MECHANISMS = ("four_bar", "rssr", "looper")
SPEED, STEPS, ITERATIONS = 20.0 * np.pi, 360, 2
PERIOD = 2.0 * np.pi / SPEED
STIFF_SOLIMP, DEFAULT_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0), (0.9, 0.95, 0.001, 0.5, 2.0)
SETTINGS = {
    "as exported": ((0.002, 1.0), STIFF_SOLIMP, mujoco.mjtIntegrator.mjINT_RK4),
    "turn/10, .9999": ((PERIOD / 10.0, 1.0), STIFF_SOLIMP, mujoco.mjtIntegrator.mjINT_RK4),
    "MuJoCo's own": ((0.02, 1.0), DEFAULT_SOLIMP, mujoco.mjtIntegrator.mjINT_EULER),
}


def row(name: str, settings: str, engine: str, run: Engine) -> dict[str, Any]:
    """Return the errors and the time of an engine for a mechanism."""
    closed_form = catalog.make(name)
    model = compiled(assembled(closed_form.mechanism, Scene(level="motion")))
    loops = read_loops(copy.copy(model))
    qpos = loop_jacobian.close(loops, model.qpos0[None])
    qvel = SPEED * loop_jacobian.tangent(loops, loops.linearise(qpos)[1])
    solref, solimp, integrator = SETTINGS[settings]
    model.eq_solref[:], model.eq_solimp[:] = solref, solimp
    model.opt.timestep, model.opt.integrator = PERIOD / STEPS, integrator
    model.opt.iterations = ITERATIONS
    try:
        states, seconds = run(model, qpos[0], qvel[0], STEPS, np.zeros(model.nu))
    except (ValueError, NotImplementedError, RuntimeError) as error:
        failure = {"position": np.nan, "crank [rad]": np.nan, "ms a turn": " ".join(str(error).split())[:60]}
        return {"mechanism": name, "settings": settings, "engine": engine} | failure
    time = PERIOD * (1.0 + np.arange(STEPS)) / STEPS
    crank_angle = states[:, loops.crank_address]
    position_error = np.inf
    if np.isfinite(states).all():
        exact, computed = closed_form.positions(crank_angle), loops.posed.site_positions(states)
        errors = [
            np.linalg.norm(computed[:, model.site(site).id] - position, axis=1).max()
            for site, position in exact.items()
        ]
        position_error = float(max(errors)) / closed_form.crank
    return {
        "mechanism": name,
        "settings": settings,
        "engine": engine,
        "position": position_error,
        "crank [rad]": float(np.abs(crank_angle - qpos[0, loops.crank_address] - SPEED * time).max()),
        "ms a turn": f"{1e3 * seconds:.3g}",
    }


@quiet()
def main() -> None:
    engines, messages = installed()
    for message in messages:
        print(message)
    rows = [
        row(name, settings, engine, run)
        for name in MECHANISMS
        for settings in SETTINGS
        for engine, run in engines.items()
    ]
    study_table.show(rows)


if __name__ == "__main__":
    main()
