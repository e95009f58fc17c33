"""Quantities near a mechanism to first or second order in its dimensions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.derivatives.dimensions import Dimension
from mechsim.errors import InputError, MechsimError
from mechsim.numerics.angles import wrapped
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.moved_family import MovedFamily

Advance = Callable[[], None]
Columns = NDArray[np.intp] | slice
# which of the quantities, and by how much each of many mechanisms is off there
Block = tuple[Columns, Array]
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
        for first in range(0, weights.shape[1], BLOCK):
            which = slice(first, first + BLOCK)
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
