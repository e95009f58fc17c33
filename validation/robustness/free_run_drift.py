"""How far a crank that runs freely in MuJoCo strays over many turns, in its energy and its angle.

Every catalogue mechanism is let go at 60 rad/s under its weight, without losses, in 4,000 steps a turn.
Prints the energy balance over a hundred turns, relative to the largest kinetic energy, and the worst distance
of the crank angle from the reduced equation over ten and a hundred turns, in [rad].

Run: python validation/robustness/free_run_drift.py [NAME ...]
"""

import sys

import numpy as np

from mechsim import catalog, dynamics
from mechsim.model.forces import Forces
from mechsim.simulation.dynamics.forward_run import stepped_run

SPEED, TURNS, WEIGHT = 60.0, (10, 100), (0.0, -9.81, 0.0)
# records and steps of a turn
PER_TURN, STEPS = 20, 4000


def main(names: list[str]) -> None:
    print("| mechanism | energy, 100 turns | angle, 10 turns [rad] | angle, 100 turns [rad] |")
    print("|---|---|---|---|")
    for name in names:
        machine = dynamics.dynamic_model(catalog.make(name), Forces(gravity=WEIGHT))
        exact = dynamics.free_run(machine, speed=SPEED, turns=TURNS[-1], samples=TURNS[-1] * PER_TURN + 1)
        start = {machine.mechanism.crank.name: float(exact.angle[0])}
        rate = {machine.mechanism.crank.name: SPEED}
        run = stepped_run(machine.mechanism, machine.forces, start, rate, exact.time, STEPS // PER_TURN)
        error, angle = np.abs(run.motion.angle - exact.angle), np.abs(exact.angle - exact.angle[0])
        early = angle <= 2.0 * np.pi * TURNS[0]
        energy = run.kinetic + run.potential
        drift = np.abs(energy - energy[0]).max() / run.kinetic.max()
        print(f"| {name} | {drift:.1e} | {error[early].max():.1e} | {error.max():.1e} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(catalog.DRIVES))
