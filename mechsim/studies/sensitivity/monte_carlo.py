"""Monte Carlo over tolerances: many mechanisms at random, some of them solved to say how well that holds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import MechsimError
from mechsim.maths.arrays import Array
from mechsim.studies.sensitivity.expansion import Solved, Watch, first_order, second_order
from mechsim.studies.sensitivity.tolerances import Tolerances

# parts of the samples that lie below and above the band
TAILS = (0.025, 0.975)
# samples solved to see how well an expansion holds, and where none does: so many, each solved
CHECKED, EACH = 50, 2000
# largest miss of an expansion, in standard deviations, with which it is taken; a deviation counts for no less
# than so much of the largest of its quantity
MISS, LEAST = 0.02, 1e-2
# quantities taken in one go
BLOCK = 64


@dataclass(frozen=True, slots=True)
class Sampled:
    """What came of many mechanisms at random within tolerances.

    Attributes:
        samples: how many.
        solved: how many of them were solved.
        failed: how many of these could not be put together.
        order: to which all are taken, 1 or 2; 0 where every one was solved.
        miss: largest difference between that and those solved, in standard deviations.
        seed: of the random numbers.
        mean: by how much the mean is off, (k,), in SI.
        deviation: standard deviation, (k,).
        low: above which all but 2.5 % lie, as off, (k,).
        high: below which all but 2.5 % lie, (k,).
        least: lowest of all, (k,).
        most: highest, (k,).
    """

    samples: int
    solved: int
    failed: int
    order: int
    miss: float
    seed: int
    mean: Array
    deviation: Array
    low: Array
    high: Array
    least: Array
    most: Array


def sampled(
    solved: Solved,
    slope: Array,
    plays: Sequence[Array],
    tolerances: Tolerances,
    count: int,
    seed: int,
    watch: Watch = lambda: None,
) -> Sampled:
    """Return what comes of many mechanisms at random within tolerances.

    They are taken to first order, if some that are solved differ from that by less than a fiftieth of the
    standard deviation, else to second order; where that does not hold either, fewer are taken and each is
    solved. Clearances are taken to first order.

    Args:
        solved: what solves one.
        slope: exact derivatives by parts of the tolerances, (p, k).
        plays: of each loose pin, what it puts off at its bound in 2 or 3 directions, (directions, k).
        tolerances: of dimensions.
        count: how many.
        seed: of the random numbers.
        watch: called after each that is solved.

    Raises:
        InputError: where tolerances leave no assembly.
    """
    random = np.random.default_rng(seed)
    parts = _parts(random, count, len(slope), tolerances)
    taken = parts[: CHECKED if len(slope) else 0]
    exact, failed = _each(solved, taken, watch)
    spread = _spread(slope * tolerances.spread, len(solved.columns))
    for made in (first_order, lambda slope: second_order(solved, slope, watch)):
        expanded = made(slope)
        off = expanded.features(taken[~failed]) @ expanded.weights - exact
        miss = float((np.abs(off) / spread).max(initial=0.0))
        if miss <= MISS and not failed.any():
            about = _About(len(taken), 0, expanded.order, miss, seed)
            return _told(expanded.features(parts), expanded.weights, plays, random, about)
    exact, failed = _each(solved, parts[:EACH], watch)
    return _told(exact, None, plays, random, _About(len(failed), int(failed.sum()), 0, 0.0, seed))


def _spread(slope: Array, columns: int) -> Array:
    """Return the standard deviations by which misses are judged, (k,); inf where nothing is off at all."""
    spread = np.sqrt((slope**2).sum(0)).reshape(columns, -1)
    least = np.maximum(spread, LEAST * spread.max(1, keepdims=True, initial=0.0)).ravel()
    return np.where(least > 0.0, least, np.inf)


@dataclass(frozen=True, slots=True)
class _About:
    """How samples were taken."""

    solved: int
    failed: int
    order: int
    miss: float
    seed: int


def _parts(random: np.random.Generator, count: int, dimensions: int, tolerances: Tolerances) -> Array:
    """Return deviations in parts of their bounds, (count, dimensions)."""
    shape = (count, dimensions)
    if tolerances.distribution == "uniform":
        return random.uniform(-1.0, 1.0, shape)
    return tolerances.spread * random.standard_normal(shape)


def _each(solved: Solved, parts: Array, watch: Watch) -> tuple[Array, NDArray[np.bool_]]:
    """Return by how much quantities are off, of those that can be put together, and which cannot."""
    found: list[Array] = []
    failed = np.zeros(len(parts), dtype=np.bool_)
    for i, one in enumerate(parts):
        try:
            found.append(solved.off(one))
        except MechsimError:
            failed[i] = True
        watch()
    return np.array(found).reshape(-1, len(solved.values)), failed


def _told(
    features: Array,
    weights: Array | None,
    plays: Sequence[Array],
    random: np.random.Generator,
    about: _About,
) -> Sampled:
    """Return the statistics of samples: features times weights, or as they are."""
    width = features.shape[1] if weights is None else weights.shape[1]
    pins = [_places(len(one), len(features), random) for one in plays]
    parts: list[Array] = []
    for first in range(0, width, BLOCK):
        columns = slice(first, first + BLOCK)
        off = features[:, columns] if weights is None else features @ weights[:, columns]
        for places, slope in zip(pins, plays, strict=True):
            off = off + places @ slope[:, columns]
        low, high = np.quantile(off, TAILS, axis=0)
        parts.append(np.array([off.mean(0), off.std(0), low, high, off.min(0), off.max(0)]))
    samples = len(features) + about.failed
    return Sampled(
        samples, about.solved, about.failed, about.order, about.miss, about.seed, *np.concatenate(parts, 1)
    )


def _places(directions: int, count: int, random: np.random.Generator) -> Array:
    """Return places of a pin, evenly over a disc or a ball of radius 1, (count, directions)."""
    away = random.standard_normal((count, directions))
    away /= np.sqrt((away**2).sum(1, keepdims=True))
    return away * random.random((count, 1)) ** (1.0 / directions)
