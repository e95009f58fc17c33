"""Linearised loops at many instants as square systems: independent equations and a null-space basis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import LinearEquations, NewtonSettings, square_solution
from mechsim.numerics.rank import RANK_TOLERANCE, pivot_columns, right_vectors, significant

if TYPE_CHECKING:
    from mechsim.numerics.banded import Band, BandedSystems, SparseMatrices

# least number of unknowns for which importing scipy (0.15 s) pays: the band saves 0.1 s of 100 configurations
# (`validation/speed/loop_speed.py`)
MIN_UNKNOWNS = 100
# entry of a Jacobian below which it is rounding
NEGLIGIBLE = 1e-14
# Newton's method about a nearby configuration: beyond this displacement the linear model is invalid
NEARBY = NewtonSettings(max_displacement=0.3)
# smallest singular value, and determinant, relative to the best equations, below which others are selected;
# and the ratio to their value elsewhere below which the equations, not the pose, are singular
MIN_VALUE_RATIO, MIN_DETERMINANT_RATIO, MIN_SHARE_RATIO = 0.4, 0.5, 0.2


class ConfigurationBatch(Protocol):
    """Values of all coordinates at n instants."""

    def __len__(self) -> int: ...

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp], /) -> Self:
        """Return the configurations at selected instants."""
        ...

    def repeated(self, times: int, /) -> Self:
        """Return all configurations repeated, one copy after another."""
        ...


class DrivenEquations(Protocol):
    """Loop-closure equations in coordinates, some of which are prescribed.

    Coordinates have units: [rad], or a characteristic length.
    """

    @property
    def name(self) -> str:
        """Name of the mechanism or model, for messages."""
        ...

    @property
    def count(self) -> int:
        """Number of coordinates."""
        ...

    @cached_property
    def rows(self) -> int:
        """Number of equations."""
        ...

    @property
    def driven(self) -> Sequence[int]:
        """Indices of the prescribed coordinates."""
        ...

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """Indices of the coordinates that the equations determine, (u,)."""
        ...

    @cached_property
    def units(self) -> Array:
        """Units of the coordinates, (count,)."""
        ...

    def linearise(self, q: Any, /) -> tuple[Array, Array, Any]:
        """Return residuals (rows, n), Jacobians by coordinates in units (rows, count, n), and link poses."""
        ...

    @property
    def sparse(self) -> Callable[[Any], tuple[Array, SparseMatrices, Any]] | None:
        """What returns the same as `linearise` with sparse Jacobians; None for equations without them."""
        ...

    def displaced(self, q: Any, step: Array, /) -> Any:
        """Return configurations displaced by a step (count, n) in units."""
        ...

    def flat(self, q: Any, /) -> Array:
        """Return configurations as rows of dimensionless numbers, (n, w)."""
        ...

    def unflat(self, rows: Array, driven: Array, /) -> Any:
        """Return configurations from approximate rows of numbers and prescribed values (driven, n)."""
        ...

    def along(self, q: Any, reference: Any, directions: Array, /) -> tuple[Array, Array]:
        """Return displacements along directions (k, u) from a reference, (n, k), and their derivatives."""
        ...


E = TypeVar("E", bound=DrivenEquations)
Q = TypeVar("Q", bound=ConfigurationBatch)


@dataclass(frozen=True)
class Linearised:
    """Loops linearised about n sets of coordinates.

    Attributes:
        residual: residuals of all equations, (rows, n).
        derivatives: of all equations by all coordinates in their units, (rows, count, n) or as sparse.
        poses: poses of the links, as the equations return them.
        systems: derivatives of independent and null-space equations by the unknowns, (n, u, u) or as banded.
        rhs: residuals of the same equations, (n, u).
        unknown: indices of the unknown coordinates, (u,).
        others: indices of the equations that are not solved.
    """

    residual: Array
    derivatives: Array | SparseMatrices
    poses: Any
    systems: Array | BandedSystems
    rhs: Array
    unknown: NDArray[np.intp]
    others: NDArray[np.intp]

    @property
    def jacobian(self) -> Array:
        """Derivatives by all coordinates in their units, (rows, count, n)."""
        whole = self.derivatives
        return whole if isinstance(whole, np.ndarray) else whole.dense

    @property
    def matrix(self) -> Array:
        """Derivatives of independent and null-space equations by the unknowns, (n, u, u)."""
        return self.systems if isinstance(self.systems, np.ndarray) else self.systems.dense

    def times(self, step: Array) -> Array:
        """Return the changes of the residuals, (rows, n), by steps of all coordinates, (count, n)."""
        if not isinstance(self.derivatives, np.ndarray):
            return self.derivatives.times(step)
        return np.einsum("rkn,kn->rn", self.jacobian, step)

    def changes(self, steps: Array) -> Array:
        """Return the changes of the residuals, (rows, s, n), by s steps of all coordinates, (count, s)."""
        if not isinstance(self.derivatives, np.ndarray) and len(self.systems) == 1:
            return self.derivatives.times(steps)[..., None]
        return np.tensordot(self.jacobian, steps, (1, 0)).swapaxes(1, 2)

    def solution(self, right: Array) -> Array:
        """Return the unknowns (n, u) that give right sides (n, u); of k n right sides those of k copies.

        Raises:
            LinAlgError: if a system is singular.
        """
        if not isinstance(self.systems, np.ndarray):
            return self.systems.solution(right)
        copies = len(right) // len(self.matrix)
        return square_solution(np.tile(self.matrix, (copies, 1, 1)) if copies > 1 else self.matrix, right)

    @cached_property
    def singular_values(self) -> Array:
        """Singular values of the matrices, (n, u)."""
        return np.asarray(np.linalg.svd(self.matrix, compute_uv=False), dtype=np.float64)

    @cached_property
    def all_singular_values(self) -> Array:
        """Singular values of all equations' derivatives by the unknowns, (n, smaller dimension)."""
        if self.alone:
            return self.singular_values
        jacobian = self.jacobian.take(self.unknown, 1)
        return np.asarray(np.linalg.svd(jacobian.transpose(2, 0, 1), compute_uv=False), dtype=np.float64)

    @cached_property
    def alone(self) -> bool:
        """Whether all unknowns are determined, and the unused equations are zero or absent."""
        return len(self.others) + self.rhs.shape[1] == len(self.residual) and self.others_vanish

    @cached_property
    def others_vanish(self) -> bool:
        """Whether the unused equations are zero, as those out of the plane of a planar linkage, or absent."""
        whole = self.derivatives
        if isinstance(whole, np.ndarray):
            values = whole.take(self.unknown, 1).take(self.others, 0)
        else:
            values = whole.values[np.isin(whole.rows, self.others) & np.isin(whole.columns, self.unknown)]
        return bool(np.abs(values).max(initial=0.0) < NEGLIGIBLE)

    def smallest_of_all(self, rank: int, error: float | None = None) -> Array:
        """Return the smallest relevant singular values of all equations, (n,); 1 without unknowns.

        Those of bands have at most a relative error; the default is rounding.
        """
        if not rank:
            return np.ones(len(self.systems))
        if self.alone or (not isinstance(self.systems, np.ndarray) and self.others_vanish):
            return self.smallest(error)
        return self.all_singular_values[:, rank - 1]

    def smallest(self, error: float | None = None) -> Array:
        """Return the smallest singular values of the matrices as `smallest_of_all`; inf if empty, (n,)."""
        if isinstance(self.systems, np.ndarray):
            return self.singular_values.min(1, initial=np.inf)
        return self.systems.smallest_singular_values(error)

    def nearly_singular(self, limit: float, error: float) -> bool:
        """Whether a singular value is below a limit; of bands that of the matrix with the least determinant.

        Those of whole matrices A (u, u) are at least |det A| ((u - 1) / |A|^2)^((u - 1) / 2) (Yu and Gu 1997,
        Linear Algebra and its Applications 253).
        """
        if not isinstance(self.systems, np.ndarray):
            return self.systems.least_singular_value(error) < limit
        if (others := self.systems.shape[1] - 1) > 0:
            squares = np.einsum("nij,nij->n", self.systems, self.systems)
            if (self.determinant[1] + 0.5 * others * np.log(others / squares)).min() > np.log(limit):
                return False
        return float(self.smallest().min()) < limit

    @cached_property
    def signed_distance(self) -> Array:
        """Signed distance from a singular pose, (n,); opposite in sign in two assembly modes that meet."""
        return self.determinant[0] * self.smallest()

    def last(self, count: int) -> Linearised:
        """Return the loops about the last `count` sets."""
        return replace(
            self,
            residual=self.residual[:, -count:],
            derivatives=self.jacobian[..., -count:],
            systems=self.matrix[-count:],
            rhs=self.rhs[-count:],
        )

    @cached_property
    def determinant(self) -> tuple[Array, Array]:
        """Signs of the determinants, and logarithms of their magnitudes, (n,) each."""
        if not isinstance(self.systems, np.ndarray):
            return self.systems.determinant
        sign, logarithm = np.linalg.slogdet(self.systems)
        return sign, logarithm


