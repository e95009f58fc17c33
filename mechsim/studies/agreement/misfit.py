"""The difference between candidate data and the exact motion, relative to its tolerance."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mechsim.compare.tolerances import Tolerance
from mechsim.errors import MechsimError
from mechsim.kinematics.derivatives.dimensions import changes
from mechsim.kinematics.derivatives.motion import motion_derivatives
from mechsim.kinematics.designs import DesignFamily
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.quantity import Quantity
from mechsim.numerics.arrays import Array, rms
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.comparison import candidate_errors
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, Rows, Values


@dataclass(frozen=True)
class Misfit:
    """Candidates that differ from the exact motion.

    Attributes:
        evaluation: the mechanism and the instants.
        candidates: values to be compared.
        exact: true values, in the order of the candidates, (n, k) each.
        allowed: tolerance of each.
        designs: the parametric model of the mechanism.
        function: whether the candidates come from a function of the driver coordinates.
    """

    evaluation: EvaluationPoints
    candidates: tuple[Candidate, ...]
    exact: tuple[Array, ...]
    allowed: tuple[Tolerance, ...]
    designs: DesignFamily
    function: bool = True
    _by_dimension: dict[tuple[bool, str], Motion] = field(
        default_factory=dict[tuple[bool, str], Motion], init=False, compare=False, repr=False
    )

    @cached_property
    def bounds(self) -> tuple[Array, ...]:
        """The tolerance of each candidate at each instant, (n, 1): divisors of the errors."""
        conditioning, count = self.evaluation.conditioning, len(self.evaluation)
        return tuple(tolerance.widened(conditioning, count)[:, None] for tolerance in self.allowed)

    @property
    def quantities(self) -> list[Quantity]:
        """The quantity of each candidate."""
        return [candidate.quantity for candidate in self.candidates]

    @property
    def length(self) -> float:
        """The characteristic length of the mechanism, in [m]."""
        return self.evaluation.solver.mechanism.characteristic_length

    @property
    def needs_forces(self) -> bool:
        """Whether forces are compared."""
        return any(quantity.loaded for quantity in self.quantities)

    @cached_property
    def before(self) -> Array:
        """The errors before any explanation, relative to their scales, as one row."""
        return self.errors(self.exact)

    @cached_property
    def magnitude(self) -> float:
        """Their root mean square."""
        return rms(self.before)

    def errors(self, predicted: Values, rows: Rows | None = None) -> Array:
        """Return the differences of the candidates from predicted values, relative to their scales.

        Args:
            predicted: values in the order of the candidates, (n, k) each.
            rows: instants that are compared; None takes all.
        """
        pairs = zip(self.candidates, predicted, strict=True)
        differences = [candidate_errors(own.quantity, own.values, values) for own, values in pairs]
        return self.scaled(differences, rows)

    def scaled(self, values: Values, rows: Rows | None = None) -> Array:
        """Return values in the order of the candidates, (n, k) each, relative to their scales as one row."""
        kept = slice(None) if rows is None else rows
        pairs = zip(values, self.bounds, strict=True)
        return np.concatenate([(own / scale)[kept].ravel() for own, scale in pairs])

    def worst(self, predicted: Values, rows: Rows | None = None) -> float:
        """Return the largest error relative to its tolerance; of vectors their length."""
        kept = slice(None) if rows is None else rows
        largest = [0.0]
        for candidate, values, limit in zip(self.candidates, predicted, self.bounds, strict=True):
            error = candidate_errors(candidate.quantity, candidate.values, values)
            scaled = (error / limit)[kept]
            largest.append(float(np.sqrt((scaled**2).sum(1)).max(initial=0.0)))
        return max(largest)

    def predicted(self, evaluation: EvaluationPoints) -> Values:
        """Return the true values of other evaluation points.

        Raises:
            AssemblyError: where the loops do not close.
        """
        return evaluation.all(self.quantities)

    def by_dimension(self, designs: DesignFamily, name: str) -> Motion:
        """Return the derivatives of the motion by one dimension; those by all are computed at once.

        Raises:
            KeyError: for a dimension that opens the loops, or if no nearby design can be assembled.
        """
        placed = designs is not self.designs
        if (placed, "") not in self._by_dimension:
            self._by_dimension[placed, ""] = self.evaluation.motion
            for dimension, motion in derivatives_by_dimension(self.evaluation, designs).items():
                self._by_dimension[placed, dimension] = motion
        return self._by_dimension[placed, name]


def derivatives_by_dimension(evaluation: EvaluationPoints, designs: DesignFamily) -> dict[str, Motion]:
    """Return the derivatives of a motion by all dimensions that can change on their own."""
    change: dict[str, Array] = {}
    for name in designs.dimensions:
        try:
            change |= changes(designs, [name])
        except (MechsimError, ValueError):
            continue
    change = {name: derivative for name, derivative in change.items() if derivative.any()}
    derivatives = motion_derivatives(
        evaluation.solver, change, evaluation.angle, evaluation.speed, evaluation.acceleration, torn=True
    )
    return dict(derivatives.by)
