"""A difference that is to be explained: claims, what is exact, and what may lie between them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.comparison import errors, measured, noise_in, weights
from mechsim.verdict.tolerances import Tolerance

Values = Sequence[Array]
Rows = NDArray[np.bool_]


@dataclass(frozen=True)
class Miss:
    """Claims that differ from what is exact.

    Attributes:
        comparand: what moves, at which instants.
        claims: what is said.
        exact: what is true, in the order of the claims, (n, k) each.
        allowed: how far each may be off.
        family: the mechanism among others with other dimensions.
        function: whether the claims come from a function, which is asked at drivers alone.
    """

    comparand: Comparand
    claims: tuple[Claim, ...]
    exact: tuple[Array, ...]
    allowed: tuple[Tolerance, ...]
    family: DesignFamily
    function: bool = True

    @cached_property
    def bounds(self) -> tuple[Array, ...]:
        """By what errors are divided at each instant, (n, 1) or (n, k) each: bounds, standard deviations."""
        pairs = zip(self.claims, self.allowed, strict=True)
        return tuple(weights(claim, self.comparand, tolerance) for claim, tolerance in pairs)

    @property
    def noisy(self) -> bool:
        """Whether something was measured with a standard deviation."""
        return measured(self.claims) > 0

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
        """Return the largest error in parts of its bound, of vectors by their length.

        Of what was measured it is the noise test that is nearest to its limit, or farthest beyond.
        """
        kept = slice(None) if rows is None else rows
        found = [0.0]
        for claim, values, bound, tolerance in zip(
            self.claims, predicted, self.bounds, self.allowed, strict=True
        ):
            error = errors(claim.named, claim.values, values)[kept]
            part = np.abs(error / bound[kept])
            if claim.uncertainty is None:
                found.append(float(np.sqrt((part**2).sum(1)).max(initial=0.0)))
            elif len(error):
                noise = noise_in(
                    replace(claim, uncertainty=claim.uncertainty[kept]),
                    error,
                    self.comparand.phase[kept],
                    tolerance,
                    measured(self.claims),
                )
                bare = part[:, ~(claim.uncertainty > 0.0).all(0)]
                found.append(0.0 if noise is None else noise.decisive.used)
                found.append(float(bare.max(initial=0.0)))
        return max(found)

    def explained(self, left: float, before: float, worst: float) -> float:
        """Return the part of a difference that is gone, 0 to 1; what noise leaves does not count.

        Args:
            left: root mean square of the errors that are left, in parts of their bounds.
            before: that of the difference.
            worst: the largest error that is left, as `worst` has it.
        """
        if self.noisy and worst <= 1.0:
            return 1.0
        beyond = [np.sqrt(max(0.0, one**2 - self._noise)) for one in (left, before)]
        if beyond[1] > 0.0:
            left, before = beyond
        return max(0.0, 1.0 - left / before)

    @cached_property
    def _noise(self) -> float:
        """The mean square that noise alone has, in parts of bounds."""
        known = [
            np.zeros(1) if claim.uncertainty is None else claim.uncertainty / bound
            for claim, bound in zip(self.claims, self.bounds, strict=True)
        ]
        sizes = [claim.values.size for claim in self.claims]
        return float(sum(n * np.mean(one**2) for n, one in zip(sizes, known, strict=True)) / sum(sizes))

    def predicted(self, comparand: Comparand) -> Values:
        """Return what would be true of something else that moves.

        Raises:
            AssemblyError: where its loops do not close.
        """
        return comparand.all([claim.named for claim in self.claims])


def rms(values: Array) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
