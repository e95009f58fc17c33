"""A difference that is to be explained: claims, what is exact, and what may lie between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.maths.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.comparison import errors

Values = Sequence[Array]
Rows = NDArray[np.bool_]


@dataclass(frozen=True)
class Miss:
    """Claims that differ from what is exact.

    Attributes:
        comparand: what moves, at which instants.
        claims: what is said.
        exact: what is true, in the order of the claims, (n, k) each.
        bounds: how far each may be off at each instant, (n, 1) or (n, k) each.
        family: the mechanism among others with other dimensions.
        function: whether the claims come from a function, which is asked at drivers alone.
    """

    comparand: Comparand
    claims: tuple[Claim, ...]
    exact: tuple[Array, ...]
    bounds: tuple[Array, ...]
    family: DesignFamily
    function: bool = True

    @cached_property
    def before(self) -> Array:
        """The errors as they are, in parts of their bounds, as one row."""
        return self.errors(self.exact)

    @cached_property
    def size(self) -> float:
        """Their root mean square."""
        return rms(self.before)

    def errors(self, predicted: Values, rows: Rows | None = None) -> Array:
        """Return how far the claims are from something else than the exact motion, in parts of their bounds.

        Args:
            predicted: values in the order of the claims, (n, k) each.
            rows: instants that count; None takes all.
        """
        found = [
            (errors(claim.named, claim.values, values) / bound)[slice(None) if rows is None else rows].ravel()
            for claim, values, bound in zip(self.claims, predicted, self.bounds, strict=True)
        ]
        return np.concatenate(found)

    def worst(self, predicted: Values, rows: Rows | None = None) -> float:
        """Return the largest error in parts of its bound, of vectors by their length."""
        found = [0.0]
        for claim, values, bound in zip(self.claims, predicted, self.bounds, strict=True):
            part = np.abs(errors(claim.named, claim.values, values) / bound)
            part = part if rows is None else part[rows]
            size = np.sqrt((part**2).sum(1)) if bound.shape[1] == 1 else part
            found.append(float(size.max(initial=0.0)))
        return max(found)

    def predicted(self, comparand: Comparand) -> Values:
        """Return what would be true of something else that moves.

        Raises:
            AssemblyError: where its loops do not close.
        """
        return comparand.all([claim.named for claim in self.claims])


def rms(values: Array) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
