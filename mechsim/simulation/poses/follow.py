"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.assembly_path import AssemblyPath, walked_path
from mechsim.simulation.poses.branch_path import FoldedPath, folded
from mechsim.simulation.poses.change_points import Meeting
from mechsim.simulation.poses.explicit_predictor import ASTRAY, sprint
from mechsim.simulation.poses.revolutions import on_other_laps
from mechsim.simulation.poses.trace import SHORTEST, STRIDE, Strides, walk

# from a closed state to a crank angle: states on the path, or None where it is not certain
Steps = Callable[[ModelLoops, Array, float], Strides | None]

# how far from its start a state may be after a turn to count as the same: rounding of a walk, squared up
SAME = 1e-9
# where so many poses are asked for each knot, the path is first given so many times the knots: then one
# Newton step closes a pose, or none
REFINED = ((32, 8), (4, 2))
# poses closed in one go: their arrays stay in the cache, and a long run needs little memory
CHUNK = 2048


def follow(loops: ModelLoops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    A sprint over the range, or a walk where that strays, keeps the assembly; splines through its
    poses give the rest to within a Newton step or two, all solved together. Where a turn of the
    crank leads back to the start, one turn is made however many are asked for. A crank that only
    swings may be asked for on any lap on which the linkage is the same.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    return followed(loops, start, angles)[0]


def followed(loops: ModelLoops, start: Array, angles: ArrayLike) -> tuple[Array, AssemblyPath | FoldedPath]:
    """Return what `follow` does, and the path on which the states lie."""
    angles = np.asarray(angles, dtype=np.float64)
    try:
        return _followed(loops, start, angles)
    except AssemblyError:
        for counted in on_other_laps(loops, start, angles):
            with suppress(AssemblyError):
                return _followed(loops, counted, angles)
        raise


def _followed(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, AssemblyPath | FoldedPath]:
    if loops.change_point == "branch":
        return _folded(loops, start, angles)
    sprinted = _sprinted(loops, start, angles)
    if sprinted is not None:
        states, sure = _along(sprinted, angles)
        if sure.all():
            return states, sprinted
    walked = _walked(loops, start, angles)
    return _settled_on(walked, angles), walked


def _folded(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, FoldedPath]:
    here = float(start[loops.crank_address])
    low, high = min(here, float(angles.min())), max(here, float(angles.max()))
    path = _folded_lap(loops, start) if high - low > 1.5 * TURN and loops.drivers is None else None
    path = path or folded(loops, start, low, high)
    states = np.empty((len(angles), len(start)))
    for piece, rows, turned in path.parts(angles):
        states[rows] = _settled_on(piece, turned)
    if path.gain is not None:
        states += path.laps(angles)[:, None] * path.gain
    states[:, loops.crank_address] = angles
    return states, path


def _folded_lap(loops: ModelLoops, start: Array) -> FoldedPath | None:
    """Return the path over one turn; None where that does not lead back."""
    here = float(start[loops.crank_address])
    lap = folded(loops, start, here, here + TURN)
    end = _settled_on(lap.pieces[-1], np.array([here + TURN]))[0]
    gain = _gain(loops, np.stack([start, end]))
    return None if gain is None else replace(lap, gain=gain)


def _settled_on(path: AssemblyPath, angles: Array) -> Array:
    """Return closed states at crank angles, (n, nq), on a path; those that are not sure are walked to."""
    states, sure = _along(path, angles)
    for i in np.flatnonzero(~sure):
        states[i] = _walked_to(path, angles[i : i + 1])
    return states


def _along(path: AssemblyPath, angles: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return closed states at crank angles, and of which it is sure that they lie on the path."""
    for many, times in REFINED:
        if len(angles) > many * len(path.knots):
            path = path.refined(times)
            break
    parts = [path.at(angles[i : i + CHUNK]) for i in range(0, len(angles), CHUNK)]
    return np.concatenate([states for states, _ in parts]), np.concatenate([sure for _, sure in parts])


def _sprinted(loops: ModelLoops, start: Array, angles: Array) -> AssemblyPath | None:
    """Return the path over the range of crank angles by stepping; None where that is not certain."""
    if loops.drivers is not None:
        return None
    if float(angles.max() - angles.min()) < STRIDE:
        reach = np.abs(angles - start[loops.crank_address]).max()
        if reach < STRIDE:
            return None
    jacobian = loops.linearise(start[None])[1]

    def stepped(loops: ModelLoops, begin: Array, end: float) -> Strides | None:
        states = sprint(loops, begin, end, jacobian)
        return None if states is None else Strides(list(states), [])

    found = _knots(loops, start, angles, stepped)
    if found is None:
        return None
    return AssemblyPath(loops, *found[:2], float(loops.determinant_sign(jacobian)[0]), near=0.0, far=ASTRAY)


def _walked(loops: ModelLoops, start: Array, angles: Array) -> AssemblyPath:
    """Return the path over the range of crank angles by strides."""
    found = _knots(loops, start, angles, walk)
    assert found is not None
    knots, gain, meetings = found
    return walked_path(loops, knots, meetings, gain)


def _knots(
    loops: ModelLoops, start: Array, angles: Array, steps: Steps
) -> tuple[Array, Array | None, list[Meeting]] | None:
    """Return states over the range, rising, what a turn adds where one is enough, and meetings."""
    here = float(start[loops.crank_address])
    low, high = min(here, float(angles.min())), max(here, float(angles.max()))
    if high - low > 1.5 * TURN and loops.drivers is None:
        lap = _both_directions(loops, start, here, here + TURN, steps)
        gain = None if lap is None else _gain(loops, lap[0])
        if lap is not None and gain is not None:
            return lap[0], gain, lap[1]
    found = _both_directions(loops, start, low, high, steps)
    return None if found is None else (found[0], None, found[1])


def _both_directions(
    loops: ModelLoops, start: Array, low: float, high: float, steps: Steps
) -> tuple[Array, list[Meeting]] | None:
    here, nothing = float(start[loops.crank_address]), Strides([], [])
    before = steps(loops, start, low) if here - low > SHORTEST else nothing
    after = steps(loops, start, high) if high - here > SHORTEST else nothing
    if before is None or after is None:
        return None
    return np.stack([*before.states[::-1], start, *after.states]), before.meetings + after.meetings


def _gain(loops: ModelLoops, lap: Array) -> Array | None:
    """Return what a turn of the crank adds to a state, (nq,); None where it does not lead back."""
    ends = loops.close(lap[[0, -1]])
    gain = np.where(loops.in_quaternion, 0.0, ends[1] - ends[0])
    whole = np.where(loops.hinges, TURN * np.round(gain / TURN), 0.0)
    # a passive spin of a ball joint's link need not come back, but whatever lies on its line must
    places = loops.point_positions(ends)
    back = np.abs(places[1] - places[0]).max(initial=0.0) < SAME * loops.characteristic_length
    return whole if back and np.abs(gain - whole).max() < SAME else None


def _walked_to(path: AssemblyPath, angle: Array) -> Array:
    """Return the closed state at a crank angle, (1,), walked to from the nearest knot, (nq,)."""
    loops, place = path.loops, path.loops.crank_address
    knots = path.knots if path.gain is None else path.knots + path.laps(angle) * path.gain
    nearest = knots[np.argmin(np.abs(knots[:, place] - angle))]
    there = [nearest, *walk(loops, nearest, float(angle[0])).states][-1].copy()
    there[place] = angle[0]
    return loops.close(there[None])[0]