@dataclass(frozen=True)
class LoopSolver(Generic[E, Q]):
    """The selected equations, and the null-space basis that keeps undetermined coordinates constant.

    Attributes:
        loops: the loop equations.
        rows: indices of independent equations, (r,).
        null_space: basis of the undetermined motion of the unknowns, (nullity, unknowns).
        reference: coordinates without displacement along the basis: one set, or one for each design.
    """

    loops: E
    rows: NDArray[np.intp]
    null_space: Array
    reference: Q

    @cached_property
    def others(self) -> NDArray[np.intp]:
        """Indices of the unused equations."""
        return np.delete(np.arange(self.loops.rows), self.rows)

    @cached_property
    def at_reference(self) -> Linearised:
        """The loops about the reference."""
        return self.linearise(self.reference)

    @property
    def nullity(self) -> int:
        """Number of degrees of freedom that neither drivers nor loops determine."""
        return len(self.null_space)

    @property
    def uses_all_rows(self) -> bool:
        """Whether all equations are solved and determine all unknowns."""
        return not self.nullity and len(self.rows) == self.loops.rows

    def adequate(self, linearised: Linearised) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the poses at which the selected equations are about as well conditioned as all, (n,) each.

        The first mask compares the smallest singular values, the second the determinants.
        """
        if self._alone(linearised):
            everywhere = np.ones(len(linearised.systems), dtype=np.bool_)
            return everywhere, everywhere
        all_poses = linearised.all_singular_values[:, : len(self.rows)]
        by_smallest = linearised.singular_values[:, -1] > MIN_VALUE_RATIO * all_poses[:, -1]
        return by_smallest, linearised.singular_values.prod(1) > MIN_DETERMINANT_RATIO * all_poses.prod(1)

    def _alone(self, linearised: Linearised) -> bool:
        """Whether the unused equations are zero or absent."""
        return self.uses_all_rows or not len(self.rows) or linearised.alone

    def share(self, linearised: Linearised) -> Array:
        """Return the ratio of the smallest singular values of the selected equations and of all, (n,)."""
        if self._alone(linearised):
            return np.ones(len(linearised.systems))
        every = linearised.all_singular_values[:, len(self.rows) - 1]
        nonzero = every > RANK_TOLERANCE * every.max()
        return np.where(nonzero, linearised.singular_values[:, -1] / np.where(nonzero, every, 1.0), 1.0)

    @cached_property
    def band(self) -> Band | None:
        """Order in which the equations are banded; None if they are few, or solved as a whole."""
        sparse = self.loops.sparse
        if sparse is None or not len(self.rows) + self.nullity == len(self.loops.unknown) >= MIN_UNKNOWNS:
            return None
        from mechsim.numerics.banded import band

        stated = pivot_columns(self.null_space)[0][: self.nullity] if self.nullity else ()
        return band(sparse(self.reference)[1], self.rows, self.loops.unknown, stated)

    @property
    def numbers(self) -> int:
        """Count of the numbers of a Jacobian."""
        return self.loops.rows * self.loops.count if self.band is None else self.band.numbers

    def linearise(self, q: Q) -> Linearised:
        """Return the loops about n sets of coordinates."""
        loops: Any = self.loops
        residual, derivatives, poses = (loops.linearise if self.band is None else loops.sparse)(q)
        n, u, r = len(q), len(loops.unknown), len(self.rows)
        right, border = np.empty((n, u), residual.dtype), None
        right[:, :r] = residual[self.rows].T
        if self.nullity:
            reference = self.reference.repeated(n // len(self.reference))
            right[:, r:], border = loops.along(q, reference, self.null_space)
        if self.band is not None:
            from mechsim.numerics.banded import BandedSystems

            systems = BandedSystems(self.band, derivatives.values[self.band.entries], border)
        else:
            systems = np.empty((n, u, u), residual.dtype)
            systems[:, :r] = derivatives.take(self.rows, 0).take(loops.unknown, 1).transpose(2, 0, 1)
            if border is not None:
                systems[:, r:] = border
        return Linearised(residual, derivatives, poses, systems, right, loops.unknown, self.others)

    def retract(self, q: Q, step: Array) -> Q:
        """Return configurations displaced by steps of the unknowns, (n, u)."""
        return self.loops.displaced(q, self.whole_step(step))

    def whole_step(self, step: Array) -> Array:
        """Return steps of all coordinates, (count, n), from steps of the unknowns, (n, u)."""
        out = np.zeros((self.loops.count, len(step)), step.dtype)
        out[self.loops.unknown] = step.T
        return out

    def step(self, matrix: Array, rhs: Array) -> Array:
        """Return the step of all coordinates, (count, n), that removes residuals `rhs`, (n, u)."""
        return self.whole_step(-square_solution(matrix, rhs))


@dataclass(frozen=True)
class LoopSystem(Generic[Q]):
    """All loop equations in some coordinates, for `newton.newton`.

    Attributes:
        loops: the equations.
        free: indices of the coordinates that can change, (free,).
    """

    loops: DrivenEquations
    free: NDArray[np.intp]

    def linearise(self, q: Q, /) -> LinearEquations:
        """Return the equations linearised about n configurations."""
        residual, jacobian, _ = self.loops.linearise(q)
        return LinearEquations(residual.T, jacobian[:, self.free].transpose(2, 0, 1))

    def retract(self, q: Q, step: Array, /) -> Q:
        """Return configurations displaced by steps of the free coordinates, (n, free)."""
        displacement = np.zeros((self.loops.count, len(step)))
        displacement[self.free] = step.T
        return self.loops.displaced(q, displacement)


def loop_solver(
    loops: E, reference: Q, previous: Array | None = None, jacobian: Array | None = None
) -> LoopSolver[E, Q]:
    """Return the solver for poses near a reference.

    Args:
        loops: the loop equations.
        reference: closed coordinates at a regular pose: one set, or one for each design. The first set is
            used for the selection.
        previous: previous null-space basis, to which the new one is aligned.
        jacobian: Jacobian of all equations at the reference, (rows, count, 1), if known.
    """
    matrix = (loops.linearise(reference)[1] if jacobian is None else jacobian)[:, loops.unknown, 0]
    if not matrix.size:
        return LoopSolver(loops, np.zeros(0, dtype=np.intp), np.eye(len(loops.unknown)), reference)
    values, vh = right_vectors(matrix)
    rank = int(significant(values).sum())
    order, _ = pivot_columns(matrix.T)
    null_space = vh[rank:]
    if previous is not None and previous.shape == null_space.shape:
        u, _, rotation = np.linalg.svd(previous @ null_space.T)
        null_space = u @ rotation @ null_space
    return LoopSolver(loops, np.sort(order[:rank]), null_space, reference)
