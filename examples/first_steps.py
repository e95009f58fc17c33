"""First steps: a mechanism of the catalogue, solved in closed form, run in MuJoCo, judged.

Run: python examples/first_steps.py
"""

import numpy as np

import mechsim as ms

drive = ms.catalog.make("rssr", crank=0.013, coupler=0.046, rocker=0.027, pivot=(0.043, -0.010, -0.024))
print(f"the crank can stand {drive.crank_range()}")

exact = drive.solve(np.linspace(0.0, 2.0 * np.pi, 73), speed=ms.units.rpm(3000.0))
print(f"P3 moves at up to {np.linalg.norm(exact.points['P3'].velocity, axis=1).max():.3f} m/s")

run = ms.simulate(drive.mechanism, speed=ms.units.rpm(3000.0), turns=2.0, tolerance=1e-6)
print(f"MuJoCo: {run.outcome} with {run.settings.steps_per_turn} steps a turn, {run.steps} in all")

verdict = ms.crosscheck(run.motion, exact, tolerance=1e-6)
print(verdict)
assert verdict.passed, verdict
