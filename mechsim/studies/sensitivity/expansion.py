"""Quantities near a mechanism to first or second order in its dimensions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.derivatives import Dimension
from mechsim.errors import InputError, MechsimError
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.moved_family import MovedFamily

Watch = Callable[[], None]
Places = NDArray[np.intp] | slice
# which of the quantities, and by how much each of many mechanisms is off there
Block = tuple[Places, Array]
EVERY = slice(None)
# quantities taken in one go
BLOCK = 64


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

    def off(self, parts: Array) -> Array:
        """Return by how much quantities are off, (k,), with dimensions off by parts of their bounds, (p,).

        Raises:
            AssemblyError: where the loops do not close.
        """
        found = self.moved.values(self.columns, self.dimensions(parts))
        return self.less(np.concatenate([found[one] for one in self.columns]))

    def less(self, found: Array, which: Places = EVERY) -> Array:
        """Return by how much some of the quantities, (..., k), differ from the mechanism as it stands."""
        off = found - self.values[which]
        angular = self.angular[which]
        off[..., angular] -= REVOLUTION * np.round(off[..., angular] / REVOLUTION)
        return off

    def dimensions(self, parts: Array) -> dict[str, float]:
        """Return the dimensions that changed, in SI."""
        known: Mapping[str, Dimension] = self.moved.family.dimensions
        off = zip(self.bounds, parts.tolist(), strict=True)
        return {name: known[name].value + part * self.bounds[name] for name, part in off if part}

    def words(self, parts: Array) -> str:
        """Return the dimensions that changed, in words."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in self.dimensions(parts).items())


@dataclass(frozen=True)
class Expansion:
    """Quantities to first or second order: off = slope . d + products of d . bend, d in parts of tolerances.

    Attributes:
        slope: exact, (p, k).
        pairs: indices of two dimensions for each column of bends, (b, 2).
        bend: second differences over the whole of the tolerances, (b, k); a dimension's own are halved.
    """

    slope: Array
    pairs: NDArray[np.intp]
    bend: Array

    def features(self, parts: Array) -> Array:
        """Return d and its products, (n, p + b), of parts (n, p)."""
        return np.concatenate([parts, parts[:, self.pairs[:, 0]] * parts[:, self.pairs[:, 1]]], 1)

    def blocks(self, parts: Array) -> Iterator[Block]:
        """Yield which of the quantities, and by how much mechanisms with parts (n, p) are off there."""
        features, weights = self.features(parts), self.weights
        for first in range(0, weights.shape[1], BLOCK):
            which = slice(first, first + BLOCK)
            yield which, features @ weights[:, which]

    @property
    def order(self) -> int:
        """How far it goes: without bends to first order."""
        return 2 if len(self.bend) else 1

    @property
    def weights(self) -> Array:
        """What features are multiplied by, (p + b, k)."""
        return np.concatenate([self.slope, self.bend])


def first_order(slope: Array) -> Expansion:
    """Return quantities to first order, by derivatives (p, k) by parts of the tolerances."""
    return Expansion(slope, np.zeros((0, 2), np.intp), np.zeros((0, slope.shape[1])))


def second_order(solved: Solved, slope: Array, watch: Watch = lambda: None) -> Expansion:
    """Return quantities to second order in dimensions.

    Args:
        solved: what solves a mechanism.
        slope: exact derivatives by parts of the tolerances, (p, k).
        watch: called after each mechanism.

    Raises:
        InputError: where tolerances leave no assembly; names the dimensions.
    """
    count = len(slope)

    def off(*signed: tuple[int, float]) -> Array:
        parts = np.zeros(count)
        for i, sign in signed:
            parts[i] = sign
        try:
            return solved.off(parts)
        except MechsimError as error:
            raise InputError(
                f"the tolerances leave no assembly: with {solved.words(parts)}: {error}"
            ) from None
        finally:
            watch()

    own = [0.5 * (off((i, 1.0)) + off((i, -1.0))) for i in range(count)]
    two = [*combinations(range(count), 2)]
    # either corner where both go alike, less what each does alone
    both = [0.5 * (off((i, 1.0), (j, 1.0)) + off((i, -1.0), (j, -1.0))) - own[i] - own[j] for i, j in two]
    pairs = np.array([*((i, i) for i in range(count)), *two], dtype=np.intp).reshape(-1, 2)
    return Expansion(slope, pairs, np.array([*own, *both]).reshape(len(pairs), slope.shape[1]))


def solves(count: int) -> int:
    """Return how many mechanisms an expansion in so many dimensions takes."""
    return count * (count + 1)
