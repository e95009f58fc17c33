"""Damped least-squares steps of sparse equations A x = b of many instants, by a band of A'A."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.numerics.banded import Band, BandedSystems, SparseMatrices, band
from mechsim.numerics.loop_solver import LoopSystem, Q


@dataclass(frozen=True)
class NormalBand:
    """Order in which the matrix A'A of a sparse matrix A is banded, and the products that form its entries.

    Attributes:
        band: the order.
        factors: both entries of A in each product, in the order of the entries of A'A, (2, p).
        first: first product of each entry of A'A, (k,).
        diagonal: entries of A'A on its diagonal, (u,).
        entries: entries of A in the order of its columns, (e,).
        columns: first entry of each column, (u,).
    """

    band: Band
    factors: NDArray[np.intp]
    first: NDArray[np.intp]
    diagonal: NDArray[np.intp]
    entries: NDArray[np.intp]
    columns: NDArray[np.intp]


def normal_band(pattern: SparseMatrices, columns: NDArray[np.intp]) -> NormalBand | None:
    """Return the order of A'A for selected columns of A; None for a wide band, or for a column of zeros."""
    count, column_of = len(columns), np.full(pattern.shape[1], -1)
    column_of[columns] = np.arange(count)
    column = column_of[pattern.columns]
    by_row: dict[int, list[int]] = {}
    for entry in np.flatnonzero(column >= 0).tolist():
        by_row.setdefault(int(pattern.rows[entry]), []).append(entry)
    factors = np.array([pair for row in by_row.values() for pair in product(row, row)], dtype=np.intp).T
    codes = count * column[factors[0]] + column[factors[1]]
    order = np.argsort(codes, kind="stable")
    square, first = np.unique(codes[order], return_index=True)
    diagonal = np.searchsorted(square, (count + 1) * np.arange(count))
    entries = np.argsort(column, kind="stable")[np.count_nonzero(column < 0) :]
    used, starts = np.unique(column[entries], return_index=True)
    every = np.arange(count)
    shape = SparseMatrices(*np.divmod(square, count), np.empty((len(square), 0)), (count, count))
    own = band(shape, every, every) if len(used) == count else None
    return None if own is None else NormalBand(own, factors[:, order], first, diagonal, entries, starts)


# residuals (n, m) and traces of A'A, (n,) -> what is added to the diagonal, (n,)
Damping = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class DampedBand:
    """Sparse equations A x = b whose least-squares solutions are damped.

    Attributes:
        rhs: residuals, (n, m).
        matrices: derivatives by all coordinates.
        normal: order of A'A.
        damping: its damping.
    """

    rhs: Array
    matrices: SparseMatrices
    normal: NormalBand
    damping: Damping

    @property
    def matrix(self) -> Array:
        """Derivatives by all coordinates, (n, m, count)."""
        return self.matrices.dense.transpose(2, 0, 1)

    def solution(self, right: Array, /) -> Array:
        """Return x with (A'A + damping) x = A' right, (n, u)."""
        normal, values = self.normal, self.matrices.values
        square = np.add.reduceat(values[normal.factors[0]] * values[normal.factors[1]], normal.first)
        square[normal.diagonal] += self.damping(right, square[normal.diagonal].sum(0))
        terms = values[normal.entries] * right.T[self.matrices.rows[normal.entries]]
        systems = BandedSystems(normal.band, square[normal.band.entries])
        return systems.solution(np.ascontiguousarray(np.add.reduceat(terms, normal.columns).T))


@dataclass(frozen=True)
class DampedLoops(LoopSystem[Q]):
    """Loop equations with damped Gauss-Newton steps in a band, for `newton.newton`.

    Attributes:
        normal: order of their normal equations.
        damping: their damping.
    """

    normal: NormalBand
    damping: Damping

    def linearise(self, q: Q, /) -> Any:
        """Return the equations linearised about n configurations."""
        loops: Any = self.loops
        residual, derivatives, _ = loops.sparse(q)
        return DampedBand(residual.T, derivatives, self.normal, self.damping)
