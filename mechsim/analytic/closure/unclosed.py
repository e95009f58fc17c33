"""Newton's method for loops that are put together, and what is said where they do not close."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.telling import least_part
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates, placed

# Newton steps before giving up, the longest turn of one in [rad], and a gap that is closed
MOST_STEPS, LONGEST, CLOSED = 60, 0.5, 1e-12
# by which part of a gap its loop moves that does not move that way at all; how far away another pose is,
# in [rad] and parts of the size; and the part of a gap that is told
STILL, ASIDE, SEEN = 1e-6, 0.3, 1e-3
# a gap that is rounding
ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


def drawn_together(loops: TreeLoops, at: Coordinates) -> tuple[Coordinates, float]:
    """Return coordinates in which the loops close nearest to some, and by how much they still stand open.

    What is prescribed stands still. The gap is in parts of the size; no more than `CLOSED` is none.
    """
    before = gap = np.inf
    for _ in range(MOST_STEPS):
        residual, slope, _ = loops.linearise(at)
        gap = float(np.abs(residual).max(initial=0.0))
        if gap <= ROUNDING or (gap < CLOSED and gap > 0.25 * before):
            break
        before = gap
        step = np.zeros((loops.tree.count, 1))
        if len(loops.unknown):
            matrix = slope[:, loops.unknown, 0]
            step[loops.unknown, 0] = -np.linalg.lstsq(
                matrix, residual[:, 0], rcond=float(least_part(matrix))
            )[0]
        step *= LONGEST / max(LONGEST, float(np.abs(step).max(initial=0.0)))
        at = loops.moved(at, step)
    return at, gap


def why_unclosed(loops: TreeLoops, begun: Coordinates, left: Coordinates, gap: float) -> str:
    """Return in one sentence by how much loops stand open, and where their drivers would let them close.

    Args:
        loops: of the mechanism.
        begun: coordinates from which they were to be closed.
        left: those in which they were left.
        gap: by which they then stood open, in parts of the size.
    """
    mechanism = loops.tree.mechanism
    said = (
        f"{mechanism.name}: the loops do not close at {_stands(loops, left)}: a gap of {gap:.3g} of the "
        f"longest link is left after {MOST_STEPS} Newton steps"
    )
    freed = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    near, open_by = drawn_together(freed, begun)
    if open_by < CLOSED:
        near_by = f"from the guess they close at {_stands(loops, near)}"
        return f"{said}; {near_by}: start there, or change the dimensions"
    if across := _across(freed, near):
        return f"{said}, for {across}; move one of its points by that"
    return (
        f"{said}, and from the guess {_widest(freed, near)} stays open wherever the drivers stand; change "
        "the dimensions, where the drivers start, or the guess"
    )


def _stands(loops: TreeLoops, at: Coordinates) -> str:
    tree = loops.tree
    names = tree.mechanism.drivers
    return ", ".join(
        f"{name} = {at.values[tree.places[name], 0]:.6g} {'m' if tree.slides[tree.places[name]] else 'rad'}"
        for name in names
    )


def _across(loops: TreeLoops, at: Coordinates) -> str:
    """Return which joint stands open most where nothing in its loop moves, and which way; empty for none."""
    residual, slope, _ = loops.linearise(at)
    # not in this pose alone, as all ways but one of a linkage that is stretched
    aside = loops.moved(at, ASIDE * (1.0 + 0.3 * np.arange(loops.tree.count))[:, None] / loops.tree.count)
    slopes = np.concatenate([slope, loops.linearise(aside)[1]], -1)
    here, first, widest, said = placed(loops.tree, at), 0, CLOSED, ""
    for cut in loops.cuts:
        rows = slice(first, first + len(cut.lengths))
        first += cut.rows
        gap = residual[rows, 0]
        far = float(np.linalg.norm(gap))
        if far > widest and np.abs(np.tensordot(gap, slopes[rows], 1)).max(initial=0.0) < STILL * far:
            way = cut.frames(here)[1][:, cut.lengths, 0] @ gap * cut.size
            along = ", ".join(
                f"{part:.3g}" for part in np.where(np.abs(way) < SEEN * np.abs(way).max(), 0.0, way)
            )
            widest, said = far, f"{cut.joint.name} stays open by ({along}) m, where nothing in its loop moves"
    return said


def _widest(loops: TreeLoops, at: Coordinates) -> str:
    """Return the joint or coupling whose rows stand open most."""
    residual = np.abs(loops.linearise(at)[0][:, 0])
    names = [cut.joint.name for cut in loops.cuts for _ in range(cut.rows)]
    names += [row.coupling.name for row in loops.couplings]
    return names[int(residual.argmax())]
