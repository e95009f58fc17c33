"""Distances of recorded states from the poses solved at their crank angles; changes of assembly."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import CrankProfile
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import REVOLUTION, Array, unique
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import initial_guess, link_poses

# A state is in another assembly if its distance from the nearest pose is below MAX_DISTANCE_RATIO times its
# distance from the expected pose, and the latter is above MIN_SEPARATION times the half stroke. MAX_PAIRS:
# number of tested pairs of records. ROUNDING: error of positions relative to the characteristic length, for a
# tiny stroke
MAX_DISTANCE_RATIO, MIN_SEPARATION, MAX_PAIRS, ROUNDING = 0.5, 0.02, 100, 1e-12


def pose_errors(closed: ClosedModel, motion: Motion, states: Array) -> tuple[Array, Array]:
    """Return the largest distance of a tracked point from its position in the solved pose, and the positions.

    The reference for a point that the crank does not determine is the closed pose nearest to the recorded
    state.

    Args:
        closed: the model.
        motion: motion at n instants.
        states: states at the same instants, (n, nq).

    Returns:
        Distances in [m], (n,), infinite from the first crank angle without a pose; and the positions before
        that angle, (solved, k, 3) in [m].
    """
    positions = closed.point_positions(_solved_poses(closed, states))
    if closed.undetermined_points.any():
        try:
            nearest = closed.point_positions(loop_jacobian.close(closed.loops, states[: len(positions)]))
            positions[:, closed.undetermined_points] = nearest[:, closed.undetermined_points]
        except AssemblyError:
            positions[:, closed.undetermined_points] = np.inf
    error = np.full(len(states), np.inf)
    error[: len(positions)] = _distances(_recorded(motion)[: len(positions)], positions)
    return error, positions


def lag_distance(closed: ClosedModel, motion: Motion, angles: Array) -> float:
    """Return the largest distance of a driven point from its pose at the prescribed angles, in [m].

    Args:
        closed: the model.
        motion: motion at n instants.
        angles: prescribed values of the crank or the path parameter at these instants, (n,) in [rad].
    """
    target = closed.point_positions(follow.follow(closed.loops, closed.qpos, angles))
    driven = closed.driven_points
    return float(_distances(_recorded(motion)[:, driven], target[:, driven]).max())


def in_another_assembly(
    closed: ClosedModel, motion: Motion, states: Array, error: Array, positions: Array
) -> bool:
    """Return whether two successive distant records lie in another assembly.

    Args:
        closed: the model.
        motion: motion at n instants.
        states: states at the same instants, (n, nq).
        error: distances from `pose_errors`.
        positions: positions from `pose_errors`.
    """
    count, recorded = len(positions), _recorded(motion)
    stroke = float(np.ptp(positions[:, closed.driven_points], axis=0).max())
    rounding = ROUNDING * closed.loops.characteristic_length
    distant = error[:count] > max(MIN_SEPARATION * 0.5 * stroke, rounding)
    pairs = np.flatnonzero(distant[1:] & distant[:-1])
    tested = pairs[unique(np.linspace(0, len(pairs) - 1, MAX_PAIRS).astype(int))] if len(pairs) else []
    for i in tested:
        both = slice(i, i + 2)
        try:
            nearest = loop_jacobian.close(closed.loops, states[both])
        except AssemblyError:
            continue
        distances = _distances(recorded[both], closed.point_positions(nearest))
        if (distances < MAX_DISTANCE_RATIO * error[both]).all():
            return True
    return False


def _solved_poses(closed: ClosedModel, states: Array) -> Array:
    """Return the poses solved at the crank angles of states, up to the last angle with a pose.

    Beyond a dead centre of the crank there is no pose. Under motion laws the drivers have their recorded
    values.
    """
    loops, angles, states_solved = closed.loops, states[:, closed.loops.crank_address], states[:1]
    count, solved, unsolved = len(angles), 1, len(angles) + 1
    while unsolved - solved > 1:
        try:
            states_solved = follow.follow(loops, closed.qpos, angles[:count])
            solved = count
        except AssemblyError:
            unsolved = count
        count = (solved + unsolved) // 2
    if not loops.drivers.crank:
        driven = states[: len(states_solved), loops.drivers.addresses]
        states_solved[:, loops.drivers.addresses] = driven
        locked = replace(loops, drivers=loops.drivers.locked_at(driven.T))
        states_solved = loop_jacobian.close(locked, states_solved)
    return states_solved


def _distances(recorded: Array, positions: Array) -> Array:
    """Return the largest distance of points (n, k, 3) from reference positions, (n,); NaN is infinite."""
    gaps = np.sqrt(((recorded - positions) ** 2).sum(-1)).max(1, initial=0.0)
    return np.where(np.isfinite(gaps), gaps, np.inf)


def _recorded(motion: Motion) -> Array:
    """Return the positions of all points of a motion, (n, k, 3)."""
    return np.stack([point.position for point in motion.points.values()], 1)


# number of crank angles at which a profile is probed
PROBES = 64
# distance from a change point, in [rad], below which the start is at the change point within rounding
AT_START = 1e-6
# distance in [rad] by which a path is followed beyond the first crank angle
BEYOND = 0.05


def passed_change_points(closed: ClosedModel, profile: CrankProfile) -> list[float]:
    """Return the crank angles, or values of the path parameter, of the passed change points, in [rad].

    Raises:
        AssemblyError: if the loops do not close on the path.
    """
    angle = profile.state(np.linspace(0.0, profile.duration, PROBES))[0]
    path = _path(closed, angle)
    low, high = float(angle.min()), float(angle.max())
    revolutions = (0.0,) if path.gain is None else (-REVOLUTION, 0.0, REVOLUTION)
    first = float(path.revolutions(angle[:1])[0]) * REVOLUTION
    change_points = path.change_points
    if path.gain is not None:
        # the followed path extends beyond one revolution
        end = path.initial + REVOLUTION - AT_START
        change_points = [point for point in change_points if path.initial - AT_START <= point < end]
    change_point_angles = [point + first + whole for point in change_points for whole in revolutions]
    return sorted(a for a in change_point_angles if low - AT_START <= a <= high + AT_START)


def _path(closed: ClosedModel, angles: Array) -> follow.PosePath:
    """Return the path over crank angles (n,), extended slightly beyond the first of them if possible.

    A branch point is confirmed only after the path has passed it, and the model may start on either side.
    """
    first, behind = float(angles[0]), BEYOND * np.sign(angles[0] - closed.angle)
    with suppress(AssemblyError):
        return follow.follow_path(closed.loops, closed.qpos, np.append(angles, first + behind))[1]
    return follow.follow_path(closed.loops, closed.qpos, angles)[1]


def change_points_text(loops: ModelLoops, angles: Sequence[float]) -> str:
    """Return the positions of change points as text."""
    if not loops.drivers.crank:
        return ", ".join(loops.drivers.text(angle) for angle in angles[:3])
    return f"crank angle {', '.join(f'{angle:.4g}' for angle in angles[:3])} rad"


def undecided_note(loops: ModelLoops, angles: Sequence[float]) -> str:
    """Return a note that dynamics do not determine the branch; empty without change points."""
    if not angles:
        return ""
    return (
        f"at {change_points_text(loops, angles)} two assemblies meet, and dynamics alone do not determine "
        "the branch: add a second parallel crank or inertia, take more steps, or run it by pose"
    )


def require_regular_start(loops: ModelLoops, angles: Sequence[float], start: float) -> None:
    """Reject a time-stepped run that starts at a change point.

    Raises:
        AssemblyError: with the crank angle or the driver values.
    """
    if any(abs(angle - start) <= AT_START for angle in angles):
        raise AssemblyError(
            f"{loops.name}: it starts at {loops.drivers.text(start)}, where two assemblies meet and dynamics "
            "alone do not determine the branch; give a start at "
            f"{'another crank angle' if loops.drivers.crank else 'other values of the drivers'}, "
            "add a second parallel crank, or run it by pose"
        )


# crank angles per revolution
STEPS = 48


def swept(mechanism: Mechanism) -> dict[str, Pose]:
    """Return the poses of all links, with the ground, over a revolution or the range of the crank.

    Links other than the ground have one pose per crank angle. If the loops close at no angle, the only pose
    is the model's reference configuration.
    """
    loops, start = initial_guess(mechanism, Scene(level="pose"))
    forward = _states(loops, start, 2.0 * np.pi / STEPS)
    states = forward if len(forward) >= STEPS else forward + _states(loops, start, -2.0 * np.pi / STEPS)
    return {GROUND: IDENTITY, **link_poses(mechanism, loops, np.array(states or [loops.model.qpos0]))}


def _states(loops: ModelLoops, start: Array, step: float) -> list[Array]:
    """Return closed states from an initial guess, in steps of the crank over its reachable range."""
    states, guess = list[Array](), start.copy()
    with suppress(AssemblyError):
        for _ in range(STEPS):
            states.append(loop_jacobian.close(loops, guess[None])[0])
            guess = states[-1].copy()
            guess[loops.crank_address] += step
    return states
