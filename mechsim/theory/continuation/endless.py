"""Curves of assemblies that never come back to their start: told while they are walked, not at a far end."""

import numpy as np

from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import AssemblyError
from mechsim.maths.angles import TURN

# how far a displacement goes along a curve that closes, in sizes of the mechanism, and how often an angle
# turns whose turns a coupling counts, as a screw's
MOST_SIZES, MOST_TURNS = 1000, 100


def require_return(loops: TreeLoops, begin: Coordinates, at: Coordinates) -> None:
    """Refuse a curve that has run off, or wound up a screw, too far to be one that closes.

    Args:
        loops: of the mechanism.
        begin: one set of coordinates, where the curve began.
        at: likewise, where it has come to.

    Raises:
        AssemblyError: naming the coordinate.
    """
    tree, counted = loops.tree, np.zeros(loops.tree.count, dtype=np.bool_)
    for row in loops.couplings:
        counted |= (not row.turns) & ((row.left != 0.0) | (row.right != 0.0))
    gone = np.abs(at.values - begin.values)[:, 0] / loops.units
    most = np.where(tree.slides, MOST_SIZES, np.where(counted, MOST_TURNS * TURN, np.inf))
    far = int(np.argmax(gone / most)) if len(gone) else 0
    if not len(gone) or gone[far] < most[far]:
        return
    name = next(one for one, place in tree.index_of.items() if place == far)
    way = (
        f"has gone {MOST_SIZES:,} times the mechanism's size of {tree.size:.4g} m"
        if tree.slides[far]
        else f"has turned {MOST_TURNS} times, and its turns count"
    )
    raise AssemblyError(
        f"{tree.mechanism.name}: the curve of assemblies never closes: {name} {way}; solve or simulate it "
        "over the part that is wanted, or hold it within bounds by links"
    )
