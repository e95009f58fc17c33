"""A straighter line: lengths of a Hoeken linkage whose point stays closer to a line over half a turn.

The crank keeps its length. Ground, coupler, rocker and the arm of the point may change by a tenth. The line
must not get shorter. The loops must close at every crank angle, so the crank still rotates fully.

Run: python examples/design/straighter_line.py
"""

import numpy as np

import mechsim as ms
from mechsim import catalog
from mechsim.studies.optimise import Goal, Limit, Optimum, Quantities, largest, smallest

HOEKEN = {"crank": 0.04, "ground": 0.08, "coupler": 0.1, "rocker": 0.1, "arm": 0.2, "arm_angle": 0.0}
CRANK_ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
# the half of the turn over which the point runs along its line
HALF = slice(9, 28)


def off(values: Quantities) -> object:
    """How far the point is off its mean height."""
    height = values["C.y"][HALF]
    return height - height.mean()


def length(values: Quantities) -> object:
    """How long the line is."""
    along = values["C.x"][HALF]
    return largest(along) - smallest(along)


def search() -> Optimum:
    start = ms.moved(catalog.make("four_bar", **HOEKEN), angles=CRANK_ANGLES)
    vary = {name: (0.9 * HOEKEN[name], 1.1 * HOEKEN[name]) for name in ("ground", "coupler", "rocker", "arm")}
    before = float(np.ptp(start.values(["C.x"], {})["C.x"][HALF]))
    limit = Limit(("C.x",), length, low=before, name="length of the line")
    return ms.optimise(start, vary, Goal(("C.y",), off), [limit])


if __name__ == "__main__":
    best = search()
    print(
        f"{best.outcome}: {', '.join(f'{name} {1e3 * value:.3f} mm' for name, value in best.values.items())}"
    )
    print(f"off the line {1e6 * best.before:.2f} um before, {1e6 * best.after:.2f} um now, root mean square")
