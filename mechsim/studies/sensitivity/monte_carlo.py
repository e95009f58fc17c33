"""Monte Carlo over tolerances, by expansions in the dimensions that some solved mechanisms verify."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.designs import Dimension
from mechsim.errors import InputError, MechsimError
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.studies.sensitivity.tolerances import Tolerances

Advance = Callable[[], None]
Columns = NDArray[np.intp] | slice
# columns of the quantities, and the deviations of many mechanisms in them
Block = tuple[Columns, Array]
ALL_COLUMNS = slice(None)
# number of columns evaluated together
BATCH_COLUMNS = 64


@dataclass(frozen=True)
class DesignSolver:
    """Solves a mechanism whose dimensions deviate within their tolerances.

    Attributes:
        moved: the mechanism and its driver motion.
        columns: names of the quantities.
        bounds: dimension -> tolerance in SI.
        values: nominal values of the quantities, one after the other, (k,).
        angular: whether each is an angle, compared modulo a revolution, (k,).
    """

    moved: MovedFamily
    columns: Sequence[str]
    bounds: Mapping[str, float]
    values: Array
    angular: NDArray[np.bool_]

    def deviations(self, fractions: Array) -> Array:
        """Return deviations of quantities, (k,), for deviations of dimensions relative to their bounds, (p,).

        Raises:
            AssemblyError: for loops that do not close.
        """
        values = self.moved.values(self.columns, self.dimensions(fractions))
        return self.differences(np.concatenate([values[column] for column in self.columns]))

    def differences(self, values: Array, which: Columns = ALL_COLUMNS) -> Array:
        """Return the differences of quantities, (..., k), from the nominal mechanism."""
        deviations = values - self.values[which]
        angular = self.angular[which]
        deviations[..., angular] = wrapped(deviations[..., angular])
        return deviations

    def dimensions(self, fractions: Array) -> dict[str, float]:
        """Return the changed dimensions, name -> value in SI."""
        dimensions: Mapping[str, Dimension] = self.moved.designs.dimensions
        deviations = zip(self.bounds, fractions.tolist(), strict=True)
        return {
            name: dimensions[name].value + fraction * self.bounds[name]
            for name, fraction in deviations
            if fraction
        }

    def text(self, fractions: Array) -> str:
        """Return the changed dimensions as text."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in self.dimensions(fractions).items())


@dataclass(frozen=True)
class Expansion:
    """Deviations to second order: derivative . d + second_derivative . d d, d relative to the tolerances.

    Attributes:
        derivative: exact, (p, k).
        pairs: indices of the two dimensions of each second derivative, (b, 2).
        second_derivative: second differences over the whole tolerances, (b, k); those of one dimension are
            halved. Empty for an expansion to first order.
    """

    derivative: Array
    pairs: NDArray[np.intp]
    second_derivative: Array

    def features(self, fractions: Array) -> Array:
        """Return the deviations (n, p) of dimensions and their products, (n, p + b)."""
        return np.concatenate([fractions, fractions[:, self.pairs[:, 0]] * fractions[:, self.pairs[:, 1]]], 1)

    def blocks(self, fractions: Array) -> Iterator[Block]:
        """Yield columns of the quantities, and the deviations in them of mechanisms with fractions (n, p)."""
        features, weights = self.features(fractions), self.weights
        for first in range(0, weights.shape[1], BATCH_COLUMNS):
            which = slice(first, first + BATCH_COLUMNS)
            yield which, features @ weights[:, which]

    @property
    def order(self) -> int:
        """Order of the expansion, 1 or 2."""
        return 2 if len(self.second_derivative) else 1

    @property
    def weights(self) -> Array:
        """Coefficients of the features, (p + b, k)."""
        return np.concatenate([self.derivative, self.second_derivative])


def first_order(derivative: Array) -> Expansion:
    """Return an expansion to first order from derivatives (p, k) by the fractions of the tolerances."""
    return Expansion(derivative, np.zeros((0, 2), np.intp), np.zeros((0, derivative.shape[1])))


