"""Power balance of drivers against links, springs, gravity and friction, by every method.

Energies and losses follow from the motion of links and joints alone (`tests/laws/`), with gravity,
friction, springs, dampers, a load and a couple. The script prints the error of each method relative to the
largest power; runs are stepped as by `mechsim dynamics`.

Run: python validation/robustness/power_balance.py [NAME ...]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "laws"))
from test_power_balance import CRANKS, SEVERAL_DRIVERS, every_force, motion_and_forces, relative_imbalance

from mechsim import load
from mechsim.mechanism.masses import with_inertia

METHODS = ("pose", "formulas", "step")


def main() -> None:
    """Print a line for each mechanism."""
    print(f"{'':16s}" + "".join(f"{method:>12s}" for method in METHODS))
    for name in sys.argv[1:] or (*CRANKS, *SEVERAL_DRIVERS):
        solver = load(name)
        mechanism, forces = with_inertia(solver.mechanism), every_force(solver.mechanism)
        errors = [
            relative_imbalance(mechanism, forces, *motion_and_forces(solver, mechanism, forces, method))
            for method in METHODS
        ]
        print(f"{name:16s}" + "".join(f"{item:12.1e}" for item in errors), flush=True)


if __name__ == "__main__":
    main()
