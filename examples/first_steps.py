"""First steps: solve a mechanism of the catalogue in closed form, run it in MuJoCo, compare the two.

Run: python examples/first_steps.py
"""

import numpy as np

import mechsim as ms

solver = ms.catalog.make("rssr", crank=0.013, coupler=0.046, rocker=0.027, pivot=(0.043, -0.010, -0.024))
print(f"crank range: {solver.crank_range()}")

exact = solver.solve(np.linspace(0.0, 2.0 * np.pi, 73), speed=ms.units.rpm(3000.0))
print(f"P3 moves at up to {np.linalg.norm(exact.points['P3'].velocity, axis=1).max():.3f} m/s")

run = ms.simulate(solver.mechanism, speed=ms.units.rpm(3000.0), turns=2.0, tolerance=1e-6)
print(f"MuJoCo: {run.outcome} with {run.settings.steps_per_turn} steps a turn, {run.steps} in all")

verdict = ms.crosscheck(run.motion, exact, tolerance=1e-6)
print(verdict)
assert verdict.passed, verdict
