"""Motion across a singular configuration by collocation.

At a singular configuration accelerations have no significant digits, but the motion is smooth. The
Gauss-Legendre nodes lie on both sides of it, and none lies in the middle.
"""

from collections.abc import Callable

import numpy as np

from mechsim.analytic.dynamics.right_hand_side import RightHandSide
from mechsim.numerics.arrays import Array
from mechsim.numerics.gauss_collocation import StepSolution, collocated, node_times

# number of nodes; even, so that none lies in the middle, at the singular configuration
NODES = 12
# relative change of the solution at convergence, and multiple of it up to which a change may be rounding
CONVERGED, ROUNDING = 1e-13, 1e5
# distance of the nodes from the loops, in characteristic lengths or [rad], above which the path does not
# cross
ON_LOOPS = 1e-9
# smallest singular value in the middle relative to that at the start, above which the path does not cross
PASSING = 0.3
# largest number of trial durations for a crossing, each 1.5 times the one before
CROSSINGS = 12


def crossing(
    equations: RightHandSide,
    time: float,
    state: Array,
    approach: float,
    ahead: Callable[[Array], Array],
) -> StepSolution | None:
    """Return the solution across the next singular configuration; None if the path does not cross it.

    Args:
        equations: equations of motion.
        time: initial time in [s].
        state: initial state, (size,).
        approach: time in [s] to the singular configuration at the present rate of approach.
        ahead: times (n,) in [s] -> extrapolated states (n, size).
    """
    conditioning, duration = equations.conditioning(state), 2.0 * approach
    for _ in range(CROSSINGS):
        beyond = equations.conditioning(ahead(np.array([time + duration]))[0])
        if beyond > conditioning:
            # the smallest singular value is proportional to the distance on both sides
            return _across(
                equations, time, state, duration * 2.0 * conditioning / (conditioning + beyond), ahead
            )
        duration *= 1.5
    return None


def _across(
    equations: RightHandSide, time: float, state: Array, duration: float, ahead: Callable[[Array], Array]
) -> StepSolution | None:
    """Return the solution over a duration in [s] with the singular configuration in its middle."""
    guess = ahead(node_times(time, duration, NODES))
    tolerance = CONVERGED * (1.0 + np.abs(state))
    result = collocated(equations.on_loops, time, state, duration, guess, tolerance, ROUNDING)
    if result is None:
        return None
    solution, _ = result
    middle = equations.conditioning(solution(time + 0.5 * duration))
    if middle > PASSING * equations.conditioning(state):
        return None
    times = node_times(time, duration, NODES)
    nodes = solution(times)
    distance = np.abs(nodes - equations.nearest_on_loops(times, nodes))[:, : equations.layout.positions]
    return solution if distance.max() <= ON_LOOPS else None
