"""Drivers that are more than there are freedoms: they are named, not forced."""

import numpy as np

from mechsim.analytic.closure.exact_geometry import DIGITS
from mechsim.analytic.closure.generic_pose import generic_poses, held, idle_and_free
from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.telling import RANK_TOLERANCE, rank, telling
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import MobilityError
from mechsim.maths.arrays import Array

# a coordinate that takes part in a freedom by less takes none; and a residual that is closed
PART, CLOSED = 1e-7, 1e-10
# drivers that are listed, and the part in a sum of rows from which a loop is named
LISTED, NAMED = 12, 0.1


def require_drivable(solver: LoopSolver) -> None:
    """Refuse drivers and holds that those before them settle already.

    Args:
        solver: of the mechanism's loops, about coordinates closed or nearly so; what cannot be closed at all
            is left to others.

    Raises:
        MobilityError: naming them.
    """
    loops, start = solver.loops, solver.pinned
    if rank(solver.there.slope[..., 0]) == len(solver.rows):
        return
    # at a dead centre a lone crank cannot move either: another pose tells
    (at,) = generic_poses(loops, start, 1, RANK_TOLERANCE)
    if not np.abs(loops.linearise(at)[0]).max(initial=0.0) < CLOSED:
        return
    mechanism = loops.tree.mechanism
    enough, more = _shared(loops, idle_and_free(loops, at, RANK_TOLERANCE)[1])
    locked = [name for name in more if name in _shared(loops, idle_and_free(loops, at, DIGITS, DIGITS)[1])[0]]
    if locked:
        raise MobilityError(
            f"{mechanism.name}: overdriven: {', '.join(locked)} cannot move, for "
            f"{' and '.join(_nearly(loops, at))} ask for the same but for less than {DIGITS:g} of the size, "
            "and lock each other; make one of them inactive, or its dimensions exact",
            "overdriven",
        )
    if more and not enough:
        raise MobilityError(
            f"{mechanism.name}: overdriven: joints and couplings leave {', '.join(more)} no freedom; leave "
            "one of them out, or change a ratio or a dimension by which they disagree",
            "overdriven",
        )
    if more:
        told = ", ".join(enough) if len(enough) <= LISTED else f"{len(enough)} others"
        settle = f"{told} settle{'s' if len(enough) == 1 else ''}"
        raise MobilityError(
            f"{mechanism.name}: overdriven: {settle} {', '.join(more)} already; drive or hold no more joints "
            f"than {len(enough)}, as in --drive {enough[0]}=PROGRAM",
            "overdriven",
        )


def _shared(loops: TreeLoops, freedoms: Array) -> tuple[list[str], list[str]]:
    """Return which drivers and holds share freedoms, one each, and which are more, in their order."""
    mechanism = loops.tree.mechanism
    enough: list[str] = []
    more: list[str] = []
    for name, place in zip((*mechanism.drivers, *mechanism.locked), loops.driven, strict=True):
        if len(freedoms) and float(np.linalg.norm(freedoms[:, place])) > PART:
            freedoms = held(freedoms, place)
            enough.append(name)
        else:
            more.append(name)
    return enough, more


def _nearly(loops: TreeLoops, at: Coordinates) -> list[str]:
    """Return the names of the joints that close loops whose rows nearly repeat one another."""
    left, values, _ = np.linalg.svd(loops.linearise(at)[1][..., 0], full_matrices=False)
    share = np.abs(left[:, telling(values) & ~telling(values, DIGITS, DIGITS)]).max(1, initial=0.0)
    of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    most = share[: len(of)].max(initial=0.0)
    told = of[share[: len(of)] > NAMED * most].tolist()
    return [loops.cuts[i].joint.name for i in dict.fromkeys(told)] or ["couplings"]
