"""Segments of a path: closed configurations at Chebyshev nodes, their polynomials, and their lengths."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.numerics.arrays import CLOSED, TINY, Array
from mechsim.numerics.collocation import Interpolant, interpolation_error
from mechsim.numerics.loop_solver import E, Linearised, LoopSolver, Q
from mechsim.numerics.newton import NewtonSettings, newton


@dataclass(frozen=True, slots=True)
class StepControl:
    """Lengths of the segments of a path, and the errors at which a segment is rejected.

    Lengths have the unit of the path parameter: [rad] of a crank, or arc length in [rad] and characteristic
    lengths. Errors are in [rad] and characteristic lengths. With the defaults a smooth revolution needs few
    segments: 21 to 37 were counted over two revolutions of a slider-crank, a four-bar and an RSSR.

    Attributes:
        nodes: Chebyshev nodes of a segment.
        first_length: length of the first segment, which the tangent predicts.
        max_length: largest length.
        min_length: length below which the path ends at a singular configuration.
        max_growth: largest ratio of successive lengths.
        shrink: ratio after a rejected segment.
        max_error: interpolation error above which a segment is rejected.
        target_error: interpolation error for which the next segment is chosen.
        max_correction: corrector displacement above which a segment is rejected: Newton's method may
            have converged to another assembly mode.
        target_correction: corrector displacement for which the next segment is chosen.

    Source: P. Deuflhard, Newton methods for nonlinear problems (2004), chapter 5.
    """

    nodes: int = 9
    first_length: float = 0.1
    max_length: float = 1.2
    min_length: float = 1e-13
    max_growth: float = 3.0
    shrink: float = 0.5
    max_error: float = 1e-4
    target_error: float = 1e-5
    max_correction: float = 5e-2
    target_correction: float = 5e-3

    def growth(self, error: ArrayLike, correction: ArrayLike | None = None, ratio: float = 1.0) -> Array:
        """Return the largest ratio of the next segment's length to this one's.

        Args:
            error: interpolation error of this segment by half of its nodes, of any shape.
            correction: displacement of the corrector from the polynomial of the previous segment; None
                without this prediction.
            ratio: length of the previous segment divided by this one's.
        """
        # the interpolation error of half the nodes grows with the length to the power of their number
        order = (self.nodes + 1) / 2
        growth = np.minimum(self.max_growth, (self.target_error / np.maximum(error, TINY)) ** (1.0 / order))
        if correction is None:
            return growth
        # the error of an extrapolated polynomial grows as the product of the distances to its nodes
        reach = (self.target_correction / np.maximum(correction, TINY)) ** (1.0 / self.nodes)
        return np.minimum(growth, (1.0 + 0.5 * ratio) * reach - 0.5)


# path parameter (n,) -> prescribed coordinates in their units, (driven, n)
PrescribedValues = Callable[[Array], Array]

# limits of segment lengths, and errors above which a segment is rejected
CONTROL = StepControl()


@dataclass(frozen=True)
class Segment(Interpolant, Generic[E, Q]):
    """A segment of a path: the polynomial through closed coordinates at its nodes.

    Attributes:
        solver: solver of its poses.
        adequate: whether the solver's equations are well conditioned at the last node, for each design, (d,);
            None if unknown.
        final: whether the path ends with it, at a fold point.
    """

    solver: LoopSolver[E, Q]
    adequate: NDArray[np.bool_] | None = None
    final: ClassVar[bool] = False

    def restricted(self, low: float, high: float) -> Self:
        """Return the same polynomial through nodes from one parameter to another."""
        return replace(super().restricted(low, high), adequate=None)


@dataclass(frozen=True)
class ClosedNodes:
    """Closed nodes of a segment for d designs; d is 1 for one mechanism.

    Attributes:
        states: states of the nodes, (k, d w).
        linearised: the loops at k d instants; each d consecutive instants are those of the designs.
        displacement: largest corrector displacement of each design over the nodes, (d,).
        valid: designs that are closed after an admissible displacement, (d,).
    """

    states: Array
    linearised: Linearised
    displacement: Array
    valid: NDArray[np.bool_]

    @property
    def error(self) -> Array:
        """Interpolation error of each design, estimated from half of the nodes, (d,)."""
        return interpolation_error(self.states).reshape(len(self.valid), -1).max(1)


class PathStates(Generic[E, Q]):
    """Poses along a path of the drivers as state vectors; those of d designs are concatenated.

    Attributes:
        loops: loop equations of one mechanism or of designs.
        prescribed: values of the prescribed coordinates along the path.
        count: number of designs, d; 1 for one mechanism.
    """

    def __init__(self, loops: E, prescribed: PrescribedValues, count: int = 1):
        self.loops, self.prescribed, self.count = loops, prescribed, count

    @property
    def name(self) -> str:
        """Name of the mechanism or model."""
        return self.loops.name

    def unflat(self, rows: Array, s: Array, driven: Array | None = None) -> Q:
        """Return coordinates, (n d) sets, from approximate states (n, d w) at parameters (n,)."""
        driven = self.prescribed(s) if driven is None else driven
        if self.count > 1:
            rows, driven = rows.reshape(len(s) * self.count, -1), np.repeat(driven, self.count, 1)
        return self.loops.unflat(rows, driven)

    def flat(self, q: Q) -> Array:
        """Return states, (n, d w), of coordinates, (n d) sets."""
        rows = self.loops.flat(q)
        return rows.reshape(len(rows) // self.count, -1)

    def closed(
        self, solver: LoopSolver[E, Q], s: Array, rows: Array, tolerance: float = 0.0
    ) -> ClosedNodes | None:
        """Return nodes at parameters (k,) closed from approximate states; None if no design closes.

        The nodes are closed to rounding, or to a residual below the tolerance.
        """
        try:
            settings = NewtonSettings(
                tolerance=tolerance, max_displacement=CONTROL.max_correction, verify=False
            )
            result = newton(solver, self.unflat(rows, s), settings)
        except np.linalg.LinAlgError:
            return None
        linearised = result.linearised
        if result.unverified is not None:
            change = linearised.times(solver.whole_step(result.unverified))
            linearised = replace(linearised, residual=linearised.residual + change)
        largest = np.abs(linearised.residual).max(0, initial=0.0)
        residual, displacement = (
            values.reshape(-1, self.count).max(0) for values in (largest, result.displacement)
        )
        valid = (residual <= max(CLOSED, tolerance)) & (displacement < CONTROL.max_correction)
        return ClosedNodes(self.flat(result.q), linearised, displacement, valid) if valid.any() else None
