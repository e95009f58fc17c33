"""How far recorded states are from the poses solved at their crank angles; whether they left the assembly."""

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.motion import Motion
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.poses import follow

# a pose this much nearer than the right one, and in units of the stroke this far from it, is another
# assembly; it is looked for at so many pairs of records. Places are rounded by this part of the size at the
# most, which of a motion of next to nothing is more
NEARER, APART, MOST_PAIRS, ROUNDING = 0.5, 0.02, 100, 1e-12


def pose_errors(closed: ClosedModel, motion: Motion, states: Array) -> tuple[Array, Array]:
    """Return how far the farthest tracked point is from its place in the solved pose, and those places.

    A point that the crank leaves free, as of a body beside the linkage, belongs where the closed loops
    nearest to the recorded state put it.

    Args:
        closed: the model.
        motion: at n instants.
        states: at the same instants, (n, nq).

    Returns:
        Distances in [m], (n,), infinite from the first crank angle on that has no pose; and the places
        before that, (known, k, 3) in [m].
    """
    places = closed.point_positions(_solved_poses(closed, states))
    if closed.undetermined_points.any():
        try:
            nearest = closed.point_positions(closed.loops.close(states[: len(places)]))
            places[:, closed.undetermined_points] = nearest[:, closed.undetermined_points]
        except AssemblyError:
            places[:, closed.undetermined_points] = np.inf
    error = np.full(len(states), np.inf)
    error[: len(places)] = _distances(_recorded(motion)[: len(places)], places)
    return error, places


def lag_distance(closed: ClosedModel, motion: Motion, angles: Array) -> float:
    """Return how far driven points are from the poses solved at other angles than they reached, in [m].

    Args:
        closed: the model.
        motion: at n instants.
        angles: of the crank or clock at these instants, (n,) in [rad].
    """
    meant, moved = closed.point_positions(follow.follow(closed.loops, closed.qpos, angles)), _is_driven(closed)
    return float(_distances(_recorded(motion)[:, moved], meant[:, moved]).max())


def in_another_assembly(
    closed: ClosedModel, motion: Motion, states: Array, error: Array, places: Array
) -> bool:
    """Say whether two records in a row, both far off, lie in another assembly, not in none.

    Args:
        closed: the model.
        motion: at n instants.
        states: at the same instants, (n, nq).
        error: as from `pose_errors`.
        places: as from `pose_errors`.
    """
    known, recorded = len(places), _recorded(motion)
    stroke = float(np.ptp(places[:, _is_driven(closed)], axis=0).max())
    far = error[:known] > max(APART * 0.5 * stroke, ROUNDING * closed.loops.characteristic_length)
    pairs = np.flatnonzero(far[1:] & far[:-1])
    tried = pairs[np.unique(np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int))] if len(pairs) else []
    for i in tried:
        both = slice(i, i + 2)
        try:
            nearest = closed.loops.close(states[both])
        except AssemblyError:
            continue
        if (_distances(recorded[both], closed.point_positions(nearest)) < NEARER * error[both]).all():
            return True
    return False


def _solved_poses(closed: ClosedModel, states: Array) -> Array:
    """Return the poses solved at the crank angles of states, from the first to the last that has one.

    A crank that the linkage drove beyond a dead centre has none there. Under programs the drivers stand where
    they really were.
    """
    loops = closed.loops
    angles = states[:, loops.crank_address]
    count, known, beyond = len(angles), 1, len(angles) + 1
    true = states[:1]
    while beyond - known > 1:
        try:
            true = follow.follow(closed.loops, closed.qpos, angles[:count])
            known = count
        except AssemblyError:
            beyond = count
        count = (known + beyond) // 2
    if loops.drivers is not None:
        driven = states[: len(true), loops.drivers.addresses]
        true[:, loops.drivers.addresses] = driven
        true = loops.with_drivers_locked(driven.T).close(true)
    return true


def _distances(recorded: Array, places: Array) -> Array:
    """Return the distance of the farthest of points (n, k, 3) from their places, (n,); NaN is infinite."""
    gaps = np.sqrt(((recorded - places) ** 2).sum(-1)).max(1, initial=0.0)
    return np.where(np.isfinite(gaps), gaps, np.inf)


def _is_driven(closed: ClosedModel) -> list[bool]:
    """Say of each tracked point whether what is driven moves it."""
    return [name in closed.driven_points for name in closed.track.points]


def _recorded(motion: Motion) -> Array:
    """Return the places of all points of a motion, (n, k, 3)."""
    return np.stack([point.position for point in motion.points.values()], 1)
