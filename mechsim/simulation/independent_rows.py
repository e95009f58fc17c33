"""Which constraints of a model are independent: read from one Jacobian, checked on the others."""

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE


class IndependentRows:
    """The independent constraints of a model, as of the first Jacobian that is asked for.

    The third equation of a planar loop is redundant in every pose. In an overconstrained loop such as
    Bennett's, which equations are redundant changes from pose to pose.

    Attributes:
        basis: of the independent constraints (m, rank), of the redundant ones, and of the row space, which
            leaves out unconstrained DOFs, (rank, nv - 1); None before the first Jacobian.
    """

    def __init__(self, basis: tuple[Array, Array, Array] | None = None):
        self.basis = basis
        self._log_scale: float | None = None

    @property
    def row_space(self) -> Array:
        """A basis of the row space, (rank, nv - 1)."""
        assert self.basis is not None
        return self.basis[2]

    def basis_of(self, matrix: Array) -> Array | None:
        """Return the basis of independent constraints, (m, rank); None if it changes with the pose."""
        if self.basis is None:
            # a model may have thousands of unconstrained DOFs, of which no basis is needed
            u, values, vh = np.linalg.svd(matrix[0], full_matrices=matrix.shape[1] > matrix.shape[2])
            rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
            self.basis = u[:, :rank], u[:, rank:], vh[:rank]
        rows, redundant, _ = self.basis
        ignored = np.abs(redundant.T @ matrix).max(initial=0.0)
        return None if ignored > RANK_TOLERANCE * np.abs(matrix).max(initial=0.0) else rows

    def square(self, matrix: Array, rows: Array) -> Array:
        """Return the square Jacobian of independent constraints, (n, rank, rank)."""
        return (rows.T @ matrix) @ self.row_space.T

    def scaled(self, log_values: Array) -> Array:
        """Return determinants, (n,), from their logarithms, in units of the first one that was computed."""
        if self._log_scale is None:
            self._log_scale = float(log_values[0]) if np.isfinite(log_values[0]) else 0.0
        return np.exp(np.minimum(log_values - self._log_scale, 300.0))
