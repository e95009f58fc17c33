"""Segments of a path: coordinates closed at Chebyshev nodes, and the polynomial through them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.constraints import TreeLoops, orthogonal
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.solver import Linearised, LoopSolver
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton

# path parameter (n,) -> prescribed coordinates in their units, (driven, n)
PrescribedValues = Callable[[Array], Array]

# largest residual of a closed pose, and largest corrector displacement, in radians or relative to the
# characteristic length: beyond it Newton's method may converge to another assembly
CLOSED, MAX_CORRECTION = 1e-12, 5e-2


@dataclass(frozen=True)
class Segment:
    """A segment of a path: coordinates closed at Chebyshev nodes, and the polynomial through them.

    Attributes:
        nodes: parameters, (k,).
        states: flattened coordinates, (k, w).
        weights: barycentric, (k,).
        solver: of its poses.
        adequate: whether the solver's rows are well conditioned at each node, (k,); None if unknown.
    """

    nodes: Array
    states: Array
    weights: Array
    solver: LoopSolver
    adequate: NDArray[np.bool_] | None = None

    @property
    def low(self) -> float:
        """Its lowest parameter."""
        return float(min(self.nodes[0], self.nodes[-1]))

    @property
    def length(self) -> float:
        """The range of the parameter."""
        return abs(float(self.nodes[-1] - self.nodes[0]))

    def evaluate(self, s: Array) -> Array:
        """Return the polynomial at parameters (n,), (n, w)."""
        distance = s[:, None] - self.nodes
        at_node = distance == 0.0
        weights = np.where(at_node.any(1)[:, None], at_node, self.weights / np.where(at_node, 1.0, distance))
        total = weights.sum(1, keepdims=True)
        # far beyond the nodes the weights cancel: the nearest node is used
        cancelled = total[:, 0] == 0.0
        if cancelled.any():
            weights[cancelled] = np.eye(len(self.nodes))[np.abs(distance[cancelled]).argmin(1)]
            total[cancelled] = 1.0
        return (weights / total) @ self.states

    def derivative(self) -> "Segment":
        """Return the polynomial's derivative, through the same nodes."""
        distance = self.nodes[:, None] - self.nodes
        np.fill_diagonal(distance, 1.0)
        matrix = self.weights / self.weights[:, None] / distance
        np.fill_diagonal(matrix, 0.0)
        np.fill_diagonal(matrix, -matrix.sum(1))
        return replace(self, states=matrix @ self.states)

    def restricted(self, low: float, high: float) -> "Segment":
        """Return the same polynomial through nodes from one parameter to another."""
        nodes, weights = nodes_between(low, high, len(self.nodes))
        return replace(self, nodes=nodes, states=self.evaluate(nodes), weights=weights, adequate=None)

    def truncation_error(self) -> float:
        """Return the truncation error, estimated by the last three Chebyshev coefficients."""
        middle, reach = 0.5 * (self.nodes[0] + self.nodes[-1]), 0.5 * (self.nodes[-1] - self.nodes[0])
        basis = np.polynomial.chebyshev.chebvander((self.nodes - middle) / reach, len(self.nodes) - 1)
        return float(np.abs(np.linalg.solve(basis, self.states)[-3:]).max())


def nodes_between(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Return Chebyshev points of the second kind from one end to the other, and barycentric weights."""
    cosines, weights = _chebyshev(count)
    nodes = 0.5 * (low + high) + 0.5 * (low - high) * cosines
    nodes[0], nodes[-1] = low, high
    return nodes, weights


def interpolation_error(states: Array) -> Array:
    """Return the error at odd nodes of the polynomial through even nodes, for columns (k, w): (w,)."""
    return np.abs(_odd_from_even(len(states)) @ states[::2] - states[1::2]).max(0)


@cache
def _odd_from_even(count: int) -> Array:
    nodes, half = nodes_between(0.0, 1.0, count)[0], nodes_between(0.0, 1.0, count // 2 + 1)
    weights = half[1] / (nodes[1::2, None] - half[0])
    return weights / weights.sum(1, keepdims=True)


@cache
def _chebyshev(count: int) -> tuple[Array, Array]:
    weights = np.where(np.arange(count) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    return np.cos(np.pi * np.arange(count) / (count - 1)), weights


class PathStates:
    """Poses along a path of the drivers as state vectors.

    Attributes:
        loops: of the mechanism.
        prescribed: values of the prescribed coordinates along the path.
    """

    def __init__(self, loops: TreeLoops, prescribed: PrescribedValues):
        self.loops, self.prescribed = loops, prescribed

    def flat(self, q: Coordinates) -> Array:
        """Return coordinates as rows of numbers, (n, w)."""
        values = (q.values / self.loops.units[:, None]).T
        return np.concatenate([values, q.turns.reshape(-1, len(q)).T], 1)

    def unflat(self, rows: Array, s: Array, driven: Array | None = None) -> Coordinates:
        """Return coordinates from approximate states at parameters (n,)."""
        k = self.loops.tree.count
        rotations = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))
        if len(rotations):
            rotations = np.stack([orthogonal(orthogonal(rotation)) for rotation in rotations])
        values = rows[:, :k].T * self.loops.units[:, None]
        values[list(self.loops.driven)] = self.prescribed(s) if driven is None else driven
        return Coordinates(values, rotations)

    def closed(
        self, solver: LoopSolver, s: Array, rows: Array, tolerance: float = 0.0
    ) -> tuple[Array, Linearised, float] | None:
        """Return closed states from approximate ones, the loops there, and the displacement; None on failure.

        To rounding, or to a residual below the tolerance.
        """
        try:
            settings = NewtonSettings(tolerance=tolerance, max_displacement=MAX_CORRECTION, verify=False)
            result = newton(solver, self.unflat(rows, s), settings)
        except np.linalg.LinAlgError:
            return None
        linearised = result.linearised
        if result.unverified is not None:
            change = np.einsum(
                "rkn,nk->rn", linearised.jacobian.take(linearised.unknown, 1), result.unverified
            )
            linearised = replace(linearised, residual=linearised.residual + change)
        residual = np.abs(linearised.residual).max(initial=0.0)
        displacement = float(result.displacement.max())
        if not (residual <= max(CLOSED, tolerance) and displacement < MAX_CORRECTION):
            return None
        return self.flat(result.q), linearised, displacement
