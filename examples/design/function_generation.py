"""Function generation: a four-bar whose rocker turns as the logarithm of its crank's turn.

While the crank goes through 60 degrees, x goes from 1 to 2; the rocker is to go through 60 degrees as log x
does, from wherever it begins. Source of the task: F. Freudenstein, Approximate synthesis of four-bar
linkages, Trans. ASME 77 (1955) 853-861.

Run: python examples/design/function_generation.py
"""

import numpy as np

import mechsim as ms
from mechsim import catalog
from mechsim.studies.optimise import Goal, Optimum, Quantities

BEGIN, SWEEP = np.deg2rad(25.0), np.deg2rad(60.0)
FRACTION = np.linspace(0.0, 1.0, 13)
TARGET = SWEEP * np.log(1.0 + FRACTION) / np.log(2.0)


def off(values: Quantities) -> object:
    """By how much the rocker is off, wherever it begins."""
    error = values["rocker.q"] - TARGET
    return error - error.mean()


def search() -> Optimum:
    initial = catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.08, rocker=0.07)
    start = ms.moved(initial, angles=BEGIN + SWEEP * FRACTION)
    vary = {"crank": (0.02, 0.2), "coupler": (0.02, 0.3), "rocker": (0.02, 0.2)}
    return ms.optimise(start, vary, Goal(("rocker.q",), off))


if __name__ == "__main__":
    best = search()
    print(
        f"{best.outcome}: {', '.join(f'{name} {1e3 * value:.3f} mm' for name, value in best.values.items())}"
    )
    print(
        f"rocker off by {np.rad2deg(best.before):.3f} deg before, {np.rad2deg(best.after):.4f} deg now, "
        "root mean square"
    )
