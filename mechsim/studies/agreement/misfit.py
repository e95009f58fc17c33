"""The difference between candidate data and the exact motion, relative to its tolerance."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mechsim.analytic.designs import DesignFamily
from mechsim.model.expressions import unit_powers
from mechsim.model.motion import Motion
from mechsim.model.quantity import Quantity
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array, rms
from mechsim.numerics.rounding import EPS
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import (
    EvaluationPoints,
    Rows,
    Values,
    derivatives_by_dimension,
)
from mechsim.studies.agreement.noise import Noise, noise_of
from mechsim.verdict.checks import Check, check_of
from mechsim.verdict.quantities import force_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class FormulaTolerances:
    """Tolerances relative to the scale of a quantity, each with a power of the loops' conditioning.

    For poorly conditioned loops a tolerance widens by that power.

    Attributes:
        positions: of points and joint coordinates.
        velocities: of both.
        accelerations: of both.
        forces: of torques, reactions and energies.
        reason: template with {part}, {scale} and {unit} of the tolerance.
    """

    positions: tuple[float, int]
    velocities: tuple[float, int]
    accelerations: tuple[float, int]
    forces: tuple[float, int]
    reason: str

    def tolerance(self, quantity: Quantity) -> tuple[float, int]:
        """Return the tolerance and its power for a quantity."""
        by_order = (self.positions, self.velocities, self.accelerations)
        return self.forces if quantity.loaded else by_order[quantity.order]


# for any function or table: between the error of a solver inside a function, the square of the 1.5e-8 at
# which scipy's fsolve stops, and the effect of a link that is 0.1 % too long, 1e-3
USER_TOLERANCES = FormulaTolerances(
    positions=(1e-8, 1),
    velocities=(1e-6, 3),
    accelerations=(1e-5, 5),
    forces=(1e-6, 5),
    reason="{part:.0e} of the motion's {scale:.3g} {unit} (a link 0.1 % too long would change 1e-3)",
)
# for the formula of a model's file: rounding times the condition of the loops. Positions of the 24
# gallery mechanisms differ by 10 eps at most; the powers are those of solved poses (`verdict.quantities`)
EXACT_TOLERANCES = FormulaTolerances(
    positions=(1024 * EPS, 1),
    velocities=(8192 * EPS, 3),
    accelerations=(65536 * EPS, 5),
    forces=(1e-10, 5),
    reason="{part:.0e} of the motion's {scale:.3g} {unit} (rounding; formulas have 2e-15)",
)
REQUESTED = "requested"


@dataclass(frozen=True)
class Scales:
    """Scales by which errors of quantities are divided.

    Attributes:
        length: largest coordinate of any point, in [m].
        stroke: half the largest extent of a path, in [m].
        rate: speed of the fastest driver, in [rad/s].
        force: in [N].
        torque: in [N m].
    """

    length: float
    stroke: float
    rate: float
    force: float = 1.0
    torque: float = 1.0

    def scale(self, quantity: Quantity) -> float:
        """Return the scale of a quantity in its unit."""
        if quantity.kind == "torque":
            return self.force if quantity.unit == "N" else self.torque
        mass, length, time, _ = unit_powers(quantity.unit)
        # the force moves a mass by `length` while the driver moves by 1 rad
        weight = self.force / (self.length * self.rate**2)
        return weight**mass * self.length**length * self.rate**-time


def scales_of(evaluation: EvaluationPoints, candidates: Sequence[Candidate]) -> Scales:
    """Return the scales at evaluation points; force scales only if forces are compared."""
    motion = evaluation.motion
    length, stroke = reach_of(motion), stroke_of(motion)
    rate = float(np.abs(evaluation.speed).max())
    if not any(candidate.quantity.loaded for candidate in candidates):
        return Scales(length, stroke, rate)
    scales = force_scales(evaluation.forces)
    return Scales(length, stroke, rate, scales["force"] or 1.0, scales["torque"] or 1.0)


def candidate_errors(quantity: Quantity, values: Array, exact: Array) -> Array:
    """Return the differences of values (n, k); those of angles lie within half a revolution."""
    difference = values - exact
    return wrapped(difference) if quantity.angle else difference


def formula_tolerance(
    candidate: Candidate, scales: Scales, requested: float | None, *, exact: bool = False
) -> Tolerance:
    """Return the tolerance of a candidate.

    Args:
        candidate: the candidate values.
        scales: at the evaluation points.
        requested: tolerance of positions in [m], other quantities in proportion; None takes the default.
        exact: whether the candidate is a formula that is exact except for rounding.
    """
    quantity, scale = candidate.quantity, scales.scale(candidate.quantity)
    usual = EXACT_TOLERANCES if exact and requested is None else USER_TOLERANCES
    fraction, power = usual.tolerance(quantity)
    if requested is not None:
        more = fraction / USER_TOLERANCES.positions[0]
        return Tolerance(requested / scales.length * scale * more, quantity.unit, REQUESTED)
    return Tolerance(
        fraction * scale,
        quantity.unit,
        usual.reason.format(part=fraction, scale=scale, unit=quantity.unit),
        power,
    )


def weights(candidate: Candidate, evaluation: EvaluationPoints, tolerance: Tolerance) -> Array:
    """Return the divisors of the errors of a candidate at each instant, (n, 1) or (n, k).

    The divisor is the tolerance, or the standard deviation of the measurement if that is larger.
    """
    if candidate.uncertainty is None:
        return tolerance.widened(evaluation.conditioning, len(evaluation))[:, None]
    return np.maximum(candidate.uncertainty, tolerance.value)


def measured_count(candidates: Sequence[Candidate]) -> int:
    """Return how many quantities have standard deviations."""
    return sum(candidate.uncertainty is not None for candidate in candidates)


def noise_in(
    candidate: Candidate, error: Array, phase: Array, tolerance: Tolerance, quantities: int
) -> Noise | None:
    """Return the noise tests of a candidate's errors (n, k); None without standard deviations.

    Args:
        candidate: the candidate values.
        error: errors of all its components.
        phase: over which systematic errors are smooth, (n,).
        tolerance: allowed systematic error.
        quantities: number of quantities tested together.
    """
    if candidate.uncertainty is None:
        return None
    columns = candidate.measured_columns
    return noise_of(
        error[:, columns],
        candidate.uncertainty[:, columns],
        phase,
        allowed=tolerance.value,
        quantities=quantities,
    )


def candidate_check(
    candidate: Candidate,
    exact: Array,
    evaluation: EvaluationPoints,
    tolerance: Tolerance,
    noise: Noise | None,
) -> Check:
    """Return the check of one candidate against exact values, (n, k).

    A measured candidate passes if its noise tests and its components without standard deviations pass.
    """
    error = candidate_errors(candidate.quantity, candidate.values, exact)
    kind, subject = _compared(candidate.quantity)
    if noise is None or candidate.uncertainty is None:
        length = np.sqrt((error**2).sum(1))
        return check_of(kind, subject, length, evaluation.instants, tolerance, evaluation.conditioning)
    bare = error[:, ~candidate.measured_columns]
    if bare.size:
        length = np.sqrt((bare**2).sum(1))
        hard = check_of(kind, subject, length, evaluation.instants, tolerance, evaluation.conditioning)
        if hard.fraction_of_tolerance is None or hard.fraction_of_tolerance > noise.decisive.used:
            return hard
    return Check(
        kind=kind,
        subject=subject,
        unit=candidate.quantity.unit,
        worst=noise.decisive.worst * noise.deviation,
        instant=float(evaluation.instants.value[noise.row]),
        at_unit=evaluation.instants.unit,
        rms=float(np.sqrt(np.mean(error**2))),
        tolerance=noise.decisive.limit * noise.deviation,
        reason=noise.reason,
    )


def _compared(quantity: Quantity) -> tuple[str, str]:
    """Return the name of the compared quantity and its subject, as in the table of quantities."""
    if quantity.kind in ("position", "velocity", "acceleration"):
        axes = f", {quantity.axes}" if len(quantity.axes) < 3 else ""
        return quantity.kind, quantity.subject + axes
    if quantity.kind == "torque":
        return f"{'force' if quantity.unit == 'N' else 'torque'} of drive {quantity.subject}", ""
    if quantity.kind in ("force", "moment"):
        return quantity.kind, quantity.subject
    if quantity.kind == "joint":
        return "angle" if quantity.angle else "displacement", quantity.subject
    if quantity.function is not None or quantity.kind == "effort":
        return quantity.name, ""
    return f"{quantity.kind} {quantity.subject}", ""


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
        """Divisors of the errors at each instant, (n, 1) or (n, k): tolerances or standard deviations."""
        pairs = zip(self.candidates, self.allowed, strict=True)
        return tuple(weights(candidate, self.evaluation, tolerance) for candidate, tolerance in pairs)

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

    @property
    def noisy(self) -> bool:
        """Whether something was measured with a standard deviation."""
        return measured_count(self.candidates) > 0

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
        """Return the largest error relative to its tolerance; of vectors their length.

        For measurements it is the largest ratio of a noise test to its limit.
        """
        kept = slice(None) if rows is None else rows
        largest = [0.0]
        for candidate, values, weight, tolerance in zip(
            self.candidates, predicted, self.bounds, self.allowed, strict=True
        ):
            error = candidate_errors(candidate.quantity, candidate.values, values)[kept]
            scaled = np.abs(error / weight[kept])
            if candidate.uncertainty is None:
                largest.append(float(np.sqrt((scaled**2).sum(1)).max(initial=0.0)))
            elif len(error):
                noise = noise_in(
                    replace(candidate, uncertainty=candidate.uncertainty[kept]),
                    error,
                    self.evaluation.phase[kept],
                    tolerance,
                    measured_count(self.candidates),
                )
                bare = scaled[:, ~candidate.measured_columns]
                largest.append(0.0 if noise is None else noise.decisive.used)
                largest.append(float(bare.max(initial=0.0)))
        return max(largest)

    def explained(self, remaining: float, before: float, worst: float) -> float:
        """Return the explained fraction of a difference, 0 to 1; remaining noise does not count.

        Args:
            remaining: root mean square of the errors that remain, relative to their scales.
            before: that of the difference.
            worst: the largest error that remains, as of `worst`.
        """
        if self.noisy and worst <= 1.0:
            return 1.0
        beyond = [np.sqrt(max(0.0, square**2 - self._noise)) for square in (remaining, before)]
        if beyond[1] > 0.0:
            remaining, before = beyond
        return max(0.0, 1.0 - remaining / before)

    @cached_property
    def _noise(self) -> float:
        """The mean square of noise alone, relative to the scales."""
        variances = [
            np.zeros(1) if candidate.uncertainty is None else candidate.uncertainty / weight
            for candidate, weight in zip(self.candidates, self.bounds, strict=True)
        ]
        sizes = [candidate.values.size for candidate in self.candidates]
        return float(
            sum(n * np.mean(ratio**2) for n, ratio in zip(sizes, variances, strict=True)) / sum(sizes)
        )

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
