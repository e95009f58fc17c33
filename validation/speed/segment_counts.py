"""Number of segments that the loop equations need along a path; exits with 1 if a count exceeds its limit.

One polynomial describes a segment of a path. Counts do not depend on the machine. Paths of high curvature are
tested (`tests/analytic/test_continuation_path.py`), because their counts reject mutants.

Run: python validation/speed/segment_counts.py
"""

import sys

import numpy as np

from mechsim import catalog
from mechsim.analytic.loops.design_motion import many_motion, shared_loops
from mechsim.analytic.loops.motion import crank_path
from mechsim.model.design_arrays import similar_designs
from mechsim.numerics import continuation

REVOLUTION = 2.0 * np.pi
MAX_SMOOTH = {"four_bar": 25, "rssr": 39, "slider_crank": 22}
MAX_OF_DESIGNS = {"rssr": (0.06, 36), "four_bar": (0.02, 23)}


def segments_tried(mechanism, stops) -> int:
    """Return the number of segments that are tried to trace a mechanism to each parameter in turn."""
    path, tried = crank_path(mechanism), []
    closed = path.closed
    path.closed = lambda *arguments: tried.append(arguments) or closed(*arguments)
    for stop in stops:
        path.extend(stop)
    return len(tried)


def segments_of_designs(name: str, spread: float) -> int:
    """Return the number of segments that three designs of a mechanism share over two revolutions."""
    crank, segments, nodes_between = catalog.make(name).crank, [], continuation.nodes_between
    cranks = (crank * (1.0 - spread), crank, crank * (1.0 + spread))
    mechanisms = [catalog.make(name, crank=length).mechanism for length in cranks]

    def counting(begin, end, count):
        segments.append(end)
        return nodes_between(begin, end, count)

    continuation.nodes_between = counting
    try:
        loops = shared_loops(mechanisms[1], ())
        design_arrays, _ = similar_designs(mechanisms[1], mechanisms)
        many_motion(loops, design_arrays, np.array([-7.0, 0.0, 7.0]), 1.0, ())
    finally:
        continuation.nodes_between = nodes_between
    return len(segments)


def main() -> int:
    stops, rows = (1.0, 4.0, REVOLUTION, -1.0, -REVOLUTION), []
    for name, limit in MAX_SMOOTH.items():
        rows.append((f"{name}, smooth", segments_tried(catalog.make(name).mechanism, stops), limit))
    for name, (spread, limit) in MAX_OF_DESIGNS.items():
        rows.append((f"{name}, three designs together", segments_of_designs(name, spread), limit))
    print("| path | segments | limit |\n|---|---|---|")
    for title, segments, limit in rows:
        print(f"| {title} | {segments} | {limit} |")
    return 1 if any(segments > limit for _, segments, limit in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
