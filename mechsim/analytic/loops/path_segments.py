"""Segments of a path: coordinates closed at Chebyshev nodes, and the polynomial through them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.constraints import TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.solver import Linearised, LoopSolver
from mechsim.numerics.arrays import Array
from mechsim.numerics.collocation import Interpolant
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.step_control import StepControl

# path parameter (n,) -> prescribed coordinates in their units, (driven, n)
PrescribedValues = Callable[[Array], Array]

# largest residual of a closed pose, in radians and characteristic lengths
CLOSED = 1e-12
# lengths of segments, and the errors at which one is rejected
CONTROL = StepControl()


@dataclass(frozen=True)
class Segment(Interpolant):
    """A segment of a path: the polynomial through coordinates closed at its nodes.

    Attributes:
        solver: of its poses.
        adequate: whether the solver's rows are well conditioned at each node, (k,); None if unknown.
    """

    solver: LoopSolver
    adequate: NDArray[np.bool_] | None = None

    def restricted(self, low: float, high: float) -> Self:
        """Return the same polynomial through nodes from one parameter to another."""
        return replace(super().restricted(low, high), adequate=None)


class PathStates:
    """Poses along a path of the drivers as state vectors.

    Attributes:
        loops: of the mechanism.
        prescribed: values of the prescribed coordinates along the path.
    """

    def __init__(self, loops: TreeLoops, prescribed: PrescribedValues):
        self.loops, self.prescribed = loops, prescribed

    def unflat(self, rows: Array, s: Array, driven: Array | None = None) -> Coordinates:
        """Return coordinates from approximate states at parameters (n,)."""
        return self.loops.unflat(rows, self.prescribed(s) if driven is None else driven)

    def closed(
        self, solver: LoopSolver, s: Array, rows: Array, tolerance: float = 0.0
    ) -> tuple[Array, Linearised, float] | None:
        """Return closed states from approximate ones, the loops there, and the displacement; None on failure.

        To rounding, or to a residual below the tolerance.
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
            change = np.einsum(
                "rkn,nk->rn", linearised.jacobian.take(linearised.unknown, 1), result.unverified
            )
            linearised = replace(linearised, residual=linearised.residual + change)
        residual = np.abs(linearised.residual).max(initial=0.0)
        displacement = float(result.displacement.max())
        if not (residual <= max(CLOSED, tolerance) and displacement < CONTROL.max_correction):
            return None
        return self.loops.flat(result.q), linearised, displacement
