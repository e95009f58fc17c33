"""Monte Carlo over tolerances, by expansions in the dimensions; some mechanisms are solved to check."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import Bools, allowed, can_be_many, closed_at, solved
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.analytic.derivatives.dimensions import Dimension
from mechsim.errors import InputError, MechsimError
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.studies.sensitivity.tolerances import Tolerances

Advance = Callable[[], None]
Columns = NDArray[np.intp] | slice
# which of the quantities, and by how much each of many mechanisms is off there
Block = tuple[Columns, Array]
EVERY = slice(None)
# quantities taken in one go
BATCH = 64


@dataclass(frozen=True)
class Solved:
    """What solves a mechanism with dimensions off by parts of their tolerances.

    Attributes:
        moved: the mechanism, and how it moves.
        columns: the quantities.
        bounds: dimension -> tolerance in SI.
        values: the quantities as the mechanism stands, (k,): one after the other.
        angular: whether each is an angle, on which whole turns do not count, (k,).
    """

    moved: MovedFamily
    columns: Sequence[str]
    bounds: Mapping[str, float]
    values: Array
    angular: NDArray[np.bool_]

    def off(self, fractions: Array) -> Array:
        """Return by how much quantities are off, (k,), with dimensions off by parts of their bounds, (p,).

        Raises:
            AssemblyError: where the loops do not close.
        """
        values = self.moved.values(self.columns, self.dimensions(fractions))
        return self.less(np.concatenate([values[column] for column in self.columns]))

    def less(self, values: Array, which: Columns = EVERY) -> Array:
        """Return by how much some of the quantities, (..., k), differ from the mechanism as it stands."""
        off = values - self.values[which]
        angular = self.angular[which]
        off[..., angular] = wrapped(off[..., angular])
        return off

    def dimensions(self, fractions: Array) -> dict[str, float]:
        """Return the dimensions that changed, in SI."""
        dimensions: Mapping[str, Dimension] = self.moved.designs.dimensions
        off = zip(self.bounds, fractions.tolist(), strict=True)
        return {
            name: dimensions[name].value + fraction * self.bounds[name] for name, fraction in off if fraction
        }

    def words(self, fractions: Array) -> str:
        """Return the dimensions that changed, in words."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in self.dimensions(fractions).items())


@dataclass(frozen=True)
class Expansion:
    """Quantities to first or second order: off = slope . d + products of d . bend, d in parts of tolerances.

    Attributes:
        derivative: exact, (p, k).
        pairs: indices of two dimensions for each column of bends, (b, 2).
        second_derivative: second differences over the whole of the tolerances, (b, k); those of one
            dimension are halved.
    """

    derivative: Array
    pairs: NDArray[np.intp]
    second_derivative: Array

    def features(self, fractions: Array) -> Array:
        """Return d and its products, (n, p + b), of parts (n, p)."""
        return np.concatenate([fractions, fractions[:, self.pairs[:, 0]] * fractions[:, self.pairs[:, 1]]], 1)

    def blocks(self, fractions: Array) -> Iterator[Block]:
        """Yield which of the quantities, and by how much mechanisms with parts (n, p) are off there."""
        features, weights = self.features(fractions), self.weights
        for first in range(0, weights.shape[1], BATCH):
            which = slice(first, first + BATCH)
            yield which, features @ weights[:, which]

    @property
    def order(self) -> int:
        """How far it goes: without bends to first order."""
        return 2 if len(self.second_derivative) else 1

    @property
    def weights(self) -> Array:
        """What features are multiplied by, (p + b, k)."""
        return np.concatenate([self.derivative, self.second_derivative])


def first_order(derivative: Array) -> Expansion:
    """Return quantities to first order, by derivatives (p, k) by parts of the tolerances."""
    return Expansion(derivative, np.zeros((0, 2), np.intp), np.zeros((0, derivative.shape[1])))


