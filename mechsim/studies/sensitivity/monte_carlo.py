"""Monte Carlo over tolerances, by exact derivatives that some solved mechanisms verify."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

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
        deviations = np.concatenate([values[column] for column in self.columns]) - self.values
        deviations[self.angular] = wrapped(deviations[self.angular])
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


# quantiles of the samples at the ends of the reported interval
QUANTILES = (0.025, 0.975)
# number of solved samples that verify the derivatives, and number solved if they are not accurate enough
MAX_VERIFIED, MAX_SOLVED = 50, 2000
# largest accepted error of the derivatives, in standard deviations; smallest standard deviation for this,
# relative to the largest of the same quantity
MAX_EXPANSION_ERROR, MIN_RELATIVE_DEVIATION = 0.02, 1e-2


@dataclass(frozen=True, slots=True)
class Sampling:
    """How the random mechanisms were evaluated.

    Attributes:
        solved: number of solved mechanisms.
        failed: number of these that cannot be assembled.
        order: 1 if the exact derivatives were used; 0 if each mechanism was solved.
        expansion_error: largest error of the derivatives over the solved mechanisms, in standard deviations.
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

    The exact derivatives are used if their error, for some solved mechanisms, is below a fiftieth of the
    standard deviation. Otherwise fewer mechanisms are drawn and each is solved. Clearances count to first
    order.

    Args:
        solved: solves the mechanisms.
        derivative: exact derivatives by the fractions of the tolerances, (p, k).
        plays: effect of each clearance at its bound in 2 or 3 directions, (directions, k).
        tolerances: of dimensions.
        count: number of samples.
        seed: of the random numbers.
        advance: called after each solved mechanism.

    Raises:
        InputError: if none of the mechanisms can be assembled.
    """
    random, width = np.random.default_rng(seed), derivative.shape[1]
    fractions = _fractions(random, count, len(derivative), tolerances)
    checked = fractions[: MAX_VERIFIED if len(derivative) else 0]
    exact, failed = _each(solved, checked, advance)
    spread = _spread(derivative * tolerances.spread, len(solved.columns))
    error = float((np.abs(checked[~failed] @ derivative - exact) / spread).max(initial=0.0))
    if error <= MAX_EXPANSION_ERROR and not failed.any():
        sampling = Sampling(len(checked), 0, 1, error, seed)
        return _statistics(_blocks(fractions, derivative), count, width, plays, random, sampling)
    exact, failed = _each(solved, fractions[:MAX_SOLVED], advance)
    if failed.all():
        raise InputError(
            f"none of {len(failed)} random mechanisms within the tolerances can be assembled; give smaller "
            "tolerances"
        )
    sampling = Sampling(len(failed), int(failed.sum()), 0, 0.0, seed)
    return _statistics(iter([(ALL_COLUMNS, exact)]), len(exact), width, plays, random, sampling)


def _blocks(fractions: Array, derivative: Array) -> Iterator[Block]:
    """Yield columns of the quantities, and the deviations in them of mechanisms, to first order."""
    for first in range(0, derivative.shape[1], BATCH_COLUMNS):
        which = slice(first, first + BATCH_COLUMNS)
        yield which, fractions @ derivative[:, which]


def _spread(derivative: Array, columns: int) -> Array:
    """Return standard deviations that scale errors of the derivatives, (k,); infinite without deviation."""
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
