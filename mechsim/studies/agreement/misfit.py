"""Differences of candidate data from the exact motion, and hypotheses about them, fitted by least squares."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

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
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, Values

Rows = NDArray[np.bool_]


@dataclass(frozen=True)
class Hypothesis:
    """One possible mistake, with sizes that are fitted to the difference.

    Attributes:
        kind: one word, the `kind` of the `Finding`.
        what: the parameter, joint, point or driver.
        predict: sizes -> values that the candidate data would have.
        text: message without the explained fraction, or a function of the sizes that returns it.
        value: number that represents the change, or a function of the sizes that returns it.
        steps: finite-difference steps of the sizes; empty if there is nothing to fit.
        starts: initial values of the fit, each for all sizes.
        derivative: of the predicted values by the single size at zero; None takes finite differences.
        rows: instants that are compared; None for all.
        rank: added to the number of sizes; of causes that explain a difference equally well, those with the
            smallest sum are reported.
    """

    kind: str
    what: str
    predict: Callable[..., Values]
    text: str | Callable[..., str]
    value: float | Callable[..., float] = float
    steps: tuple[float, ...] = ()
    starts: tuple[float, ...] = (0.0,)
    derivative: Callable[[], Values] | None = None
    rows: Rows | None = None
    rank: float = 0.0

    @property
    def tier(self) -> float:
        """Rank among equal explanations."""
        return len(self.steps) + self.rank


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
    _by_dimension: dict[bool, Mapping[str, Motion]] = field(
        default_factory=dict[bool, Mapping[str, Motion]], init=False, compare=False, repr=False
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
        return self.scaled(self._differences(predicted), rows)

    def _differences(self, predicted: Values) -> Values:
        pairs = zip(self.candidates, predicted, strict=True)
        return [candidate_errors(own.quantity, own.values, values) for own, values in pairs]

    def _relative(self, values: Values, rows: Rows | None) -> Values:
        compared = slice(None) if rows is None else rows
        return [(own / scale)[compared] for own, scale in zip(values, self.bounds, strict=True)]

    def scaled(self, values: Values, rows: Rows | None = None) -> Array:
        """Return values in the order of the candidates, (n, k) each, relative to their scales as one row."""
        return np.concatenate([own.ravel() for own in self._relative(values, rows)])

    def worst(self, predicted: Values, rows: Rows | None = None) -> float:
        """Return the largest error relative to its tolerance; of vectors their length."""
        relative = self._relative(self._differences(predicted), rows)
        return max((float(np.sqrt((own**2).sum(1)).max(initial=0.0)) for own in relative), default=0.0)

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
        if placed not in self._by_dimension:
            # if the derivatives fail, they are not tried again
            self._by_dimension[placed] = {}
            change: dict[str, Array] = {}
            for dimension in designs.dimensions:
                # not of dimensions that cannot change on their own
                with suppress(MechsimError, ValueError):
                    change |= changes(designs, [dimension])
            change = {dimension: derivative for dimension, derivative in change.items() if derivative.any()}
            points = self.evaluation
            path = points.angle, points.speed, points.acceleration
            self._by_dimension[placed] = motion_derivatives(points.solver, change, *path, torn=True).by
        return self._by_dimension[placed][name]


# largest number of steps, and of halvings of one step
MAX_STEPS, MAX_HALVINGS = 14, 8
# relative decrease of the errors that justifies another step; errors that count as zero, relative to the
# tolerances and to the difference
MIN_DECREASE, ZERO_ERROR, RELATIVE_ROUNDING = 1e-3, 1e-4, 1e-9
# a hypothesis that leaves more than this fraction of the difference after so many steps is given up
TRIAL_STEPS, MAX_TRIAL_REMAINING = 4, 0.7
# ratio of errors after and before a step above which the Jacobian is recomputed
STALE_JACOBIAN = 0.7


@dataclass(frozen=True)
class Fitted:
    """A hypothesis with its fitted sizes.

    Attributes:
        misfit: the difference.
        hypothesis: the hypothesis.
        sizes: fitted, (p,).
        predicted: values that it predicts, in the order of the candidates.
        errors: remaining errors, relative to their tolerances, (m,).
    """

    misfit: Misfit
    hypothesis: Hypothesis
    sizes: Array
    predicted: Values
    errors: Array

    @cached_property
    def remaining(self) -> float:
        """Root mean square of the remaining errors."""
        return rms(self.errors)

    @cached_property
    def before(self) -> float:
        """Root mean square of the errors without the hypothesis."""
        return rms(self.misfit.errors(self.misfit.exact, self.hypothesis.rows))

    @cached_property
    def worst(self) -> float:
        """The largest remaining error; of vectors their length."""
        return self.misfit.worst(self.predicted, self.hypothesis.rows)

    @property
    def explains(self) -> float:
        """Explained fraction of the difference, 0 to 1."""
        return max(0.0, 1.0 - self.remaining / self.before)

    def moved(self, step: Array) -> "Fitted | None":
        """Return the hypothesis with sizes moved by a step (p,); None if it cannot be assembled there."""
        return _with_sizes(self.misfit, self.hypothesis, self.sizes + step)


def fitted(misfit: Misfit, hypothesis: Hypothesis) -> Fitted | None:
    """Return a hypothesis with the best-fitting sizes; None if it cannot be assembled at any start."""
    count = len(hypothesis.steps)
    starts = [_with_sizes(misfit, hypothesis, np.full(count, start)) for start in hypothesis.starts]
    nearest = min(filter(None, starts), key=lambda trial: trial.remaining, default=None)
    if nearest is None or not nearest.before > 0.0:
        return None
    return _minimised(nearest) if count else nearest


def _with_sizes(misfit: Misfit, hypothesis: Hypothesis, sizes: Array) -> Fitted | None:
    """Return a hypothesis with sizes; None if the mechanism cannot be assembled there."""
    try:
        with np.errstate(all="ignore"):
            predicted = hypothesis.predict(*sizes.tolist())
            errors = misfit.errors(predicted, hypothesis.rows)
    except (MechsimError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return Fitted(misfit, hypothesis, sizes, predicted, errors) if np.isfinite(errors).all() else None


def _minimised(current: Fitted) -> Fitted:
    """Return the trial with the smallest errors, from a trial to start with."""
    before = current.before
    jacobian, is_exact = _jacobian(current), True
    for number in range(MAX_STEPS):
        if number == TRIAL_STEPS and current.remaining > MAX_TRIAL_REMAINING * before:
            break
        if jacobian is None or current.remaining <= max(ZERO_ERROR, RELATIVE_ROUNDING * before):
            break
        step: Array = -np.linalg.lstsq(jacobian, current.errors, rcond=1e-10)[0].astype(np.float64)
        moved = _shortened(current, step)
        if moved is None:
            if is_exact:
                break
            jacobian, is_exact = _jacobian(current), True
            continue
        displacement, change = moved.sizes - current.sizes, moved.errors - current.errors
        ratio = moved.remaining / current.remaining
        current = moved
        if ratio > STALE_JACOBIAN and not is_exact:
            jacobian, is_exact = _jacobian(current), True
        elif ratio > 1.0 - MIN_DECREASE:
            break
        else:
            # Broyden's update: the derivative along the step just taken
            square = max(float(displacement @ displacement), 1e-300)
            jacobian = jacobian + np.outer(change - jacobian @ displacement, displacement) / square
            is_exact = False
    return current


def _shortened(current: Fitted, step: Array) -> Fitted | None:
    """Return the trial of a shortened step with smaller errors; None if there is none."""
    for halving in range(MAX_HALVINGS):
        moved = current.moved(step * 0.5**halving)
        if moved is not None and moved.remaining < current.remaining:
            return moved
        if moved is not None and rms(step) < 1e-12:
            return None
    return None


def _jacobian(current: Fitted) -> Array | None:
    """Return the derivatives of the errors by the sizes, (m, p)."""
    hypothesis = current.hypothesis
    if hypothesis.derivative is not None and not current.sizes.any():
        # forces, and dimensions that open the loops, have no exact derivatives
        with suppress(MechsimError, KeyError):
            return -current.misfit.scaled(hypothesis.derivative())[:, None]
    columns: list[Array] = []
    for row in np.diag(hypothesis.steps):
        ahead = current.moved(row)
        trial = current.moved(-row) if ahead is None else ahead
        if trial is None:
            return None
        columns.append((trial.errors - current.errors) / (-row if ahead is None else row).sum())
    return np.stack(columns, 1)


def linearly_explains(misfit: Misfit, jacobian: Array) -> float:
    """Return the fraction of a misfit that derivatives (m, p) explain to first order."""
    solution = np.linalg.lstsq(jacobian, misfit.before, rcond=1e-10)[0]
    return 1.0 - rms(misfit.before - jacobian @ solution) / misfit.magnitude
