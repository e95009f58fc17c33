"""Detection of unbounded curves of assemblies, which never return to their start, while they are traced."""

import numpy as np

from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN

# limits for a closed curve: displacement in characteristic lengths, and revolutions of a multi-turn angle
# (one in a coupling, as a screw's)
MAX_DISPLACEMENT, MAX_REVOLUTIONS = 1000, 100


def require_return(loops: TreeLoops, initial: Coordinates, current: Coordinates) -> None:
    """Reject a curve whose displacement or multi-turn angle is too large for a closed curve.

    Args:
        loops: of the mechanism.
        initial: coordinates at the start of the curve.
        current: coordinates at the present point.

    Raises:
        AssemblyError: naming the coordinate.
    """
    tree, counted = loops.tree, np.zeros(loops.tree.count, dtype=np.bool_)
    for coupling in loops.couplings:
        counted |= (not coupling.turns) & ((coupling.left != 0.0) | (coupling.right != 0.0))
    displacement = np.abs(current.values - initial.values)[:, 0] / loops.units
    limit = np.where(tree.slides, MAX_DISPLACEMENT, np.where(counted, MAX_REVOLUTIONS * TURN, np.inf))
    index = int(np.argmax(displacement / limit)) if len(displacement) else 0
    if not len(displacement) or displacement[index] < limit[index]:
        return
    name = next(coordinate for coordinate, address in tree.index_of.items() if address == index)
    reason = (
        f"has moved by {MAX_DISPLACEMENT:,} times the characteristic length {tree.size:.4g} m"
        if tree.slides[index]
        else f"has made {MAX_REVOLUTIONS} revolutions, and its value is multi-turn"
    )
    raise AssemblyError(
        f"{tree.mechanism.name}: the curve of assemblies is not closed: {name} {reason}; solve or simulate "
        "it over the range you need, or limit the coordinate by links"
    )
