"""The circle that keeps nearest to points at its worst: a linear programme."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Circle:
    """The circle that points keep to best.

    Attributes:
        centre: (2,) in [m].
        radius: in [m].
        error: |B - centre|2 - radius2 at every point, (n,) in [m2].
        level: its greatest size, weighted.
        alternation: the points, four as a rule, that hold the solution in place, rising.
    """

    centre: Array
    radius: float
    error: Array
    level: float
    alternation: tuple[int, ...]


def best_circle(points: Array, weights: Array) -> Circle:
    """Return the circle whose weighted error w (|B - m|2 - r2) is least at its greatest.

    Args:
        points: B, (n, 2) in [m].
        weights: w, (n,), positive.

    Raises:
        AssemblyError: where the best "circle" has no real radius.

    Accuracy: the programme is solved in an orthonormal basis and in units of the error itself, then its
    active points exactly, so that nothing of the solver's tolerance (1e-7) is left.
    """
    from scipy.optimize import linprog

    origin = points.mean(0)
    near = points - origin
    basis, change = np.linalg.qr(np.column_stack([2.0 * near, np.ones(len(near))]))
    goal = (near**2).sum(1)
    rough = goal - basis @ (basis.T @ goal)
    unit = float(np.abs(rough).max())
    if unit <= 1e-14 * float(goal.max()):
        active, q = np.arange(0), basis.T @ goal
    else:
        rows = weights[:, None] * basis
        ones, right = np.ones((len(near), 1)), weights * rough / unit
        best = linprog(
            [0.0, 0.0, 0.0, 1.0],
            A_ub=np.block([[-rows, -ones], [rows, -ones]]),
            b_ub=np.concatenate([-right, right]),
            bounds=[(None, None)] * 3 + [(0.0, None)],
            method="highs",
        )
        if best.x is None:
            raise AssemblyError(f"the linear programme for the rocker has no solution: {best.message}")
        active, q = _exact(rows, right, best)
        q = basis.T @ goal + unit * q
    p = np.linalg.solve(change, q)
    radius2 = float(p[2] + p[:2] @ p[:2])
    if not radius2 > 0.0:
        raise AssemblyError("the circle that fits the rocker's end best has no real radius")
    error = goal - basis @ q
    level = float(np.abs(weights * error).max())
    return Circle(origin + p[:2], float(np.sqrt(radius2)), error, level, tuple(active.tolist()))


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
