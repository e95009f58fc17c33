"""Drivers that are more than there are freedoms: they are named, not forced."""

import numpy as np

from mechsim.analytic.closure.generic_pose import generic_poses, held, idle_and_free
from mechsim.analytic.closure.telling import RANK_TOLERANCE, rank
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import MobilityError

# a coordinate that takes part in a freedom by less takes none; and a residual that is closed
PART, CLOSED = 1e-7, 1e-10


def require_drivable(loops: TreeLoops, start: Coordinates) -> None:
    """Refuse drivers and holds that those before them settle already.

    Args:
        loops: of the mechanism.
        start: its coordinates, closed or nearly so; what cannot be closed at all is left to others.

    Raises:
        MobilityError: naming them.
    """
    slope = loops.linearise(start)[1][..., 0]
    if rank(slope) == rank(slope[:, loops.unknown]):
        return
    # at a dead centre a lone crank cannot move either: another pose tells
    (at,) = generic_poses(loops, start, 1, RANK_TOLERANCE)
    if not np.abs(loops.linearise(at)[0]).max(initial=0.0) < CLOSED:
        return
    freedoms = idle_and_free(loops, at, RANK_TOLERANCE)[1]
    mechanism = loops.tree.mechanism
    enough: list[str] = []
    more: list[str] = []
    for name, place in zip((*mechanism.drivers, *mechanism.holds), loops.driven, strict=True):
        if len(freedoms) and float(np.linalg.norm(freedoms[:, place])) > PART:
            freedoms = held(freedoms, place)
            enough.append(name)
        else:
            more.append(name)
    if more and not enough:
        raise MobilityError(
            f"{mechanism.name}: overdriven: joints and couplings leave {', '.join(more)} no freedom; leave "
            "one of them out, or change a ratio or a dimension by which they disagree",
            "overdriven",
        )
    if more:
        settle = f"{', '.join(enough)} settle{'s' if len(enough) == 1 else ''}"
        raise MobilityError(
            f"{mechanism.name}: overdriven: {settle} {', '.join(more)} already; drive or hold no more joints "
            f"than {len(enough)}, as in --drive {enough[0]}=PROGRAM",
            "overdriven",
        )
