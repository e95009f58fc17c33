"""Drift of energy and angle of a free crank in MuJoCo over many revolutions.

Every catalogue mechanism starts at 60 rad/s under gravity, without losses, with 4,000 steps a revolution.
The script prints the change of energy over a hundred revolutions (TURNS), relative to the largest kinetic
energy, and the largest error of the crank angle against the reduced equation over a tenth of them and over
all, in [rad].

Run: python validation/robustness/free_run_drift.py [TURNS [NAME ...]]
"""

import sys

import numpy as np

from mechsim import catalog, dynamics
from mechsim.mechanism.forces import Forces
from mechsim.simulation.dynamics.forward_run import stepped_run

SPEED, GRAVITY = 60.0, (0.0, -9.81, 0.0)
RECORDS_PER_TURN, STEPS_PER_TURN = 20, 4000


def main(turns: int, names: list[str]) -> None:
    few = turns // 10
    print(f"| mechanism | energy, {turns} turns | angle, {few} turns [rad] | angle, {turns} turns [rad] |")
    print("|---|---|---|---|")
    for name in names:
        model = dynamics.dynamic_model(catalog.make(name), Forces(gravity=GRAVITY))
        exact = dynamics.run(model, initial={"crank.v": SPEED}, turns=turns, samples=turns * RECORDS_PER_TURN)
        start = {model.mechanism.crank.name: float(exact.motion.angle[0])}
        rate = {model.mechanism.crank.name: SPEED}
        run = stepped_run(
            model.mechanism, model.forces, start, rate, exact.time, STEPS_PER_TURN // RECORDS_PER_TURN
        )
        angle = exact.motion.angle
        error = np.abs(run.motion.angle - angle)
        first_turns = np.abs(angle - angle[0]) <= 2.0 * np.pi * few
        energy = run.kinetic + run.potential
        drift = np.abs(energy - energy[0]).max() / run.kinetic.max()
        print(f"| {name} | {drift:.1e} | {error[first_turns].max():.1e} | {error.max():.1e} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else 100, sys.argv[2:] or list(catalog.MECHANISMS))
