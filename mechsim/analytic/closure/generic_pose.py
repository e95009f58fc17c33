"""Poses that are no special ones: where ranks say what is true of a mechanism and not of one pose."""

import numpy as np

from mechsim.analytic.closure.telling import FLOOR, least_part, telling
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.maths.arrays import Array

# displacement from one pose to the next, in radians or parts of the size
APART = 0.15
# Newton steps to a pose, the longest turn of one in [rad], and one so short that rounding is left
MOST_STEPS, LONGEST, SHORT = 40, 0.3, 1e-9


def generic_poses(
    loops: TreeLoops, start: Coordinates, count: int, told: float, floor: float = FLOOR
) -> list[Coordinates]:
    """Return poses near a start, one after the other, drivers and holds as free as the rest.

    Args:
        loops: of the mechanism.
        start: one set of coordinates, closed or nearly so.
        count: of poses.
        told: singular values below this part of the largest are nought.
        floor: so are those below it.
    """
    random, at = np.random.default_rng(7), settled(loops, start, told, floor)
    found: list[Coordinates] = []
    for _ in range(count):
        free = idle_and_free(loops, at, told, floor)[1]
        step = free.T @ random.standard_normal(len(free))
        longest = float(np.abs(step).max(initial=0.0))
        if longest > 0.0:
            at = settled(loops, loops.moved(at, (step * APART / longest)[:, None]), told, floor)
        found.append(at)
    return found


def settled(loops: TreeLoops, at: Coordinates, told: float, floor: float = FLOOR) -> Coordinates:
    """Return where no step in what the rows tell makes the loops stand less open."""
    before = np.inf
    for _ in range(MOST_STEPS):
        residual, slope, _ = loops.linearise(at)
        matrix = slope[..., 0]
        least = np.linalg.lstsq(matrix, residual[:, 0], rcond=float(least_part(matrix, told, floor)))[0]
        step = np.asarray(-least, dtype=np.float64)
        longest = float(np.abs(step).max(initial=0.0))
        if longest == 0.0 or (longest < SHORT and longest > 0.25 * before):
            break
        before = longest
        at = loops.moved(at, (step * min(1.0, LONGEST / longest))[:, None])
    return at


def idle_and_free(
    loops: TreeLoops, at: Coordinates, told: float, floor: float = FLOOR
) -> tuple[Array, Array]:
    """Return sums of rows that tell nothing, (rows, m), and the freedoms of all coordinates, (f, count)."""
    left, values, right = np.linalg.svd(loops.linearise(at)[1][..., 0])
    rank = int(telling(values, told, floor).sum())
    return left[:, rank:], right[rank:]


def held(freedoms: Array, coordinate: int) -> Array:
    """Return the freedoms in which a coordinate that has part in them does not move, one fewer."""
    part = freedoms[:, coordinate]
    rows = np.flatnonzero(part)
    # a reflection puts all of the coordinate's part into the first of them
    mirror = part[rows]
    mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
    turned = np.outer(2.0 / (mirror @ mirror) * mirror[1:], mirror @ freedoms[rows])
    found = np.delete(freedoms, rows[0], 0)
    found[rows[1:] - 1] -= turned
    return found
