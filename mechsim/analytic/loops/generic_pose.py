"""Poses that are no special ones: where ranks say what is true of a mechanism and not of one pose."""

import numpy as np

from mechsim.analytic.loops.numerical_rank import FLOOR, relative_cutoff, significant
from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.numerics.arrays import Array

# displacement from one pose to the next, in radians or parts of the size
SPACING = 0.15
# Newton steps to a pose, the longest turn of one in [rad], and one so short that rounding is left
MOST_STEPS, MAX_STEP, LAST_STEP = 40, 0.3, 1e-9


def generic_poses(
    loops: TreeLoops, start: Coordinates, count: int, tolerance: float, floor: float = FLOOR
) -> list[Coordinates]:
    """Return poses near a start, one after the other, drivers and holds as free as the rest.

    Args:
        loops: of the mechanism.
        start: one set of coordinates, closed or nearly so.
        count: of poses.
        tolerance: singular values below this part of the largest are nought.
        floor: so are those below it.
    """
    random, q = np.random.default_rng(7), nearest_consistent(loops, start, tolerance, floor)
    poses: list[Coordinates] = []
    for _ in range(count):
        freedoms = null_spaces(loops, q, tolerance, floor)[1]
        step = freedoms.T @ random.standard_normal(len(freedoms))
        longest = float(np.abs(step).max(initial=0.0))
        if longest > 0.0:
            q = nearest_consistent(
                loops, loops.displaced(q, (step * SPACING / longest)[:, None]), tolerance, floor
            )
        poses.append(q)
    return poses


def nearest_consistent(
    loops: TreeLoops, q: Coordinates, tolerance: float, floor: float = FLOOR
) -> Coordinates:
    """Return where no step in what the rows tell makes the loops stand less open."""
    previous = np.inf
    for _ in range(MOST_STEPS):
        residual, jacobian, _ = loops.linearise(q)
        matrix = jacobian[..., 0]
        correction = np.linalg.lstsq(
            matrix, residual[:, 0], rcond=float(relative_cutoff(matrix, tolerance, floor))
        )[0]
        step = np.asarray(-correction, dtype=np.float64)
        longest = float(np.abs(step).max(initial=0.0))
        if longest == 0.0 or (longest < LAST_STEP and longest > 0.25 * previous):
            break
        previous = longest
        q = loops.displaced(q, (step * min(1.0, MAX_STEP / longest))[:, None])
    return q


def null_spaces(
    loops: TreeLoops, q: Coordinates, tolerance: float, floor: float = FLOOR
) -> tuple[Array, Array]:
    """Return sums of rows that tell nothing, (rows, m), and the freedoms of all coordinates, (f, count)."""
    left, values, right = np.linalg.svd(loops.linearise(q)[1][..., 0])
    rank = int(significant(values, tolerance, floor).sum())
    return left[:, rank:], right[rank:]


def with_coordinate_locked(freedoms: Array, coordinate: int) -> Array:
    """Return the freedoms in which a coordinate that has part in them does not move, one fewer."""
    component = freedoms[:, coordinate]
    rows = np.flatnonzero(component)
    # a reflection puts all of the coordinate's part into the first of them
    mirror = component[rows]
    mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
    reflected = np.outer(2.0 / (mirror @ mirror) * mirror[1:], mirror @ freedoms[rows])
    remaining = np.delete(freedoms, rows[0], 0)
    remaining[rows[1:] - 1] -= reflected
    return remaining