def second_order(solved: Solved, derivative: Array, advance: Advance = lambda: None) -> Expansion:
    """Return quantities to second order in dimensions.

    Args:
        solved: what solves a mechanism.
        derivative: exact derivatives by parts of the tolerances, (p, k).
        advance: called after each mechanism.

    Raises:
        InputError: where tolerances leave no assembly; names the dimensions.
    """
    count = len(derivative)

    def off(*signed: tuple[int, float]) -> Array:
        fractions = np.zeros(count)
        for i, sign in signed:
            fractions[i] = sign
        try:
            return solved.off(fractions)
        except MechsimError as error:
            raise InputError(
                f"the tolerances leave no assembly: with {solved.words(fractions)}: {error}"
            ) from None
        finally:
            advance()

    own = [0.5 * (off((i, 1.0)) + off((i, -1.0))) for i in range(count)]
    two = [*combinations(range(count), 2)]
    # either corner where both go alike, less what each does alone
    both = [0.5 * (off((i, 1.0), (j, 1.0)) + off((i, -1.0), (j, -1.0))) - own[i] - own[j] for i, j in two]
    pairs = np.array([*((i, i) for i in range(count)), *two], dtype=np.intp).reshape(-1, 2)
    return Expansion(derivative, pairs, np.array([*own, *both]).reshape(len(pairs), derivative.shape[1]))


def solves(count: int) -> int:
    """Return how many mechanisms an expansion in so many dimensions takes."""
    return count * (count + 1)


# poses solved in one go, whose arrays stay in a core's own cache; numbers kept at a time
BLOCK, KEPT = 8192, 6_400_000
# poses at the most, of which those with rates count so many times: about two seconds on one core
MAX_POSES, RATED = 10_000_000, 5


