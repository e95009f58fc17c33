"""Which joints the crank leaves open: the loop equations do not invent their motion."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.loop_solver import loop_solver
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates, Placed, placed
from mechsim.errors import MobilityError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import GROUND

# displacement along a freedom, in radians or parts of the size; a residual that is closed; and the part of
# the displacement by which a joint or a point is seen to move
NUDGE, CLOSED, SEEN = 1e-3, 1e-10, 1e-2


def require_determined(loops: TreeLoops, start: Coordinates) -> None:
    """Refuse a mechanism whose crank does not settle it; idle freedoms, such as a rod's spin, are none.

    Raises:
        MobilityError: with the joints and points left open.
    """
    names: list[str] = []
    solver = loop_solver(loops, start)
    for freedom in solver.gauge:
        step = np.zeros((loops.tree.count, 1))
        step[loops.unknown, 0] = NUDGE * freedom
        nudged = loops.moved(start, step)
        try:
            there, found, _ = replace(solver, pinned=nudged).close(nudged)
        except np.linalg.LinAlgError:
            continue
        # at a singular pose the loops draw it back
        if np.abs(found.residual).max(initial=0.0) < CLOSED:
            names += _seen(loops, start, there)
    if names:
        raise MobilityError(
            f"{loops.tree.mechanism.name}: undetermined: with the crank held "
            f"{', '.join(dict.fromkeys(names))} can still move; drive, hold or couple them",
            "undetermined",
        )


def _seen(loops: TreeLoops, before: Coordinates, after: Coordinates) -> list[str]:
    """Return the joints and tracked points that differ between two poses."""
    tree = loops.tree
    gone = np.abs(after.values - before.values)[:, 0] / loops.units
    names = [f"joint {name!r}" for name, place in tree.places.items() if gone[place] > SEEN * NUDGE]
    here, there = (_points(loops, placed(tree, at)) for at in (before, after))
    far = SEEN * NUDGE * tree.mechanism.size
    return names + [f"point {name}" for name, at in here.items() if np.abs(there[name] - at).max() > far]


def _points(loops: TreeLoops, at: Placed) -> Mapping[str, Array]:
    tree = loops.tree
    return {
        name: at.position[tree.links[link], :, 0] + at.rotation[tree.links[link], :, :, 0] @ np.array(local)
        for name, (link, local) in tree.mechanism.points.items()
        if link != GROUND
    }