def second_order(solved: DesignSolver, derivative: Array, advance: Advance = lambda: None) -> Expansion:
    """Return an expansion to second order.

    Args:
        solved: solves the mechanisms.
        derivative: exact derivatives by the fractions of the tolerances, (p, k).
        advance: called after each mechanism.

    Raises:
        InputError: for tolerances that allow no assembly; names the dimensions.
    """
    count = len(derivative)

    def deviations(*signed: tuple[int, float]) -> Array:
        fractions = np.zeros(count)
        for i, sign in signed:
            fractions[i] = sign
        try:
            return solved.deviations(fractions)
        except MechsimError as error:
            raise InputError(
                f"the tolerances allow no assembly: with {solved.text(fractions)}: {error}"
            ) from None
        finally:
            advance()

    own = [0.5 * (deviations((i, 1.0)) + deviations((i, -1.0))) for i in range(count)]
    two = [*combinations(range(count), 2)]
    # mean of both corners with equal signs, minus the effects of each dimension alone
    both = [
        0.5 * (deviations((i, 1.0), (j, 1.0)) + deviations((i, -1.0), (j, -1.0))) - own[i] - own[j]
        for i, j in two
    ]
    pairs = np.array([*((i, i) for i in range(count)), *two], dtype=np.intp).reshape(-1, 2)
    return Expansion(derivative, pairs, np.array([*own, *both]).reshape(len(pairs), derivative.shape[1]))


def solves(count: int) -> int:
    """Return the number of mechanisms that an expansion to second order solves."""
    return count * (count + 1)


