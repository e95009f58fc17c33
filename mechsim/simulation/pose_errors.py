"""Distances of recorded states from the poses solved at their crank angles; changes of assembly."""

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.poses import follow

# a state is in another assembly if its distance from the nearest pose is below this fraction of its distance
# from the expected pose, and the latter is above this fraction of the half stroke; pairs of records that are
# tested; rounding of positions relative to the characteristic length, which decides for a tiny stroke
NEARER, APART, MOST_PAIRS, ROUNDING = 0.5, 0.02, 100, 1e-12


def pose_errors(closed: ClosedModel, motion: Motion, states: Array) -> tuple[Array, Array]:
    """Return the largest distance of a tracked point from its position in the solved pose, and the positions.

    The reference of a point that the crank does not determine is the closed pose nearest to the recorded
    state.

    Args:
        closed: the model.
        motion: at n instants.
        states: at the same instants, (n, nq).

    Returns:
        Distances in [m], (n,), infinite from the first crank angle on that has no pose; and the positions
        before that, (solved, k, 3) in [m].
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
    """Return the largest distance of a driven point from its pose at the prescribed angles, in [m].

    Args:
        closed: the model.
        motion: at n instants.
        angles: prescribed for the crank or the path parameter at these instants, (n,) in [rad].
    """
    meant, moved = (
        closed.point_positions(follow.follow(closed.loops, closed.qpos, angles)),
        _is_driven(closed),
    )
    return float(_distances(_recorded(motion)[:, moved], meant[:, moved]).max())


def in_another_assembly(
    closed: ClosedModel, motion: Motion, states: Array, error: Array, places: Array
) -> bool:
    """Return whether two successive distant records lie in another assembly.

    Args:
        closed: the model.
        motion: at n instants.
        states: at the same instants, (n, nq).
        error: as from `pose_errors`.
        positions: as from `pose_errors`.
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
    """Return the poses solved at the crank angles of states, up to the last that has one.

    A crank driven beyond a dead centre by the linkage has no pose there. Under motion laws the drivers take
    their recorded values.
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
    """Return the largest distance of points (n, k, 3) from reference positions, (n,); NaN is infinite."""
    gaps = np.sqrt(((recorded - places) ** 2).sum(-1)).max(1, initial=0.0)
    return np.where(np.isfinite(gaps), gaps, np.inf)


def _is_driven(closed: ClosedModel) -> list[bool]:
    """Return for each tracked point whether the drivers move it."""
    return [name in closed.driven_points for name in closed.track.points]


def _recorded(motion: Motion) -> Array:
    """Return the positions of all points of a motion, (n, k, 3)."""
    return np.stack([point.position for point in motion.points.values()], 1)
