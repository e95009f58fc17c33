"""Monte Carlo over tolerances: many mechanisms at random, some of them solved to say how well that holds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm, TwoBranchForm
from mechsim.analytic.catalog.many_designs import Bools, allowed, can_be_many, closed_at, solved
from mechsim.errors import InputError, MechsimError
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.expansion import EVERY, Block, Solved, Watch, first_order, second_order
from mechsim.studies.sensitivity.tolerances import Tolerances

# poses solved in one go, whose arrays stay in a core's own cache; numbers kept at a time
BLOCK, KEPT = 8192, 6_400_000
# poses at the most, of which those with rates count so many times: about two seconds on one core
MOST, RATED = 10_000_000, 5


@dataclass(frozen=True)
class FormulaSamples:
    """Mechanisms with dimensions at random, solved by one formula.

    Attributes:
        solved: what solves one.
        form: the mechanism as it stands.
        parts: deviations in parts of the tolerances, (n, p), of mechanisms that can be put together.
    """

    solved: Solved
    form: ClosedForm
    parts: Array

    def blocks(self) -> Iterator[Block]:
        """Yield which of the quantities, (k,), and by how much all mechanisms are off there, (n, k)."""
        angles, columns = self.solved.moved.angles, self.solved.columns
        step = max(1, KEPT // (len(self.parts) * len(columns)))
        for first in range(0, len(angles), step):
            some = np.arange(first, min(first + step, len(angles)))
            which = np.concatenate([some + i * len(angles) for i in range(len(columns))])
            yield which, self.solved.less(self._values(angles[some]), which)

    def _values(self, angles: Array) -> Array:
        """Return the quantities at some angles, (n, columns * angles)."""
        columns, speed = self.solved.columns, self.solved.moved.rate
        wanted = [self.solved.moved.quantity(name) for name in columns]
        rates = any(part.order > 0 for part in wanted)
        joints = any(part.uses("joint") for part in wanted)
        out = np.empty((len(self.parts), len(columns), len(angles)))
        for rows in _blocks(len(self.parts), len(angles)):
            varied = _varied(self.solved, self.parts[rows])
            told = dict(solved(self.form, varied, angles, speed, rates=rates, joints=joints).columns())
            for i, part in enumerate(wanted):
                out[rows, i] = part.number(told).reshape(-1, len(angles))
        return out.reshape(len(out), -1)


def formula_samples(of: Solved, parts: Array) -> tuple[FormulaSamples, Bools] | None:
    """Return mechanisms that one formula solves, and which of all cannot be put together, (n,).

    None where there is no such formula, or where it would take too long.

    Args:
        of: what solves one.
        parts: deviations of all in parts of the tolerances, (n, p).
    """
    form, angles, columns = of.moved.form, of.moved.angles, of.columns
    wanted = [of.moved.quantity(name) for name in columns]
    poses = len(parts) * len(angles) * (RATED if any(part.order > 0 for part in wanted) else 1)
    if poses > MOST or not isinstance(form, TwoBranchForm) or not can_be_many(form, of.bounds):
        return None
    told = solved(form, _varied(of, parts[:1]), angles[:1], 1.0, rates=True, joints=True)
    if not {column.name for part in wanted for column in part.columns} <= dict(told.columns()).keys():
        return None
    # near change points an array of parameters has no branch of its own for each
    if form.change_points():
        return None
    good = allowed(form, _varied(of, parts))
    for rows in _blocks(len(parts), len(angles)):
        good[rows] &= closed_at(form, _varied(of, parts[rows]), angles)
    return FormulaSamples(of, form, parts[good]), ~good


def _blocks(count: int, poses: int) -> Iterator[slice]:
    step = max(1, BLOCK // poses)
    return (slice(first, first + step) for first in range(0, count, step))


def _varied(of: Solved, parts: Array) -> dict[str, Array]:
    """Return the dimensions of mechanisms: name -> (n,) in SI."""
    values = of.moved.family.values()
    return {name: values[name] + parts[:, i] * bound for i, (name, bound) in enumerate(of.bounds.items())}


# parts of the samples that lie below and above the band
TAILS = (0.025, 0.975)
# samples solved to see how well an expansion holds, and where none does: so many, each solved
CHECKED, EACH = 50, 2000
# largest miss of an expansion, in standard deviations, with which it is taken; a deviation counts for no less
# than so much of the largest of its quantity
MISS, LEAST = 0.02, 1e-2


@dataclass(frozen=True, slots=True)
class Sampled:
    """What came of many mechanisms at random within tolerances.

    Attributes:
        samples: how many were asked for, or were taken where each had to be solved by itself.
        solved: how many of them were solved.
        failed: how many of these could not be put together.
        order: to which all are taken, 1 or 2; 0 where each was solved.
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

    Each is solved where one formula takes them all. Else they are taken to first order, if some that are
    solved differ from that by less than a fiftieth of the standard deviation, or to second order; where that
    does not hold either, fewer are taken and each is solved. Clearances are taken to first order.

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
    ends = np.concatenate([np.eye(len(slope)), -np.eye(len(slope))])
    if len(slope) and (found := formula_samples(solved, np.concatenate([ends, parts]))) is not None:
        whole, lost = found
        _require_assembled(solved, ends, lost[: len(ends)])
        whole, lost = replace(whole, parts=whole.parts[len(ends) :]), lost[len(ends) :]
        about = _About(count, int(lost.sum()), 0, 0.0, seed)
        return _told(whole.blocks(), len(whole.parts), slope.shape[1], plays, random, about)
    taken = parts[: CHECKED if len(slope) else 0]
    exact, failed = _each(solved, taken, watch)
    spread = _spread(slope * tolerances.spread, len(solved.columns))
    for made in (first_order, lambda slope: second_order(solved, slope, watch)):
        expanded = made(slope)
        off = expanded.features(taken[~failed]) @ expanded.weights - exact
        miss = float((np.abs(off) / spread).max(initial=0.0))
        if miss <= MISS and not failed.any():
            about = _About(len(taken), 0, expanded.order, miss, seed)
            return _told(expanded.blocks(parts), count, slope.shape[1], plays, random, about)
    exact, failed = _each(solved, parts[:EACH], watch)
    about = _About(len(failed), int(failed.sum()), 0, 0.0, seed)
    return _told(iter([(EVERY, exact)]), len(exact), slope.shape[1], plays, random, about)


