"""Redundant drivers: more drivers than degrees of freedom. They are reported, not forced."""

import numpy as np

from mechsim.analytic.loops.exact_geometry import DIMENSION_TOLERANCE
from mechsim.analytic.loops.generic_pose import generic_poses, null_spaces, with_coordinate_locked
from mechsim.analytic.loops.loop_solver import LoopSolver
from mechsim.analytic.loops.numerical_rank import RANK_TOLERANCE, rank, significant
from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.errors import MobilityError
from mechsim.numerics.arrays import Array

# smallest participation of a coordinate in a degree of freedom; and residual of closed loops
MIN_PARTICIPATION, CLOSED = 1e-7, 1e-10
# largest number of listed drivers, and smallest share of a loop in dependent rows for it to be named
LISTED, MIN_SHARE = 12, 0.1


def require_no_redundant_drivers(solver: LoopSolver) -> None:
    """Reject drivers and locked joints that those before them determine already.

    Args:
        solver: of the mechanism's loops, about coordinates closed or nearly so; what cannot be closed at all
            is left to others.

    Raises:
        MobilityError: naming them.
    """
    loops, start = solver.loops, solver.reference
    if rank(solver.at_reference.jacobian[..., 0]) == len(solver.rows):
        return
    # at a dead centre a single crank cannot move either: another pose decides
    (q,) = generic_poses(loops, start, 1, RANK_TOLERANCE)
    if not np.abs(loops.linearise(q)[0]).max(initial=0.0) < CLOSED:
        return
    mechanism = loops.tree.mechanism
    independent, redundant = _independent_drivers(loops, null_spaces(loops, q, RANK_TOLERANCE)[1])
    locked = [
        name
        for name in redundant
        if name
        in _independent_drivers(loops, null_spaces(loops, q, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)[1])[0]
    ]
    if locked:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {', '.join(locked)} cannot move, for "
            f"{' and '.join(_nearly_dependent_joints(loops, q))} ask for the same but for less than "
            f"{DIMENSION_TOLERANCE:g} of the size, and lock each other; make one of them "
            "inactive, or its dimensions exact",
            "overdetermined",
        )
    if redundant and not independent:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: joints and couplings leave {', '.join(redundant)} no "
            "freedom; leave one of them out, or change a ratio or a dimension by which they disagree",
            "overdetermined",
        )
    if redundant:
        listed = ", ".join(independent) if len(independent) <= LISTED else f"{len(independent)} others"
        determine = f"{listed} settle{'s' if len(independent) == 1 else ''}"
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {determine} {', '.join(redundant)} already; drive or hold no "
            f"more joints than {len(independent)}, as in --drive {independent[0]}=PROGRAM",
            "overdetermined",
        )


def _independent_drivers(loops: TreeLoops, freedoms: Array) -> tuple[list[str], list[str]]:
    """Return the independent drivers and locked joints, and the redundant ones, in their order."""
    mechanism = loops.tree.mechanism
    independent: list[str] = []
    redundant: list[str] = []
    for name, index in zip((*mechanism.drivers, *mechanism.locked), loops.driven, strict=True):
        if len(freedoms) and float(np.linalg.norm(freedoms[:, index])) > MIN_PARTICIPATION:
            freedoms = with_coordinate_locked(freedoms, index)
            independent.append(name)
        else:
            redundant.append(name)
    return independent, redundant


def _nearly_dependent_joints(loops: TreeLoops, q: Coordinates) -> list[str]:
    """Return the names of the cut joints whose constraint equations are nearly dependent."""
    u, values, _ = np.linalg.svd(loops.linearise(q)[1][..., 0], full_matrices=False)
    share = np.abs(
        u[:, significant(values) & ~significant(values, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)]
    ).max(1, initial=0.0)
    loop_of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    largest = share[: len(loop_of)].max(initial=0.0)
    indices = loop_of[share[: len(loop_of)] > MIN_SHARE * largest].tolist()
    return [loops.cuts[i].joint.name for i in dict.fromkeys(indices)] or ["couplings"]
