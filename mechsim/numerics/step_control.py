"""Step-size control of continuation by segments of polynomials."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.numerics.arrays import TINY, Array


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
