"""Sparse systems of many instants as one banded system, in an order that keeps entries next to the diagonal.

A row of loops is solved in time proportional to its length, instead of its cube.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE, least_squares

# entry of a Jacobian below which it is rounding
NEGLIGIBLE = 1e-14
# smallest ratio of the number of unknowns to the bandwidth: at 2 a band takes as long as dense systems, at 4
# half as long (`validation/speed/loop_speed.py`)
MIN_RATIO = 4
# largest number of Lanczos steps, number between two estimates, and their relative difference at the end
LANCZOS_STEPS, BETWEEN, CONVERGED = 60, 3, 1e-14
# size of separate blocks up to which their singular values are computed: as many equal loops have their
# smallest ones close to each other, for which Lanczos' method takes tens of steps
SMALL_BLOCK = 16
# largest multiple of the right side that solutions of least norm may have; and number of random right sides
# that show it: a smaller rank shows itself in one of them with a probability of 0.9999
LARGEST, PROBES = 1e4, 2
# largest number of entries of whole matrices that are solved together, which limits memory
WHOLE_NUMBERS = 2_000_000


# orders in which systems of least norm are banded, by the positions of their entries
Bands: TypeAlias = "dict[bytes, tuple[NDArray[np.intp], Band | None]]"


@dataclass(frozen=True)
class SparseMatrices:
    """Matrices of n instants with entries at the same positions, each position once.

    Attributes:
        rows: row of each entry, (e,).
        columns: its column, (e,).
        values: its values, (e, n).
        shape: number of rows and columns.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    values: Array
    shape: tuple[int, int]

    @cached_property
    def dense(self) -> Array:
        """The matrices, (rows, columns, n)."""
        out = np.zeros((*self.shape, self.values.shape[1]))
        out[self.rows, self.columns] = self.values
        return out

    def select(self, which: slice) -> "SparseMatrices":
        """Return the matrices of some instants."""
        return SparseMatrices(self.rows, self.columns, self.values[:, which], self.shape)

    @property
    def transposed(self) -> "SparseMatrices":
        """The transposed matrices."""
        return SparseMatrices(self.columns, self.rows, self.values, (self.shape[1], self.shape[0]))

    def only(self, rows: NDArray[np.intp] | slice) -> "SparseMatrices":
        """Return the matrices with all entries but those of selected rows zero."""
        selected = np.zeros(self.shape[0], dtype=np.bool_)
        selected[rows] = True
        entries = selected[self.rows]
        return SparseMatrices(self.rows[entries], self.columns[entries], self.values[entries], self.shape)

    def with_unit(self, column: int) -> "SparseMatrices":
        """Return the matrices with a last row that is 1 in a column."""
        rows, columns = np.append(self.rows, self.shape[0]), np.append(self.columns, column)
        values = np.concatenate([self.values, np.ones((1, self.values.shape[1]))])
        return SparseMatrices(rows, columns, values, (self.shape[0] + 1, self.shape[1]))

    def scaled(self, factors: Array, columns: Array | None = None) -> "SparseMatrices":
        """Return the matrices with rows multiplied by factors, (rows,), and columns, (columns,)."""
        factors = factors[self.rows] * (1.0 if columns is None else columns[self.columns])
        return SparseMatrices(self.rows, self.columns, factors[:, None] * self.values, self.shape)

    def column(self, number: int) -> Array:
        """Return a column, (rows, n)."""
        out, own = np.zeros((self.shape[0], self.values.shape[1])), self.columns == number
        out[self.rows[own]] = self.values[own]
        return out

    def without(self, column: int) -> "SparseMatrices":
        """Return the matrices without a column."""
        return self.restricted(np.delete(np.arange(self.shape[1]), column))

    def restricted(self, columns: NDArray[np.integer[Any]]) -> "SparseMatrices":
        """Return the matrices of some columns."""
        number = np.full(self.shape[1], -1)
        number[columns] = np.arange(len(columns))
        own = number[self.columns] >= 0
        return SparseMatrices(
            self.rows[own], number[self.columns[own]], self.values[own], (self.shape[0], len(columns))
        )

    def whole(self, instants: slice | NDArray[np.intp] = slice(None)) -> Array:
        """Return the matrices of some instants, (n, rows, columns)."""
        return np.moveaxis(replace(self, values=self.values[:, instants]).dense, 2, 0)

    def least_norm(
        self, right: Array, bands: Bands, dense: Callable[[NDArray[np.intp]], Array], *, regular: bool
    ) -> Array:
        """Return the solutions of least norm, (n, columns), for right sides (n, rows).

        Args:
            right: the right sides.
            bands: as in `least_norm_systems`.
            dense: solutions of some instants by whole matrices, for those with nearly dependent rows.
            regular: whether these are all instants in which rows are nearly dependent, or those only in which
                it makes the solution large.
        """
        solutions, valid = np.zeros((len(right), self.shape[1])), np.zeros(len(right), dtype=np.bool_)
        largest = np.abs(self.values).max(initial=0.0) or 1.0
        systems = least_norm_systems(replace(self, values=self.values / largest), bands)
        if systems is not None:
            solutions, valid = systems.least_norm(right[:, systems.rows] / largest)
            valid = valid & systems.independent if regular else valid
        others = np.flatnonzero(~valid)
        # as many together as fit into memory
        count = max(1, WHOLE_NUMBERS // (self.shape[0] * self.shape[1]))
        for first in range(0, len(others), count):
            which = others[first : first + count]
            solutions[which] = dense(which)
        return solutions

    def least_squares(self, right: Array, bands: Bands) -> Array:
        """Return least-squares solutions (n, columns) for right sides (n, rows), with a full column rank.

        They are the multipliers of A' in the solution of A' x = 0 nearest to the right side.
        """
        systems = least_norm_systems(self.transposed, bands)
        if systems is not None and len(systems.rows) == self.shape[1]:
            with suppress(np.linalg.LinAlgError):
                return systems.solved(right[None])[1][0]
        return least_squares(self.whole(), right)

    def product_signs(self, other: "SparseMatrices", bands: Bands) -> Array:
        """Return the signs of the determinants of A'B, (n,), for matrices B with the same positions.

        The determinant of the augmented matrix (1, B; A', 0) is (-1)^k det A'B with k columns.
        """
        n, columns = self.values.shape[1], self.shape[1]
        both = replace(self, values=np.hstack([self.values, other.values]))
        systems = least_norm_systems(both.transposed, bands)
        if systems is None or len(systems.rows) < columns:
            rows, i = np.unique(self.rows, return_inverse=True)
            whole = replace(both, rows=i, shape=(len(rows), columns)).whole()
            return np.linalg.slogdet(np.swapaxes(whole[:n], 1, 2) @ whole[n:])[0]
        augmented = systems.augmented
        entries = (len(augmented.values) - self.shape[0]) // 2
        mixed = augmented.values[:, :n].copy()
        mixed[-entries:] = augmented.values[-entries:, n:]
        return BandedSystems(augmented.band, mixed).determinant[0] * (-1.0) ** columns

    def smallest_singular_values(self) -> Array | None:
        """Return the smallest singular value of each matrix, (n,), square without its rows of zeros.

        None stands for matrices that are singular at every instant, or not banded.
        """
        own = np.abs(self.values).max(1) > NEGLIGIBLE
        matrix = replace(self, rows=self.rows[own], columns=self.columns[own], values=self.values[own])
        rows, columns = np.unique(matrix.rows), np.arange(self.shape[1])
        order = band(matrix, rows, columns) if len(rows) == len(columns) else None
        if order is None:
            return None
        smallest = BandedSystems(order, matrix.values[order.entries]).smallest_singular_values()
        # the Frobenius norm is a bound of the largest singular value
        regular = smallest > RANK_TOLERANCE * np.sqrt((matrix.values**2).sum(0))
        return smallest if regular.any() else None

    def times(self, vectors: Array) -> Array:
        """Return the products with vectors (columns, n), (rows, n); n may be 1 for one of both."""
        terms = self.values * vectors[self.columns]
        out = np.zeros((self.shape[0], terms.shape[1]), terms.dtype)
        np.add.at(out, self.rows, terms)
        return out


@dataclass(frozen=True)
class Band:
    """Order of equations and unknowns in which a sparse square matrix is banded.

    Attributes:
        entries: indices of its entries among those of a larger sparse matrix, (k,).
        equations: position of each equation, (u,).
        unknowns: position of each unknown, (u,).
        positions: position of each entry: row and column in the band's order, (2, k).
        widths: number of diagonals below and above the main one.
    """

    entries: NDArray[np.intp]
    equations: NDArray[np.intp]
    unknowns: NDArray[np.intp]
    positions: NDArray[np.intp]
    widths: tuple[int, int]

    @property
    def numbers(self) -> int:
        """Count of the numbers of a matrix as it is factorised."""
        return len(self.unknowns) * (2 * self.widths[0] + self.widths[1] + 1)

    @cached_property
    def blocks(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First positions of the blocks on the diagonal that no entry joins, and their sizes, (b,) each."""
        count = len(self.unknowns)
        joined = np.zeros(count + 1, dtype=np.intp)
        np.add.at(joined, self.positions.min(0) + 1, 1)
        np.add.at(joined, self.positions.max(0) + 1, -1)
        starts = np.flatnonzero(joined[:-1].cumsum() == 0)
        return starts, np.diff(starts, append=count)

    @cached_property
    def parity(self) -> float:
        """Sign that both orders give the determinant, by the number of their cycles."""
        cycles = sum(cycle_count(order.tolist()) for order in (self.equations, self.unknowns))
        return -1.0 if cycles % 2 else 1.0


def band(
    pattern: SparseMatrices,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    stated: Sequence[int] | NDArray[np.intp] = (),
) -> Band | None:
    """Return the order in which selected rows and columns are banded; None for a wide band.

    There are as many rows as columns; an equation for each of the columns `stated`, (s,), adds to the rows.

    Source: E. Cuthill and J. McKee, Reducing the bandwidth of sparse symmetric matrices, 24th ACM National
    Conference (1969), of rows and columns matched as the diagonal.
    """
    count = len(columns)
    from scipy import sparse
    from scipy.sparse import csgraph

    row_of, column_of = (np.full(length, -1) for length in pattern.shape)
    row_of[rows], column_of[columns] = np.arange(len(rows)), np.arange(count)
    entries = np.flatnonzero((row_of[pattern.rows] >= 0) & (column_of[pattern.columns] >= 0))
    i = np.append(row_of[pattern.rows[entries]], np.arange(len(rows), count))
    j = np.append(column_of[pattern.columns[entries]], np.array(stated, dtype=np.intp))
    graph: Any = csgraph
    matched = np.asarray(
        graph.maximum_bipartite_matching(sparse.csr_matrix((np.ones(len(i)), (i, j))), perm_type="row")
    )
    if len(matched) != count or (matched < 0).any():
        return None
    # the row that each column is matched with is the same node
    equal = np.empty(count, dtype=np.intp)
    equal[matched] = np.arange(count)
    order = graph.reverse_cuthill_mckee(
        sparse.csr_matrix((np.ones(len(i)), (equal[i], j))), symmetric_mode=False
    )
    position = np.empty(count, dtype=np.intp)
    position[order] = np.arange(count)
    equations = position[equal]
    positions = np.stack([equations[i], position[j]])
    below = positions[0] - positions[1]
    widths = max(int(below.max()), 0), max(int(-below.min()), 0)
    return Band(entries, equations, position, positions, widths) if sum(widths) * MIN_RATIO < count else None


@dataclass(frozen=True)
class BandedSystems:
    """Square systems of n instants, banded but for a border of dense last equations.

    The border C takes the place of the equations that state some unknowns. With these the band A is square,
    and the solution of the bordered system is A^-1 (b, 0) + V a, where the columns of V = A^-1 (0, 1) span
    the null space of the equations above the border, and C V a = c - C A^-1 (b, 0).

    Source: W. Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria (2000), chapter 3.

    Attributes:
        band: their order.
        values: their entries, (k, n).
        border: the last equations C, (n, s, u); None if all are in the band.
    """

    band: Band
    values: Array
    border: Array | None = None

    def __len__(self) -> int:
        return self.values.shape[1]

    def select(self, which: slice) -> "BandedSystems":
        """Return the systems of some instants."""
        border = None if self.border is None else self.border[which]
        return BandedSystems(self.band, self.values[:, which], border)

    @cached_property
    def dense(self) -> Array:
        """The matrices, (n, u, u)."""
        band = self.band
        i, j = band.positions[:, : len(self.values)]
        out = np.zeros((len(self), *[len(band.equations)] * 2), self.values.dtype)
        out[:, i, j] = self.values.T
        out = out[:, band.equations[:, None], band.unknowns]
        if self.border is not None:
            out[:, -self.border.shape[1] :] = self.border
        return out

    @cached_property
    def _factors(self) -> tuple[Array, NDArray[np.intp], bool]:
        """LU factors and pivots of the bands one after another, and whether one is singular (LAPACK)."""
        from scipy.linalg import lapack

        (low, high), count = self.band.widths, len(self.band.equations)
        rows = 2 * low + high + 1
        storage = np.zeros((len(self), count, rows), self.values.dtype)
        i, j = self.band.positions
        # the entries, then those of the equations that state an unknown
        storage[:, j, low + high + i - j] = 1.0
        i, j = i[: len(self.values)], j[: len(self.values)]
        storage[:, j, low + high + i - j] = self.values.T
        routines: Any = lapack
        factor = routines.zgbtrf if np.iscomplexobj(storage) else routines.dgbtrf
        factors, pivots, info = factor(storage.reshape(-1, rows).T, low, high, overwrite_ab=True)
        return factors, pivots, bool(info)

    def _banded_solution(self, right: Array, transposed: bool = False) -> Array:
        """Return A^-1 or A^-T times vectors (..., n, u)."""
        from scipy.linalg import lapack

        factors, pivots, singular = self._factors
        if singular:
            raise np.linalg.LinAlgError("Singular matrix")
        first, last = self.band.equations, self.band.unknowns
        if transposed:
            first, last = last, first
        ordered = np.empty(right.shape, np.result_type(right, factors))
        ordered[..., first] = right
        sides = ordered.reshape(-1, factors.shape[1]).T
        routines: Any = lapack
        solution = routines.zgbtrs if np.iscomplexobj(factors) else routines.dgbtrs
        solved, _ = solution(factors, *self.band.widths, sides, pivots, trans=int(transposed))
        return solved.T.reshape(right.shape)[..., last]

    @cached_property
    def _null_space(self) -> tuple[Array, Array]:
        """V, (n, u, s), and C V, (n, s, s)."""
        assert self.border is not None
        count, unknowns = self.border.shape[1:]
        units = np.zeros((count, len(self), unknowns))
        units[range(count), :, range(unknowns - count, unknowns)] = 1.0
        vectors = self._banded_solution(units).transpose(1, 2, 0)
        return vectors, self.border @ vectors

    @cached_property
    def _carried_border(self) -> Array:
        """A^-T times the rows of C, (s, n, u)."""
        assert self.border is not None
        return self._banded_solution(self.border.swapaxes(0, 1), transposed=True)

    def solution(self, right: Array, transposed: bool = False) -> Array:
        """Return the solutions (n, u) of right sides (n, u); of k n right sides those of k copies.

        Raises:
            LinAlgError: if a system is singular.
        """
        first = right.reshape(-1, len(self), right.shape[1])
        if self.border is None:
            return self._banded_solution(first, transposed).reshape(right.shape)
        (vectors, gains), rank = self._null_space, right.shape[1] - self.border.shape[1]
        if transposed:
            above = self._banded_solution(first, transposed)
            rows = self._carried_border
            above[..., rank:] = np.linalg.solve(gains.swapaxes(1, 2), above[..., rank:, None])[..., 0]
            above[..., :rank] -= np.einsum("snu,kns->knu", rows[..., :rank], above[..., rank:])
            return above.reshape(right.shape)
        last, first = first[..., rank:], first.copy()
        first[..., rank:] = 0.0
        above = self._banded_solution(first)
        rest = last - np.einsum("nsu,knu->kns", self.border, above)
        above += np.einsum("nus,kns->knu", vectors, np.linalg.solve(gains, rest[..., None])[..., 0])
        return above.reshape(right.shape)

    @cached_property
    def determinant(self) -> tuple[Array, Array]:
        """Signs, and logarithms of magnitudes, (n,) each."""
        factors, pivots, _ = self._factors
        diagonal = factors[sum(self.band.widths)].reshape(len(self), -1)
        swapped = (pivots != np.arange(len(pivots))).reshape(diagonal.shape).sum(1)
        sign = np.sign(diagonal).prod(1) * np.where(swapped % 2, -1.0, 1.0) * self.band.parity
        with np.errstate(divide="ignore"):
            logarithm = np.log(np.abs(diagonal)).sum(1)
        if self.border is not None:
            border_sign, border_logarithm = np.linalg.slogdet(self._null_space[1])
            return sign * border_sign, logarithm + border_logarithm
        return sign, logarithm

    def smallest_singular_values(self, error: float | None = None) -> Array:
        """Return the smallest singular value of each matrix A to a relative error, by default rounding, (n,).

        It is the largest of the inverse.

        Source: Lanczos' method with complete reorthogonalisation for (A^T A)^-1; G. Golub and C. Van Loan,
        Matrix Computations (2013), chapter 10.
        """
        if self.border is None and self.band.blocks[1].max() <= SMALL_BLOCK:
            return self._smallest_of_blocks()
        n, count = len(self), len(self.band.equations)
        basis, projected = np.empty((LANCZOS_STEPS + 1, n, count)), np.zeros((n, *[LANCZOS_STEPS + 1] * 2))
        start = np.random.default_rng(0).standard_normal(count)
        basis[0], before = start / np.linalg.norm(start), np.zeros(n)
        for k in range(0 if self._factors[2] else LANCZOS_STEPS):
            ahead = self.solution(self.solution(basis[k], transposed=True))
            projected[:, k, k] = np.einsum("nu,nu->n", basis[k], ahead)
            # the second projection removes the rounding of the first
            for _ in range(2):
                ahead -= np.einsum(
                    "kn,knu->nu", np.einsum("knu,nu->kn", basis[: k + 1], ahead), basis[: k + 1]
                )
            length = np.linalg.norm(ahead, axis=1)
            projected[:, k, k + 1] = projected[:, k + 1, k] = length
            basis[k + 1] = ahead / np.where(length > 0.0, length, 1.0)[:, None]
            if k % BETWEEN == BETWEEN - 1:
                largest = np.linalg.eigvalsh(projected[:, : k + 1, : k + 1])[:, -1]
                if (largest - before <= (CONVERGED if error is None else error) * largest).all():
                    return 1.0 / np.sqrt(largest)
                before = largest
        return np.asarray(np.linalg.svd(self.dense, compute_uv=False)[:, -1], dtype=np.float64)

    def least_singular_value(self, error: float) -> float:
        """Return the smallest singular value of the matrix with the smallest determinant."""
        index = int(self.determinant[1].argmin())
        return float(self.select(slice(index, index + 1)).smallest_singular_values(error)[0])

    def _smallest_of_blocks(self) -> Array:
        """Return the smallest singular value of each matrix of separate small blocks, (n,)."""
        starts, sizes = self.band.blocks
        i, j = self.band.positions
        block = np.searchsorted(starts, i, "right") - 1
        smallest = np.full(len(self), np.inf)
        for count in np.unique(sizes):
            number = np.cumsum(sizes == count) - 1
            own = sizes[block] == count
            matrices = np.zeros((len(self), number[-1] + 1, count, count))
            index = number[block[own]], i[own] - starts[block[own]], j[own] - starts[block[own]]
            # the entries, then those of the equations that state an unknown
            values = np.concatenate([self.values, np.ones((len(i) - len(self.values), len(self)))])
            matrices[:, *index] = values[own].T
            smallest = np.minimum(smallest, np.linalg.svd(matrices, compute_uv=False)[..., -1].min(1))
        return smallest


def symmetric_band(pattern: SparseMatrices) -> Band | None:
    """Return the order in which a matrix with symmetric positions of entries is banded; None for a wide band.

    Source: as for `band`.
    """
    from scipy import sparse
    from scipy.sparse import csgraph

    count, graph = pattern.shape[0], csgraph
    routines: Any = graph
    order = routines.reverse_cuthill_mckee(
        sparse.csr_matrix((np.ones(len(pattern.rows)), (pattern.rows, pattern.columns)), pattern.shape),
        symmetric_mode=True,
    )
    position = np.empty(count, dtype=np.intp)
    position[order] = np.arange(count)
    positions = np.stack([position[pattern.rows], position[pattern.columns]])
    width = int(np.abs(positions[0] - positions[1]).max(initial=0))
    entries = np.arange(len(pattern.rows))
    wide = 2 * width * MIN_RATIO >= count
    return None if wide else Band(entries, position, position, positions, (width, width))


def least_norm_systems(
    matrix: SparseMatrices,
    bands: Bands,
    metric: SparseMatrices | None = None,
) -> "LeastNormSystems | None":
    """Return sparse equations as systems for solutions of least norm; None if they are not banded.

    Args:
        matrix: Jacobians, (rows, unknowns).
        bands: orders of equations and unknowns that were computed before, which new ones are added to.
        metric: symmetric matrices of the square of the norm, with entries at the same positions whenever
            `bands` are the same; the default is the identity.
    """
    # those out of the plane of a planar linkage are zero
    nonzero = np.abs(matrix.values).max(1, initial=0.0) > NEGLIGIBLE
    i, j, count = matrix.rows[nonzero], matrix.columns[nonzero], matrix.shape[1]
    key = np.concatenate([[count], i, j]).tobytes()
    values, diagonal = matrix.values[nonzero], np.arange(count)
    if metric is None:
        metric = SparseMatrices(diagonal, diagonal, np.ones((count, values.shape[1])), (count, count))
    if key not in bands:
        rows, i = np.unique(i, return_inverse=True)
        order = count + len(rows)
        first = np.concatenate([metric.rows, count + i, j])
        second = np.concatenate([metric.columns, j, count + i])
        pattern = SparseMatrices(first, second, np.zeros((len(first), 0)), (order, order))
        bands[key] = rows, symmetric_band(pattern) if len(rows) <= count else None
    rows, band = bands[key]
    if band is None:
        return None
    return LeastNormSystems(rows, count, BandedSystems(band, np.concatenate([metric.values, values, values])))


def entries_of(matrix: Array) -> SparseMatrices:
    """Return the entries of matrices (n, m, k) that are not rounding."""
    rows, columns = np.nonzero(np.abs(matrix).max(0, initial=0.0) > NEGLIGIBLE)
    return SparseMatrices(rows, columns, matrix[:, rows, columns].T, matrix.shape[1:])


@dataclass(frozen=True)
class LeastNormSystems:
    """Sparse equations J x = g of n instants with independent rows: solutions of least norm, multipliers.

    Both solve the augmented system M x + J'y = f, J x = g, whose LU factors do not square the condition of
    J; the metric M of the norm is the identity by default.

    Source: Å. Björck, Iterative refinement of linear least squares solutions I, BIT 7 (1967) 257-278.

    Attributes:
        rows: the equations that are not zero, among all, (r,).
        count: number of unknowns, u.
        augmented: the systems, (n, u + r).
    """

    rows: NDArray[np.intp]
    count: int
    augmented: BandedSystems

    def __len__(self) -> int:
        return len(self.augmented)

    def solved(self, first: Array, second: Array | None = None) -> tuple[Array, Array]:
        """Return x (k, n, u) and y (k, n, r) of k right sides f (k, n, u) and g (k, n, r), by default 0.

        Raises:
            LinAlgError: if a system is singular.
        """
        k, n, u = first.shape
        right = np.zeros((k, n, u + len(self.rows)))
        right[..., :u] = first
        if second is not None:
            right[..., u:] = second
        solution = self.augmented.solution(right.reshape(k * n, -1)).reshape(right.shape)
        return solution[..., :u], solution[..., u:]

    def least_norm(self, right: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the solutions of least norm, (n, u), of right sides (n, r), and where they are valid, (n,).

        They are not where the rows are nearly dependent.
        """
        try:
            (solutions,), _ = self.solved(np.zeros((1, len(right), self.count)), right[None])
        except np.linalg.LinAlgError:
            return np.zeros((len(right), self.count)), np.zeros(len(right), dtype=np.bool_)
        return solutions, np.abs(solutions).max(1) <= LARGEST * np.abs(right).max(1, initial=0.0)

    @cached_property
    def independent(self) -> NDArray[np.bool_]:
        """Where the rows are independent, (n,): the multipliers of random vectors are not large there."""
        vectors = self._random(PROBES)
        try:
            multipliers = self.solved(vectors)[1]
        except np.linalg.LinAlgError:
            return np.zeros(len(self), dtype=np.bool_)
        longest = np.linalg.norm(vectors[:, 0], axis=1).max()
        return np.abs(multipliers).max((0, 2), initial=0.0) <= LARGEST * longest

    def _random(self, count: int) -> Array:
        """Return random vectors, equal at all instants, (count, n, u)."""
        random = np.random.default_rng(0).standard_normal((count, 1, self.count))
        return np.broadcast_to(random, (count, len(self), self.count))

    @cached_property
    def null_bases(self) -> tuple[Array, NDArray[np.bool_]]:
        """Orthonormal bases of the null spaces, (n, u, u - r), and where the rows are independent, (n,)."""
        dof = self.count - len(self.rows)
        projected = np.array(self._random(dof))
        with suppress(np.linalg.LinAlgError):
            # the second projection removes the rounding of the first
            for _ in range(2 if dof else 0):
                projected = self.solved(projected)[0]
        projected[:, ~self.independent] = 0.0
        return np.linalg.qr(projected.transpose(1, 2, 0))[0], self.independent


def cycle_count(order: Sequence[int]) -> int:
    """Return the number of cycles of a permutation."""
    visited, count = [False] * len(order), 0
    for node in range(len(order)):
        count += not visited[node]
        while not visited[node]:
            visited[node], node = True, order[node]
    return count
