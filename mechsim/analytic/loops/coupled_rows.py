"""The equations of couplings in coordinates of a tree: one sum of coordinates as a polynomial of another."""

from dataclasses import dataclass

import numpy as np

from mechsim.analytic.loops.spanning_tree import SpanningTree
from mechsim.model.couplings import Coupling
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class CoupledRow:
    """One coupling: left - zeros[0] - p(right - zeros[1]) = 0.

    Attributes:
        coupling: of the mechanism.
        left: weights of the coordinates on its left side, (count,).
        right: likewise, on its right.
        unit: of the residual: 1 rad, or the mechanism's size in [m] where the left side is a length.
    """

    coupling: Coupling
    left: Array
    right: Array
    unit: float

    @property
    def turns(self) -> bool:
        """Whether whole turns between its sides do not count."""
        return self.coupling.turns

    def evaluate(self, values: Array) -> tuple[Array, Array, Array]:
        """Return residuals (n,), slopes by the coordinates (count, n) and p'' (n,), residuals in its unit."""
        value, first, second = self.coupling.polynomial(self.right @ values)
        residual = (self.left @ values - self.coupling.zeros[0] - value) / self.unit
        jacobian = (self.left[:, None] - self.right[:, None] * first) / self.unit
        return residual, jacobian, second

    def velocity_products(self, values: Array, rates: Array) -> Array:
        """Return the residuals' second rate at rates (count, n) that do not change, (n,)."""
        return -self.evaluate(values)[2] * (self.right @ rates) ** 2 / self.unit


def coupled_rows(tree: SpanningTree) -> tuple[CoupledRow, ...]:
    """Return the rows of all couplings of a mechanism."""
    rows: list[CoupledRow] = []
    for law in tree.mechanism.laws:
        left, right = (tree.coupled(terms) for terms in (law.left_terms, law.right_terms))
        has_length = bool(np.any(tree.slides & (left != 0.0)))
        rows.append(CoupledRow(law, left, right, tree.size if has_length else 1.0))
    return tuple(rows)
