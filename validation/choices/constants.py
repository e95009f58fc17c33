"""A constant of the package times factors: errors and cost over random mechanisms up to their dead centres.

    python validation/choices/constants.py numerics.fold_points.MAX_TRUNCATION COUNT 0.1 10

Set: catalogue mechanisms of random dimensions whose cranks swing, of scale 1e-3, 1 and 1e3. Reference: their
closed forms. Errors: of points 1e-8 to 0.1 rad from both dead centres, relative to the size, times the root
of this distance; and of the crank's range in [rad], from which paths keep 1e-13. Cost: processor time.
"""

import importlib
import itertools
import sys
import time
from pathlib import Path

import numpy as np
import study_table as sheet

from mechsim import catalog
from mechsim.errors import MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import interval_around

sys.path.append(str(Path(__file__).parents[1] / "robustness"))

from random_catalog_mechanisms import random_mechanism

# a mechanism and the dead centres of its crank
Swinging = tuple[KinematicSolver, float, float]
SCALES, DISTANCES = (1e-3, 1.0, 1e3), np.geomspace(1e-8, 0.1, 8)


def swinging(count: int) -> list[Swinging]:
    """Return mechanisms and the dead centres of their cranks."""
    random, result = np.random.default_rng(3), list[Swinging]()
    for number in itertools.takewhile(lambda _: len(result) < count, itertools.count()):
        solver = random_mechanism(number, random)
        names = [name for name, row in catalog.parameters(solver.name).items() if row.unit == "m"]
        lengths = {name: np.multiply(getattr(solver, name), SCALES[number % 3]).tolist() for name in names}
        solver = solver.with_parameters(**lengths)
        arcs, start = solver.crank_range(), solver.mechanism.start
        if not arcs.full and (ends := interval_around(arcs, start)):
            result.append((solver, *ends))
    return result


def measured(mechanisms: list[Swinging], factor: float) -> dict[str, object]:
    """Return a row: largest errors by the loop equations, rejected mechanisms, processor time."""
    errors, ends, begin = [0.0], [0.0], time.process_time()
    for solver, low, high in mechanisms:
        distance = np.minimum(DISTANCES, 0.2 * (high - low))
        angles, loops = np.concatenate([high - distance, low + distance]), KinematicSolver(solver.mechanism)
        exact, root = solver.solve(angles).points, np.sqrt(np.tile(distance, 2))[:, None]
        try:
            points = loops.solve(angles).points
            traced = interval_around(loops.crank_range(), solver.mechanism.start) or (np.inf, np.inf)
        except MechsimError:
            continue
        away = [np.abs((points[name].position - exact[name].position) * root).max() for name in exact]
        errors.append(float(max(away)) / solver.mechanism.characteristic_length)
        ends.append(float(np.abs(np.subtract(traced, (low, high))).max()))
    row = {"factor": f"{factor:g}", "points": max(errors), "range": max(ends)}
    return row | {"rejected": len(mechanisms) + 1 - len(errors), "seconds": time.process_time() - begin}


def main(constant: str, count: str, *factors: str) -> None:
    home, name = f"mechsim.{constant}".rsplit(".", 1)
    value, mechanisms = getattr(importlib.import_module(home), name), swinging(int(count))
    # the first run imports what the others use
    rows = [measured(mechanisms, 1.0), measured(mechanisms, 1.0)]
    for factor in map(float, factors):
        # modules that import it have names of their own for it; an integer may be that of another constant
        for each in [each for each in sys.modules.values() if each.__name__.startswith("mechsim.")]:
            if each.__name__ == home or (not isinstance(value, int) and vars(each).get(name) is value):
                setattr(each, name, type(value)(value * factor))
        rows.append(measured(mechanisms, factor))
    sheet.show(rows[1:])


if __name__ == "__main__":
    main(*sys.argv[1:])
