"""The same MJCF models under each engine that is installed, against the exact closure.

Problem: mechanisms of the catalogue as `mechsim export` writes them, one turn at 600 rpm from a closed moving
start. Settings: as exported (time constant 2 ms, impedance .9999, RK4, references not adapted to the step),
with a time constant of a tenth of a turn, and MuJoCo's own loops and integrator. The solver takes two
iterations, for with equalities alone one is exact. Reference: the closed form at the run's own crank angles;
its error is rounding. Places come from the recorded coordinates by MuJoCo's kinematics in float64: what errs
is the stepping.

    python validation/engines/compare.py [--out DIR]
"""

import copy
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "choices"))

import study_table as sheet
from engines import Engine, installed

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.simulation import loop_jacobian, mjcf
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.source import assembled

MECHANISMS = ("four_bar", "rssr", "looper")
SPEED, STEPS, ITERATIONS = 20.0 * np.pi, 360, 2
TURN = 2.0 * np.pi / SPEED
HARD, SOFT = (0.9999, 0.9999, 0.001, 0.5, 2.0), (0.9, 0.95, 0.001, 0.5, 2.0)
SETTINGS = {
    "as exported": ((0.002, 1.0), HARD, mujoco.mjtIntegrator.mjINT_RK4),
    "turn/10, .9999": ((TURN / 10.0, 1.0), HARD, mujoco.mjtIntegrator.mjINT_RK4),
    "MuJoCo's own": ((0.02, 1.0), SOFT, mujoco.mjtIntegrator.mjINT_EULER),
}


def row(name: str, settings: str, engine: str, run: Engine) -> dict[str, Any]:
    """Return what an engine makes of a mechanism."""
    drive = catalog.make(name)
    model = mjcf.compiled(assembled(drive.mechanism, Scene(level="motion")))
    loops = read_loops(copy.copy(model))
    qpos = loop_jacobian.close(loops, model.qpos0[None])
    qvel = SPEED * loop_jacobian.tangent(loops, loops.linearise(qpos)[1])
    solref, solimp, integrator = SETTINGS[settings]
    model.eq_solref[:], model.eq_solimp[:] = solref, solimp
    model.opt.timestep, model.opt.integrator = TURN / STEPS, integrator
    model.opt.iterations = ITERATIONS
    try:
        states, seconds = run(model, qpos[0], qvel[0], STEPS, np.zeros(model.nu))
    except (ValueError, NotImplementedError, RuntimeError) as error:
        output = {"place": np.nan, "crank [rad]": np.nan, "ms a turn": " ".join(str(error).split())[:60]}
        return {"mechanism": name, "settings": settings, "engine": engine} | output
    time = TURN * (1.0 + np.arange(STEPS)) / STEPS
    angle = states[:, loops.crank_address]
    place = np.inf
    if np.isfinite(states).all():
        exact, result = drive.positions(angle), loops.posed.site_positions(states)
        gaps = [
            np.linalg.norm(result[:, model.site(site).id] - at, axis=1).max() for site, at in exact.items()
        ]
        place = float(max(gaps)) / drive.crank
    return {
        "mechanism": name,
        "settings": settings,
        "engine": engine,
        "place": place,
        "crank [rad]": float(np.abs(angle - qpos[0, loops.crank_address] - SPEED * time).max()),
        "ms a turn": f"{1e3 * seconds:.3g}",
    }


@mjcf.quiet()
def main() -> None:
    out = sheet.folder(__doc__ or "")
    there, missing = installed()
    for line in missing:
        print(line)
    rows = [
        row(name, settings, engine, run)
        for name in MECHANISMS
        for settings in SETTINGS
        for engine, run in there.items()
    ]
    sheet.show(rows, out, "engines")


if __name__ == "__main__":
    main()
