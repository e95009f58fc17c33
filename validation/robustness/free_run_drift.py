"""How far a crank that runs freely in MuJoCo strays over many turns, in its energy and its angle.

Every catalogue mechanism is let go at 60 rad/s under its weight, without losses, by the default settings.
Prints the energy balance over a hundred turns, as a part of the energy turned over, and the worst distance
of the crank angle from the reduced equation over ten and a hundred turns, in [rad].

Run: python validation/robustness/free_run_drift.py [NAME ...]
"""

import sys

import numpy as np

from mechsim import catalog, dynamics
from mechsim.model.forces import Forces
from mechsim.simulation.dynamics.free_motion import free_run

SPEED, TURNS, WEIGHT = 60.0, (10, 100), (0.0, -9.81, 0.0)


def main(names: list[str]) -> None:
    print("| mechanism | energy, 100 turns | angle, 10 turns [rad] | angle, 100 turns [rad] |")
    print("|---|---|---|---|")
    for name in names:
        machine = dynamics.dynamic_model(catalog.make(name), Forces(gravity=WEIGHT))
        run = free_run(machine.mechanism, machine.forces, speed=SPEED, turns=TURNS[-1]).free
        exact = dynamics.free_run(machine, angle=float(run.angle[0]), speed=SPEED, times=run.time)
        off = np.abs(run.angle - exact.angle)
        early = np.abs(run.angle - run.angle[0]) <= 2.0 * np.pi * TURNS[0]
        print(f"| {name} | {run.energy_error:.1e} | {off[early].max():.1e} | {off.max():.1e} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(catalog.DRIVES))
