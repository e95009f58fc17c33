"""By how much the drivers' power misses what links, springs and weight take and friction loses.

Energies and losses are added up from the motion of links and joints alone, as `tests/studies/` does it,
under gravity, friction, springs, dampers, a load and a couple at once. Prints, as parts of the largest power,
what each method misses; stepped runs as `mechsim dynamics` steps them.

Run: python validation/robustness/power_balance.py [NAME ...]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "studies"))
from test_power_balance import CRANKS, PROGRAMS, balance, busy, moved

from mechsim import load
from mechsim.model.masses import with_inertia

METHODS = ("pose", "formulas", "step")


def main() -> None:
    """Print a line for each mechanism."""
    print(f"{'':16s}" + "".join(f"{method:>12s}" for method in METHODS))
    for name in sys.argv[1:] or (*CRANKS, *PROGRAMS):
        form = load(name)
        mechanism, forces = with_inertia(form.mechanism), busy(form.mechanism)
        missed = [balance(mechanism, forces, *moved(form, mechanism, forces, method)) for method in METHODS]
        print(f"{name:16s}" + "".join(f"{item:12.1e}" for item in missed), flush=True)


if __name__ == "__main__":
    main()
