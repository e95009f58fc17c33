"""Best (Chebyshev) approximation: unknowns that keep the greatest of many errors least, and a circle so."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True)
class Best:
    """The unknowns x that make the greatest |right - rows x| least.

    Attributes:
        x: (3,).
        error: right - rows x, (n,).
        level: its greatest size.
        active: the rows, four as a rule, that hold the solution in place, rising.
    """

    x: Array
    error: Array
    level: float
    active: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Circle:
    """The circle that points keep to best.

    Attributes:
        centre: (2,) in [m].
        radius: in [m].
        error: |B - centre|2 - radius2 at every point, (n,) in [m2].
        level: its greatest size.
        alternation: the points, four as a rule, that hold the solution in place, rising.
    """

    centre: Array
    radius: float
    error: Array
    level: float
    alternation: tuple[int, ...]


def best_circle(points: Array) -> Circle:
    """Return the circle whose error |B - m|2 - r2 is least at its greatest.

    Args:
        points: B, (n, 2) in [m].

    Raises:
        AssemblyError: where the best "circle" has no real radius.
    """
    origin = points.mean(0)
    best = least_worst(*circle_rows(points - origin))
    centre, radius = circle_of(best.x)
    return Circle(origin + centre, radius, best.error, best.level, best.active)


def circle_rows(points: Array) -> tuple[Array, Array]:
    """Return rows, (n, 3), and right side, (n,), of |B - m|2 - r2 = right - rows x for x = (m, r2 - m2)."""
    return np.column_stack([2.0 * points, np.ones(len(points))]), (points**2).sum(1)


def circle_of(x: Array) -> tuple[Array, float]:
    """Return centre, (2,), and radius of the circle with x = (m, r2 - m2), as `circle_rows` has it."""
    radius2 = float(x[2] + x[:2] @ x[:2])
    if not radius2 > 0.0:
        raise AssemblyError("the circle that fits the rocker's end best has no real radius")
    return x[:2], float(np.sqrt(radius2))


def least_worst(rows: Array, right: Array) -> Best:
    """Return the x whose greatest |right - rows x| is least, by a linear programme.

    Args:
        rows: (n, 3).
        right: (n,).

    Raises:
        AssemblyError: where the programme has no solution.

    Accuracy: the programme is solved in an orthonormal basis and in units of the error itself, then its
    active rows exactly, so that nothing of the solver's tolerance (1e-7) is left.
    """
    from scipy.optimize import linprog

    basis, change = np.linalg.qr(rows)
    q = basis.T @ right
    residual = right - basis @ q
    unit = float(np.abs(residual).max())
    active = np.arange(0)
    if unit > 1e-14 * float(np.abs(right).max()):
        unit_column = np.ones((len(rows), 1))
        best = linprog(
            [0.0, 0.0, 0.0, 1.0],
            A_ub=np.block([[-basis, -unit_column], [basis, -unit_column]]),
            b_ub=np.concatenate([-residual, residual]) / unit,
            bounds=[(None, None)] * 3 + [(0.0, None)],
            method="highs",
        )
        if best.x is None:
            raise AssemblyError(f"the linear programme for the rocker has no solution: {best.message}")
        active, extra = _exact(basis, residual / unit, best)
        q = q + unit * extra
    error = right - basis @ q
    x = np.asarray(np.linalg.solve(change, q), dtype=np.float64)
    return Best(x, error, float(np.abs(error).max()), tuple(active.tolist()))


def _exact(rows: Array, right: Array, best: Any) -> tuple[NDArray[np.intp], Array]:
    """Return the active points of a linear programme and its solution from them alone."""
    x: Array = best.x
    duals: Array = np.abs(best.ineqlin.marginals)
    n = len(rows)
    active = np.unique(np.argsort(-duals)[:4] % n)
    error = right - rows @ x[:3]
    if len(active) == 4:
        square = np.column_stack([rows[active], np.sign(error[active])])
        q = np.asarray(np.linalg.solve(square, right[active]), dtype=np.float64)
        if np.abs(right - rows @ q[:3]).max() <= np.abs(error).max() * (1.0 + 1e-6):
            return active, q[:3]
    return active, x[:3]
