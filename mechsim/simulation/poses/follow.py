"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import REVOLUTION, other_revolutions
from mechsim.numerics.arrays import Array
from mechsim.simulation import closing, loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import ChangePoint
from mechsim.simulation.poses.path import AssemblyPath, BranchPath, branch_path, traced_path
from mechsim.simulation.poses.trace import MAX_ERROR, MAX_STEP, MIN_STEP, TracedStates, explicit_trace, trace
from mechsim.simulation.state import hinge_entries, quaternion_entries

# from a closed state to a crank angle: states on the path, or None where it is not certain
Tracer = Callable[[ModelLoops, Array, float], TracedStates | None]

# distance between states before and after a revolution, in [rad] or characteristic lengths, that is rounding
RETURN_TOLERANCE = 1e-9
# (poses per knot, factor): from this number of poses per knot on, the knots are first multiplied by the
# factor, so that one Newton step closes a pose, or none
REFINED = ((32, 8), (4, 2))
# poses closed at once: their arrays fit into the cache, and a long run needs little memory
CHUNK = 2048


def follow(loops: ModelLoops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    Explicit steps over the range, or continuation where their error is too large, keep the assembly.
    Interpolation between these states gives all others to within a Newton step or two, which are solved
    together. Where a revolution of the crank leads back to the start, one revolution is traced for any
    number. The angles of an oscillating crank may be offset by whole revolutions if the linkage is the same
    there.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    return follow_path(loops, start, angles)[0]


def follow_path(
    loops: ModelLoops, start: Array, angles: ArrayLike
) -> tuple[Array, AssemblyPath | BranchPath]:
    """Return what `follow` does, and the path on which the states lie."""
    angles = np.asarray(angles, dtype=np.float64)
    try:
        return _follow_path(loops, start, angles)
    except AssemblyError:
        for shifted in on_other_revolutions(loops, start, angles):
            with suppress(AssemblyError):
                return _follow_path(loops, shifted, angles)
        raise


def _follow_path(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, AssemblyPath | BranchPath]:
    if loops.change_point == "branch":
        return _follow_branch(loops, start, angles)
    explicit = _explicit_path(loops, start, angles)
    if explicit is not None:
        states, on_path = _states_along(explicit, angles)
        if on_path.all():
            return states, explicit
    traced = _traced_path(loops, start, angles)
    return _states_on(traced, angles), traced


def _follow_branch(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, BranchPath]:
    angle = float(start[loops.crank_address])
    low, high = min(angle, float(angles.min())), max(angle, float(angles.max()))
    path = (
        _branch_revolution(loops, start) if high - low > 1.5 * REVOLUTION and loops.drivers is None else None
    )
    path = path or branch_path(loops, start, low, high)
    states = np.empty((len(angles), len(start)))
    for piece, rows, reduced in path.split(angles):
        states[rows] = _states_on(piece, reduced)
    if path.gain is not None:
        states += path.revolutions(angles)[:, None] * path.gain
    states[:, loops.crank_address] = angles
    return states, path


def _branch_revolution(loops: ModelLoops, start: Array) -> BranchPath | None:
    """Return the path over one revolution; None where that does not lead back."""
    angle = float(start[loops.crank_address])
    path = branch_path(loops, start, angle, angle + REVOLUTION)
    end = _states_on(path.pieces[-1], np.array([angle + REVOLUTION]))[0]
    gain = _gain(loops, np.stack([start, end]))
    return None if gain is None else replace(path, gain=gain)


def _states_on(path: AssemblyPath, angles: Array) -> Array:
    """Return closed states at crank angles, (n, nq), on a path; uncertain ones are traced."""
    states, on_path = _states_along(path, angles)
    for i in np.flatnonzero(~on_path):
        states[i] = _traced_to(path, angles[i : i + 1])
    return states


def _states_along(path: AssemblyPath, angles: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return closed states at crank angles, and which of them certainly lie on the path."""
    for poses_per_knot, factor in REFINED:
        if len(angles) > poses_per_knot * len(path.knots):
            path = path.refined(factor)
            break
    chunks = [path.states_at(angles[i : i + CHUNK]) for i in range(0, len(angles), CHUNK)]
    return np.concatenate([states for states, _ in chunks]), np.concatenate(
        [on_path for _, on_path in chunks]
    )


def _explicit_path(loops: ModelLoops, start: Array, angles: Array) -> AssemblyPath | None:
    """Return the path over the range of crank angles by explicit steps; None where it is not certain."""
    if loops.drivers is not None:
        return None
    if float(angles.max() - angles.min()) < MAX_STEP:
        reach = np.abs(angles - start[loops.crank_address]).max()
        if reach < MAX_STEP:
            return None
    jacobian = loops.linearise(start[None])[1]

    def stepped(loops: ModelLoops, begin: Array, end: float) -> TracedStates | None:
        states = explicit_trace(loops, begin, end, jacobian)
        return None if states is None else TracedStates(list(states), [])

    knots = _knots(loops, start, angles, stepped)
    if knots is None:
        return None
    return AssemblyPath(
        loops,
        *knots[:2],
        float(loop_jacobian.determinant_sign(loops, jacobian)[0]),
        certain_correction=0.0,
        max_correction=MAX_ERROR,
    )


def _traced_path(loops: ModelLoops, start: Array, angles: Array) -> AssemblyPath:
    """Return the path over the range of crank angles by continuation."""
    path_knots = _knots(loops, start, angles, trace)
    assert path_knots is not None
    knots, gain, change_points = path_knots
    return traced_path(loops, knots, change_points, gain)


def _knots(
    loops: ModelLoops, start: Array, angles: Array, steps: Tracer
) -> tuple[Array, Array | None, list[ChangePoint]] | None:
    """Return states over the range, the change by a revolution if one suffices, and change points."""
    angle = float(start[loops.crank_address])
    low, high = min(angle, float(angles.min())), max(angle, float(angles.max()))
    if high - low > 1.5 * REVOLUTION and loops.drivers is None:
        revolution = _both_directions(loops, start, angle, angle + REVOLUTION, steps)
        gain = None if revolution is None else _gain(loops, revolution[0])
        if revolution is not None and gain is not None:
            return revolution[0], gain, revolution[1]
    knots = _both_directions(loops, start, low, high, steps)
    return None if knots is None else (knots[0], None, knots[1])


def _both_directions(
    loops: ModelLoops, start: Array, low: float, high: float, steps: Tracer
) -> tuple[Array, list[ChangePoint]] | None:
    angle, nothing = float(start[loops.crank_address]), TracedStates([], [])
    before = steps(loops, start, low) if angle - low > MIN_STEP else nothing
    after = steps(loops, start, high) if high - angle > MIN_STEP else nothing
    if before is None or after is None:
        return None
    return np.stack([*before.states[::-1], start, *after.states]), before.change_points + after.change_points


def _gain(loops: ModelLoops, states: Array) -> Array | None:
    """Return the change of a state by a revolution of the crank, (nq,); None where it does not lead back."""
    ends = closing.close(loops, states[[0, -1]])
    gain = np.where(quaternion_entries(loops.model), 0.0, ends[1] - ends[0])
    whole_turns = np.where(hinge_entries(loops.model), REVOLUTION * np.round(gain / REVOLUTION), 0.0)
    # a link with ball joints may have spun, but the points on its axis must return
    positions = point_positions(loops, ends)
    returns = (
        np.abs(positions[1] - positions[0]).max(initial=0.0) < RETURN_TOLERANCE * loops.characteristic_length
    )
    return whole_turns if returns and np.abs(gain - whole_turns).max() < RETURN_TOLERANCE else None


def point_positions(loops: ModelLoops, states: Array) -> Array:
    """Return the positions of all sites and loop-closing points at n states, (n, k, 3) in [m]."""
    position, rotation = loops.posed.body_poses(states)
    ends = [end for pair in loops.pairs for end in pair.ends]
    points = [position[:, body] + rotation[:, body] @ local for body, local in ends]
    return np.concatenate([np.stack(points, 1), loops.posed.site_positions(states)], 1)


def _traced_to(path: AssemblyPath, angle: Array) -> Array:
    """Return the closed state at a crank angle, (1,), traced from the nearest knot, (nq,)."""
    loops, address = path.loops, path.loops.crank_address
    knots = path.knots if path.gain is None else path.knots + path.revolutions(angle) * path.gain
    nearest = knots[np.argmin(np.abs(knots[:, address] - angle))]
    state = [nearest, *trace(loops, nearest, float(angle[0])).states][-1].copy()
    state[address] = angle[0]
    return closing.close(loops, state[None])[0]


# change of the residuals, in [rad], below which the pose is the same
MAX_RESIDUAL_CHANGE = 1e-9


def on_other_revolutions(loops: ModelLoops, state: Array, angles: Array) -> Iterator[Array]:
    """Yield a closed state (nq,) at crank angles within a revolution of the given ones, (n,).

    There is none where a gear makes the pose differ after a revolution of the crank, or under motion laws.
    """
    for revolutions in other_revolutions(float(state[loops.crank_address]), angles):
        shifted = _shifted(loops, state, revolutions)
        if shifted is not None:
            yield shifted


def _shifted(loops: ModelLoops, state: Array, revolutions: int) -> Array | None:
    """Return the state with revolutions added to the crank angle; None where that is another pose."""
    if loops.drivers is not None:
        return None
    shifted = state.copy()
    shifted[loops.crank_address] += revolutions * REVOLUTION
    for coupling in loops.couplings:
        driven = coupling.left.addresses
        if len(driven) > 1 or not hinge_entries(loops.model)[driven].all():
            continue
        gain = coupling.target(shifted[None]) - coupling.target(state[None])
        shifted[driven] += REVOLUTION * np.round(gain / coupling.left.weights / REVOLUTION)
    residual_change = loops.closure_error(loops.residual(shifted[None]) - loops.residual(state[None]))
    return shifted if residual_change.max() < MAX_RESIDUAL_CHANGE else None


# fraction of the path by which the straight line extends beyond both of its ends
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, target: Array, target_text: str) -> Array:
    """Return the closed state with the drivers at their targets, (nq,), and the path parameter at zero.

    All drivers move at once along a straight path.

    Args:
        loops: with drivers that follow a path parameter.
        state: closed, (nq,).
        target: values of the drivers, (k,) in [m] or [rad].
        target_text: where that is, in words.

    Raises:
        AssemblyError: where the loops do not close on the path.
    """
    drivers = loops.drivers
    assert drivers is not None
    start = state.copy()
    start[loops.crank_address] = 0.0
    current = start[drivers.addresses]
    distance = float(
        np.abs((target - current) / np.where(drivers.slides, loops.characteristic_length, 1.0)).max(
            initial=0.0
        )
    )
    if distance > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            fraction = np.clip(angle / distance, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(current), len(angle)))
            displacement = (target - current)[:, None]
            return current[:, None] + displacement * fraction, displacement / distance + none, none

        def along(angle: float) -> str:
            values = straight(np.array([angle]))[0][:, 0]
            text = ", ".join(
                f"{name} = {value:.6g}" for name, value in zip(drivers.names, values, strict=True)
            )
            return f"{text} on the way to {target_text}"

        start = follow(replace(loops, drivers=drivers.with_law(straight, along)), start, [distance])[0]
    start[loops.crank_address], start[drivers.addresses] = 0.0, target
    return start