def _require_assembled(solved: Solved, ends: Array, lost: NDArray[np.bool_]) -> None:
    """Refuse tolerances that leave no assembly where one dimension alone is off by all of its own."""
    if lost.any():
        worst = solved.words(ends[int(np.argmax(lost))])
        raise InputError(
            f"the tolerances leave no assembly: with {worst} the loops do not close all along the motion; "
            "narrow them"
        )


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
    blocks: Iterator[Block],
    count: int,
    width: int,
    plays: Sequence[Array],
    random: np.random.Generator,
    about: _About,
) -> Sampled:
    """Return the statistics of so many mechanisms, whose quantities (width,) come in blocks."""
    pins = [_places(len(one), count, random) for one in plays]
    found = np.empty((6, width))
    for which, off in blocks:
        for places, slope in zip(pins, plays, strict=True):
            off = off + places @ slope[:, which]
        low, high = np.quantile(off, TAILS, axis=0)
        found[:, which] = off.mean(0), off.std(0), low, high, off.min(0), off.max(0)
    return Sampled(
        count + about.failed, about.solved, about.failed, about.order, about.miss, about.seed, *found
    )


def _places(directions: int, count: int, random: np.random.Generator) -> Array:
    """Return places of a pin, evenly over a disc or a ball of radius 1, (count, directions)."""
    away = random.standard_normal((count, directions))
    away /= np.sqrt((away**2).sum(1, keepdims=True))
    return away * random.random((count, 1)) ** (1.0 / directions)
