"""Motion across a singular configuration by collocation.

Accelerations have no digits at the singular configuration, but the motion is smooth. Gauss-Legendre nodes lie
on both sides of it; fixed-point iteration makes the polynomial satisfy the equations of motion at all nodes.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.7.
"""

from collections.abc import Callable

import numpy as np
from numpy.polynomial import legendre

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array

# nodes, an even number: none lies in the middle, where the singular configuration is
NODES = 12
# iterations at the most, and change of the solution relative to its size at which they have converged
ITERATIONS, CONVERGED = 25, 1e-13
# a change that no longer falls below this fraction of the one before is rounding, up to ROUNDING
SHRINKING, ROUNDING = 0.5, 1e-8
# distance of the nodes from the loops, in sizes or radians, above which the path does not cross
ON_LOOPS = 1e-9


def collocated(
    derivative: Callable[[float, Array], tuple[Array, float]],
    start: float,
    state: Array,
    duration: float,
    guess: Callable[[float], Array],
) -> Callable[[float], Array] | None:
    """Return the solution over an interval with a singular configuration in it; None where it is not smooth.

    Args:
        derivative: (time, state) -> derivative at the nearest state on the loops, and the distance to it.
        start: of the interval, in [s].
        state: at the start, (n,).
        duration: of the interval in [s].
        guess: a solution that is extrapolated to the nodes.

    Returns:
        Function from time in [s] to state (n,).
    """
    nodes = legendre.leggauss(NODES)[0]
    to_series = np.linalg.inv(legendre.legvander(nodes, NODES - 1))
    times = start + 0.5 * duration * (1.0 + nodes)
    states = np.array([guess(float(time)) for time in times])
    before = np.inf
    for _ in range(ITERATIONS):
        try:
            evaluated = [derivative(float(time), node) for time, node in zip(times, states, strict=True)]
        except AssemblyError:
            return None
        series = legendre.legint(to_series @ np.array([rate for rate, _ in evaluated]), lbnd=-1.0)
        solution = LegendreSolution(start, duration, state, series)
        new = np.array([solution(float(time)) for time in times])
        change = float((np.abs(new - states) / (1.0 + np.abs(states))).max())
        states = new
        if not np.isfinite(change):
            return None
        if change < CONVERGED or (change < ROUNDING and change > SHRINKING * before):
            distance = max(distance for _, distance in evaluated)
            return solution if distance <= ON_LOOPS else None
        before = change
    return None


class LegendreSolution:
    """A polynomial solution over one interval.

    Attributes:
        start: of the interval in [s].
        duration: of the interval in [s].
        state: at the start, (size,).
        series: Legendre coefficients of the integrated derivative, (nodes + 1, size).
    """

    def __init__(self, start: float, duration: float, state: Array, series: Array) -> None:
        self.start, self.duration, self.state, self.series = start, duration, state, series

    def __call__(self, time: float) -> Array:
        """Return the state (size,) at a time in [s]."""
        x = 2.0 * (time - self.start) / self.duration - 1.0
        return self.state + 0.5 * self.duration * legendre.legval(x, self.series)