@dataclass(frozen=True)
class FormulaSamples:
    """Mechanisms with dimensions at random, solved by one formula.

    Attributes:
        solved: what solves one.
        solver: the mechanism as it stands.
        fractions: deviations in parts of the tolerances, (n, p), of mechanisms that can be put together.
    """

    solved: Solved
    solver: ClosedForm
    fractions: Array

    def blocks(self) -> Iterator[Block]:
        """Yield which of the quantities, (k,), and by how much all mechanisms are off there, (n, k)."""
        angles, columns = self.solved.moved.angles, self.solved.columns
        step = max(1, KEPT // (len(self.fractions) * len(columns)))
        for first in range(0, len(angles), step):
            indices = np.arange(first, min(first + step, len(angles)))
            which = np.concatenate([indices + i * len(angles) for i in range(len(columns))])
            yield which, self.solved.less(self._values(angles[indices]), which)

    def _values(self, angles: Array) -> Array:
        """Return the quantities at some angles, (n, columns * angles)."""
        columns, speed = self.solved.columns, self.solved.moved.rate
        quantities = [self.solved.moved.quantity(name) for name in columns]
        rates = any(quantity.order > 0 for quantity in quantities)
        joints = any(quantity.uses("joint") for quantity in quantities)
        out = np.empty((len(self.fractions), len(columns), len(angles)))
        for rows in _blocks(len(self.fractions), len(angles)):
            varied = _varied(self.solved, self.fractions[rows])
            columns_known = dict(
                solved(self.solver, varied, angles, speed, rates=rates, joints=joints).columns()
            )
            for i, quantity in enumerate(quantities):
                out[rows, i] = quantity.number(columns_known).reshape(-1, len(angles))
        return out.reshape(len(out), -1)


def formula_samples(solved_by: Solved, fractions: Array) -> tuple[FormulaSamples, Bools] | None:
    """Return mechanisms that one formula solves, and which of all cannot be put together, (n,).

    None where there is no such formula, or where it would take too long.

    Args:
        solved_by: what solves one.
        fractions: deviations of all in parts of the tolerances, (n, p).
    """
    solver, angles, columns = solved_by.moved.solver, solved_by.moved.angles, solved_by.columns
    quantities = [solved_by.moved.quantity(name) for name in columns]
    poses = (
        len(fractions) * len(angles) * (RATED if any(quantity.order > 0 for quantity in quantities) else 1)
    )
    if (
        poses > MAX_POSES
        or not isinstance(solver, TwoBranchForm)
        or not can_be_many(solver, solved_by.bounds)
    ):
        return None
    columns_known = solved(
        solver, _varied(solved_by, fractions[:1]), angles[:1], 1.0, rates=True, joints=True
    )
    if (
        not {column.name for quantity in quantities for column in quantity.columns}
        <= dict(columns_known.columns()).keys()
    ):
        return None
    # near change points an array of parameters has no branch of its own for each
    if solver.change_points():
        return None
    valid = allowed(solver, _varied(solved_by, fractions))
    for rows in _blocks(len(fractions), len(angles)):
        valid[rows] &= closed_at(solver, _varied(solved_by, fractions[rows]), angles)
    return FormulaSamples(solved_by, solver, fractions[valid]), ~valid


def _blocks(count: int, poses: int) -> Iterator[slice]:
    step = max(1, BLOCK // poses)
    return (slice(first, first + step) for first in range(0, count, step))


def _varied(solved: Solved, fractions: Array) -> dict[str, Array]:
    """Return the dimensions of mechanisms: name -> (n,) in SI."""
    values = solved.moved.designs.values()
    return {
        name: values[name] + fractions[:, i] * tolerance
        for i, (name, tolerance) in enumerate(solved.bounds.items())
    }


# parts of the samples that lie below and above the band
TAILS = (0.025, 0.975)
# samples solved to see how well an expansion holds, and where none does: so many, each solved
CHECKED, EACH = 50, 2000
# largest miss of an expansion, in standard deviations, with which it is taken; a deviation counts for no less
# than so much of the largest of its quantity
MISS, LEAST = 0.02, 1e-2


@dataclass(frozen=True, slots=True)
class Sampling:
    """How many mechanisms at random within tolerances were taken.

    Attributes:
        solved: how many were solved.
        failed: how many of these could not be assembled.
        order: to which all are taken, 1 or 2; 0 where each was solved.
        miss: largest difference between that and those solved, in standard deviations.
        seed: of the random numbers.
    """

    solved: int
    failed: int
    order: int
    miss: float
    seed: int


@dataclass(frozen=True, slots=True)
class Sampled:
    """Statistics of many mechanisms at random within tolerances.

    Attributes:
        sampling: how they were taken.
        samples: how many were requested, or were taken where each had to be solved by itself.
        mean: of the deviations from the nominal mechanism, (k,), in SI.
        deviation: standard deviation, (k,).
        low: deviation above which all but 2.5 % lie, (k,).
        high: deviation below which all but 2.5 % lie, (k,).
        least: lowest of all, (k,).
        most: highest, (k,).
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
    solved: Solved,
    derivative: Array,
    plays: Sequence[Array],
    tolerances: Tolerances,
    count: int,
    seed: int,
    advance: Advance = lambda: None,
) -> Sampled:
    """Return what comes of many mechanisms at random within tolerances.

    Each is solved where one formula takes them all. Else they are taken to first order, if some that are
    solved differ from that by less than a fiftieth of the standard deviation, or to second order; where that
    does not hold either, fewer are taken and each is solved. Clearances are taken to first order.

    Args:
        solved: what solves one.
        derivative: exact derivatives by parts of the tolerances, (p, k).
        plays: of each loose pin, what it puts off at its bound in 2 or 3 directions, (directions, k).
        tolerances: of dimensions.
        count: how many.
        seed: of the random numbers.
        advance: called after each that is solved.

    Raises:
        InputError: where tolerances leave no assembly.
    """
    random, width = np.random.default_rng(seed), derivative.shape[1]
    fractions = _fractions(random, count, len(derivative), tolerances)
    ends = np.concatenate([np.eye(len(derivative)), -np.eye(len(derivative))])
    if (
        len(derivative)
        and (samples := formula_samples(solved, np.concatenate([ends, fractions]))) is not None
    ):
        whole, lost = samples
        _require_assembled(solved, ends, lost[: len(ends)])
        whole, lost = replace(whole, fractions=whole.fractions[len(ends) :]), lost[len(ends) :]
        sampling = Sampling(count, int(lost.sum()), 0, 0.0, seed)
        return _statistics(whole.blocks(), len(whole.fractions), width, plays, random, sampling)
    checked = fractions[: CHECKED if len(derivative) else 0]
    exact, failed = _each(solved, checked, advance)
    spread = _spread(derivative * tolerances.spread, len(solved.columns))
    for made in (first_order, lambda derivative: second_order(solved, derivative, advance)):
        expanded = made(derivative)
        off = expanded.features(checked[~failed]) @ expanded.weights - exact
        miss = float((np.abs(off) / spread).max(initial=0.0))
        if miss <= MISS and not failed.any():
            sampling = Sampling(len(checked), 0, expanded.order, miss, seed)
            return _statistics(expanded.blocks(fractions), count, width, plays, random, sampling)
    exact, failed = _each(solved, fractions[:EACH], advance)
    sampling = Sampling(len(failed), int(failed.sum()), 0, 0.0, seed)
    return _statistics(iter([(EVERY, exact)]), len(exact), width, plays, random, sampling)


def _require_assembled(solved: Solved, ends: Array, lost: NDArray[np.bool_]) -> None:
    """Refuse tolerances that leave no assembly where one dimension alone is off by all of its own."""
    if lost.any():
        worst = solved.words(ends[int(np.argmax(lost))])
        raise InputError(
            f"the tolerances leave no assembly: with {worst} the loops do not close all along the motion; "
            "narrow them"
        )


def _spread(derivative: Array, columns: int) -> Array:
    """Return the standard deviations by which misses are judged, (k,); inf where nothing is off at all."""
    spread = np.sqrt((derivative**2).sum(0)).reshape(columns, -1)
    least = np.maximum(spread, LEAST * spread.max(1, keepdims=True, initial=0.0)).ravel()
    return np.where(least > 0.0, least, np.inf)


def _fractions(random: np.random.Generator, count: int, dimensions: int, tolerances: Tolerances) -> Array:
    """Return deviations in parts of their bounds, (count, dimensions)."""
    shape = (count, dimensions)
    if tolerances.distribution == "uniform":
        return random.uniform(-1.0, 1.0, shape)
    return tolerances.spread * random.standard_normal(shape)


def _each(solved: Solved, fractions: Array, advance: Advance) -> tuple[Array, NDArray[np.bool_]]:
    """Return by how much quantities are off, of those that can be put together, and which cannot."""
    errors: list[Array] = []
    failed = np.zeros(len(fractions), dtype=np.bool_)
    for i, fraction in enumerate(fractions):
        try:
            errors.append(solved.off(fraction))
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
    """Return the statistics of so many mechanisms, whose quantities (width,) come in blocks."""
    pins = [_pin_positions(len(play), count, random) for play in plays]
    statistics = np.empty((6, width))
    for which, off in blocks:
        for positions, derivative in zip(pins, plays, strict=True):
            off = off + positions @ derivative[:, which]
        low, high = np.quantile(off, TAILS, axis=0)
        statistics[:, which] = off.mean(0), off.std(0), low, high, off.min(0), off.max(0)
    return Sampled(sampling, count + sampling.failed, *statistics)


def _pin_positions(directions: int, count: int, random: np.random.Generator) -> Array:
    """Return places of a pin, evenly over a disc or a ball of radius 1, (count, directions)."""
    away = random.standard_normal((count, directions))
    away /= np.sqrt((away**2).sum(1, keepdims=True))
    return away * random.random((count, 1)) ** (1.0 / directions)
