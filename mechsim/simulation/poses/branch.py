"""Paths that stay on the branch at change points: traced leg by leg, each in one assembly."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.simulation import closing, loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import SINGULAR_RADIUS, ChangePoint, determinant
from mechsim.simulation.poses.path import PosePath, traced_path
from mechsim.simulation.poses.trace import MIN_STEP, trace

# crank angle, in [rad], of the finite differences of the determinant at a change point; minimum ratio of its
# derivatives for the other branch to be reachable by the crank; maximum error of the predicted state on the
# other branch, relative to the step; and maximum number of halvings of the step
PROBE_DISTANCE, MIN_CURVATURE, MAX_PREDICTION_ERROR, MAX_HALVINGS = 1e-4, 1e-6, 0.3, 6


@dataclass(frozen=True)
class _Leg:
    """Traced states from one change point to the next, and the change points near its ends."""

    states: list[Array]
    change_points: list[ChangePoint]


def branch_path(loops: ModelLoops, start: Array, low: float, high: float) -> PosePath:
    """Return the path from a closed state (nq,) that stays on the branch between two crank angles.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close or the branch ends.
    """
    back, before = _legs(loops, start, low)
    ahead, after = _legs(loops, start, high)
    first = _Leg(
        [*back[0].states[::-1], start, *ahead[0].states], back[0].change_points + ahead[0].change_points
    )
    backward = [_Leg(leg.states[::-1], leg.change_points) for leg in back[:0:-1]]
    pieces = [
        traced_path(loops, np.stack(leg.states), leg.change_points) for leg in [*backward, first, *ahead[1:]]
    ]
    change_points = (*before[::-1], *after)
    return PosePath(tuple(pieces), change_points, tuple(point.angle for point in change_points))


def _legs(loops: ModelLoops, start: Array, end: float) -> tuple[list[_Leg], list[ChangePoint]]:
    """Return the legs from a closed state to a crank angle, in order, and the change points they passed."""
    address = loops.crank_address
    direction = 1.0 if end > start[address] else -1.0
    legs, passed = [_Leg([], [])], list[ChangePoint]()
    state = start
    while direction * (end - state[address]) > MIN_STEP:
        leg_trace = trace(loops, state, end, past_change_points=False)
        last = legs[-1]
        legs[-1] = _Leg(last.states + leg_trace.states, last.change_points + leg_trace.change_points)
        reached = [point for point in leg_trace.change_points if direction * (end - point.angle) >= 0.0]
        if not reached:
            break
        passed += reached
        state = _other_branch(loops, reached[0], direction)
        # from there back to the change point, and a little beyond it
        back = trace(loops, state, reached[0].angle - direction * SINGULAR_RADIUS, past_change_points=False)
        legs.append(_Leg([*back.states[::-1], state], back.change_points))
    return legs, passed


def _other_branch(loops: ModelLoops, change_point: ChangePoint, direction: float) -> Array:
    """Return the closed state (nq,) a little beyond a change point in the other assembly.

    The determinant is a x on this assembly's path at x beyond the change point, and changes by 2 b z at a
    displacement z in the null-space direction; the reduced equation is z (a x + b z) = 0, whose other root is
    z = -a x / b.

    Raises:
        AssemblyError: where the crank does not rotate in the other assembly.
    """
    angle = np.array([change_point.angle])
    state = change_point.states_at(angle)
    free = loop_jacobian.least_constrained_direction(loops, loops.linearise(state)[1])
    on_path = change_point.states_at(angle + PROBE_DISTANCE * np.array([-1.0, 1.0]))
    off_path = loops.displaced(state.repeat(2, 0), PROBE_DISTANCE * np.array([[-1.0], [1.0]]) * free)
    determinants = determinant(loops, np.concatenate([on_path, off_path]))
    a, b = determinants[1] - determinants[0], 0.5 * (determinants[3] - determinants[2])
    distance = change_point.radius / 2.0 if abs(b) > MIN_CURVATURE * abs(a) else 0.0
    for _ in range(MAX_HALVINGS if distance else 0):
        beyond = change_point.states_at(angle + direction * distance)
        beyond[:, loops.crank_address] = angle + direction * distance
        step = -a / b * direction * distance * free
        guess = loops.displaced(beyond, step[None])
        solution = closing.close_if_possible(loops, guess)
        if (
            solution is not None
            and np.abs(solution - guess).max() < MAX_PREDICTION_ERROR * np.abs(step).max()
        ):
            signs = determinant(loops, np.concatenate([beyond, solution]))
            if signs[0] * signs[1] < 0.0:
                return solution[0]
        distance *= 0.5
    who = "the crank" if loops.drivers is None else "the drivers"
    raise AssemblyError(
        f"{loops.name}: {who} cannot stay on the branch at "
        f"{loops.driver_text(change_point.angle)}: it cannot move in the other assembly; go on smoothly"
    )
