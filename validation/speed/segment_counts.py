"""How many segments the loop equations need along a path; ends with 1 where a count is above its bound.

A segment is a stretch of a path that one polynomial describes. Counts do not depend on the machine. Those of
paths that bend sharply are tests (`tests/analytic/test_continuation_path.py`), because they kill mutants.

Run: python validation/speed/segment_counts.py
"""

import sys

import numpy as np

from mechsim import catalog
from mechsim.analytic.loops.design_motion import many_motion, shared_loops
from mechsim.analytic.loops.motion import crank_path
from mechsim.model.design_arrays import similar_designs
from mechsim.numerics import continuation

TURN = 2.0 * np.pi
SMOOTH = {"four_bar": 25, "rssr": 39, "slider_crank": 22}
TOGETHER = {"rssr": (0.06, 36), "four_bar": (0.02, 23)}


def cells_tried(mechanism, stops) -> int:
    """Return how many segments are tried to follow a mechanism to one parameter after the other."""
    followed, tried = crank_path(mechanism), []
    close = followed.closed
    followed.closed = lambda *given: tried.append(given) or close(*given)
    for stop in stops:
        followed.extend(stop)
    return len(tried)


def cells_together(name: str, spread: float) -> int:
    """Return how many segments three designs of a mechanism need together, over two turns."""
    own, cells, nodes = catalog.make(name).crank, [], continuation.nodes_between
    mechanisms = [catalog.make(name, crank=own * (1.0 + by)).mechanism for by in (-spread, 0.0, spread)]

    def counted(begin, end, count):
        cells.append(end)
        return nodes(begin, end, count)

    continuation.nodes_between = counted
    try:
        alike = shared_loops(mechanisms[1], ())
        started, _ = similar_designs(mechanisms[1], mechanisms)
        many_motion(alike, started, np.array([-7.0, 0.0, 7.0]), 1.0, ())
    finally:
        continuation.nodes_between = nodes
    return len(cells)


def main() -> int:
    rows = [
        (f"{name}, smooth", cells_tried(catalog.make(name).mechanism, (1.0, 4.0, TURN, -1.0, -TURN)), most)
        for name, most in SMOOTH.items()
    ]
    for name, (spread, most) in TOGETHER.items():
        rows.append((f"{name}, three designs together", cells_together(name, spread), most))
    print("| path | cells | bound |\n|---|---|---|")
    for what, cells, most in rows:
        print(f"| {what} | {cells} | {most} |")
    return 1 if any(cells > most for _, cells, most in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