# quantiles of the samples at the ends of the reported interval
QUANTILES = (0.025, 0.975)
# number of solved samples that verify an expansion, and number solved if no expansion is accurate enough
MAX_VERIFIED, MAX_SOLVED = 50, 2000
# largest accepted error of an expansion, in standard deviations; smallest standard deviation for this,
# relative to the largest of the same quantity
MAX_EXPANSION_ERROR, MIN_RELATIVE_DEVIATION = 0.02, 1e-2


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the random mechanisms were evaluated.

    Attributes:
        solved: number of solved mechanisms.
        failed: number of these that cannot be assembled.
        order: order of the expansion, 1 or 2; 0 if each mechanism was solved.
        expansion_error: largest error of the expansion over the solved mechanisms, in standard deviations.
        seed: of the random numbers.
    """

    solved: int
    failed: int
    order: int
    expansion_error: float
    seed: int


@dataclass(frozen=True, slots=True)
class Sampled:
    """Statistics of random mechanisms within tolerances.

    Attributes:
        sampling: how they were evaluated.
        samples: number of samples; smaller than requested if each had to be solved on its own.
        mean: mean deviation from the nominal mechanism, (k,), in SI.
        deviation: standard deviation, (k,).
        low: 2.5 % quantile of the deviation, (k,).
        high: 97.5 % quantile, (k,).
        least: smallest deviation, (k,).
        most: largest deviation, (k,).
    """

    sampling: Sampling
    samples: int
    mean: Array
    deviation: Array
    low: Array
    high: Array
    least: Array
    most: Array


def sample_tolerances(
    solved: DesignSolver,
    derivative: Array,
    plays: Sequence[Array],
    tolerances: Tolerances,
    count: int,
    seed: int,
    advance: Advance = lambda: None,
) -> Sampled:
    """Return statistics of random mechanisms within tolerances.

    An expansion to first or second order is used if its error, for some solved mechanisms, is below a
    fiftieth of the standard deviation. If neither is accurate enough, fewer mechanisms are drawn and each is
    solved. Clearances count to first order.

    Args:
        solved: solves the mechanisms.
        derivative: exact derivatives by the fractions of the tolerances, (p, k).
        plays: effect of each clearance at its bound in 2 or 3 directions, (directions, k).
        tolerances: of dimensions.
        count: number of samples.
        seed: of the random numbers.
        advance: called after each solved mechanism.

    Raises:
        InputError: for tolerances that allow no assembly.
    """
    random, width = np.random.default_rng(seed), derivative.shape[1]
    fractions = _fractions(random, count, len(derivative), tolerances)
    checked = fractions[: MAX_VERIFIED if len(derivative) else 0]
    exact, failed = _each(solved, checked, advance)
    spread = _spread(derivative * tolerances.spread, len(solved.columns))
    for expand in (first_order, lambda derivative: second_order(solved, derivative, advance)):
        expanded = expand(derivative)
        deviations = expanded.features(checked[~failed]) @ expanded.weights - exact
        expansion_error = float((np.abs(deviations) / spread).max(initial=0.0))
        if expansion_error <= MAX_EXPANSION_ERROR and not failed.any():
            sampling = Sampling(len(checked), 0, expanded.order, expansion_error, seed)
            return _statistics(expanded.blocks(fractions), count, width, plays, random, sampling)
    exact, failed = _each(solved, fractions[:MAX_SOLVED], advance)
    sampling = Sampling(len(failed), int(failed.sum()), 0, 0.0, seed)
    return _statistics(iter([(ALL_COLUMNS, exact)]), len(exact), width, plays, random, sampling)


def _spread(derivative: Array, columns: int) -> Array:
    """Return standard deviations that scale errors of an expansion, (k,); infinite without deviation."""
    spread = np.sqrt((derivative**2).sum(0)).reshape(columns, -1)
    least = np.maximum(spread, MIN_RELATIVE_DEVIATION * spread.max(1, keepdims=True, initial=0.0)).ravel()
    return np.where(least > 0.0, least, np.inf)


def _fractions(random: np.random.Generator, count: int, dimensions: int, tolerances: Tolerances) -> Array:
    """Return random deviations relative to their bounds, (count, dimensions)."""
    shape = (count, dimensions)
    if tolerances.distribution == "uniform":
        return random.uniform(-1.0, 1.0, shape)
    return tolerances.spread * random.standard_normal(shape)


def _each(solved: DesignSolver, fractions: Array, advance: Advance) -> tuple[Array, NDArray[np.bool_]]:
    """Return the deviations of the mechanisms that can be assembled, and which of all cannot."""
    errors: list[Array] = []
    failed = np.zeros(len(fractions), dtype=np.bool_)
    for i, fraction in enumerate(fractions):
        try:
            errors.append(solved.deviations(fraction))
        except MechsimError:
            failed[i] = True
        advance()
    return np.array(errors).reshape(-1, len(solved.values)), failed


def _statistics(
    blocks: Iterator[Block],
    count: int,
    width: int,
    plays: Sequence[Array],
    random: np.random.Generator,
    sampling: Sampling,
) -> Sampled:
    """Return the statistics of mechanisms whose quantities (width,) come in blocks."""
    pins = [_pin_positions(len(play), count, random) for play in plays]
    statistics = np.empty((6, width))
    for which, deviations in blocks:
        for positions, derivative in zip(pins, plays, strict=True):
            deviations = deviations + positions @ derivative[:, which]
        low, high = np.quantile(deviations, QUANTILES, axis=0)
        statistics[:, which] = (
            deviations.mean(0),
            deviations.std(0),
            low,
            high,
            deviations.min(0),
            deviations.max(0),
        )
    return Sampled(sampling, count + sampling.failed, *statistics)


def _pin_positions(directions: int, count: int, random: np.random.Generator) -> Array:
    """Return random positions of a pin, uniform in a disc or ball of radius 1, (count, directions)."""
    away = random.standard_normal((count, directions))
    away /= np.sqrt((away**2).sum(1, keepdims=True))
    return away * random.random((count, 1)) ** (1.0 / directions)
