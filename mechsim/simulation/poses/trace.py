"""Continuation of an assembly, in steps short enough to stay in it, on the branch where asked."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import (
    SINGULAR_RADIUS,
    WINDOW,
    ChangePoint,
    change_point_between,
    closed_near,
    determinant,
)
from mechsim.simulation.poses.path import PosePath, traced_path

# maximum step of the crank, in [rad]
MAX_STEP = 2.0 * np.pi / 16
# maximum displacement of any joint in a step, in [rad] or characteristic lengths
MAX_DISPLACEMENT = 0.5
# a trace that needs steps below this, in [rad], is at a dead centre; shorter distances are not traced
MIN_STEP = 1e-14
# closure error, relative to the square of the step, from which one Newton step suffices for the checks of the
# next step; rounding of closure errors; and maximum number of Newton steps
NEWTON_TOLERANCE, ROUNDING, MAX_NEWTON_STEPS = 0.05, 1e-13, 8
# maximum corrector displacement relative to the step, beyond which the state may be in another assembly; and
# step below which it is rounding: 1e-14 rad from a dead centre the other assembly is 1e-7 rad away
MAX_CORRECTION, MIN_DISPLACEMENT = 0.25, 1e-11
# distance of a predicted zero of the determinant, in [rad], at which a change point is searched for
TRIAL_DISTANCE = 0.05
# factors on the distance of the zero predicted by the determinant's tangent, at which the state beyond the
# zero is examined: at a multiple change point the zero is farther by its multiplicity
ZERO_FACTORS = (3.0, 6.0)
# step of the finite difference of the determinant at the start of a trace, in [rad]
PROBE_STEP = 1e-6


@dataclass(frozen=True)
class TracedStates:
    """States on a path in order, and the change points it passed."""

    states: list[Array]
    change_points: list[ChangePoint]


def trace(loops: ModelLoops, start: Array, end: float, *, past_change_points: bool = True) -> TracedStates:
    """Return nearly closed states on the path from a closed state to a crank angle, the last one there.

    At a change point the path continues smoothly, or, unless `past_change_points`, ends a little beyond the
    first one.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    angle = float(start[loops.crank_address])
    if abs(end - angle) <= MIN_STEP:
        return TracedStates([], [])
    tracer = _Tracer(loops, end, 1.0 if end > angle else -1.0, start[None])
    while tracer.direction * (end - tracer.angle) > MIN_STEP and not tracer.arrived:
        change_point = tracer.change_point_ahead()
        if change_point is None:
            tracer.advance()
        elif past_change_points:
            tracer.pass_change_point(change_point)
        else:
            return TracedStates([*tracer.states, *tracer.beyond(change_point)], [change_point])
    return TracedStates(tracer.states, tracer.change_points)


class _Tracer:
    """Predictor-corrector continuation: the current state, the derivatives there and the path so far.

    Attributes:
        state: the current one, (1, nq).
        angle: of the crank, in [rad].
        tangent, curvature: first and second derivative of the state by the crank angle.
        determinant: of the loops.
        descent_rate: decrease of the determinant's magnitude, per radian.
        trial: distance of a predicted zero, in [rad], below which a change point is searched for.
        step: maximum of the next one, in [rad].
        arrived: whether the end was reached within the interval of a change point.
    """

    def __init__(self, loops: ModelLoops, end: float, direction: float, start: Array):
        self.loops, self.end, self.direction = loops, end, direction
        self.states: list[Array] = []
        self.change_points: list[ChangePoint] = []
        self.arrived = False
        self._restart(start, MAX_STEP)

    def _restart(self, state: Array, step: float) -> None:
        """Restart the trace at a state."""
        jacobian = self.loops.linearise(state)[1]
        self.state, self.angle = state, float(state[0, self.loops.crank_address])
        self.tangent, self.determinant_sign = (
            loop_jacobian.tangent(self.loops, jacobian),
            loop_jacobian.determinant_sign(self.loops, jacobian),
        )
        self.determinant = loop_jacobian.determinant(self.loops, jacobian)[0]
        self.curvature = np.zeros_like(self.tangent)
        # a first step past a change point could end in the other assembly
        probe = self.loops.displaced(state, PROBE_STEP * self.direction * self.tangent)
        probe_determinant = loop_jacobian.determinant(self.loops, self.loops.linearise(probe)[1])[0]
        self.descent_rate = (self.determinant - probe_determinant) / PROBE_STEP
        self.trial, self.step = TRIAL_DISTANCE, step

    @property
    def zero_distance(self) -> float:
        """Predicted distance to a zero of the determinant, where another assembly is close, in [rad]."""
        return self.determinant / self.descent_rate if self.determinant * self.descent_rate > 0.0 else np.inf

    def change_point_ahead(self) -> ChangePoint | None:
        """Return the change point just ahead; None without one."""
        zero_distance = self.zero_distance
        if zero_distance >= self.trial:
            return None
        self.trial = 0.03 * zero_distance
        for times in ZERO_FACTORS:
            distance = times * self.direction * zero_distance
            beyond = self.loops.displaced(
                self.state, distance * self.tangent + 0.5 * distance**2 * self.curvature
            )
            change_point = _change_point_before(self.loops, self.state[0], beyond, self.angle + distance)
            if change_point is not None:
                return change_point
        return None

    def beyond(self, change_point: ChangePoint) -> Array:
        """Return the states of a change point that lie ahead, (k, nq)."""
        rows = change_point.states[:: int(self.direction)]
        return rows[self.direction * (rows[:, self.loops.crank_address] - self.angle) > 0.0]

    def pass_change_point(self, change_point: ChangePoint) -> None:
        """Go to the far side of a change point, or to the end if that is within its interval."""
        self.change_points.append(change_point)
        rows = self.beyond(change_point)
        inside = rows[self.direction * (self.end - rows[:, self.loops.crank_address]) >= 0.0]
        self.states += list(inside)
        if len(inside) < len(rows):
            self.states.append(_state_near(self.loops, change_point, self.end))
            self.arrived = True
        else:
            self._restart(rows[-1:], WINDOW)

    def advance(self) -> None:
        """Go one step, or shorten the next one where it could lead into another assembly."""
        loops, direction = self.loops, self.direction
        max_step = MAX_DISPLACEMENT / max(float(np.abs(self.tangent / loops.units).max(initial=0.0)), 1.0)
        self.step = min(self.step, max(min(0.7 * self.zero_distance, max_step), MIN_STEP))
        # a step longer by a tenth avoids a tiny last one
        remaining = abs(self.end - self.angle)
        step = remaining if remaining < 1.1 * self.step else self.step
        target = self.end if step == remaining else self.angle + direction * step
        guess = loops.displaced(self.state, direction * step * self.tangent + 0.5 * step**2 * self.curvature)
        guess[0, loops.crank_address] = target
        corrected = _corrected(loops, self.state, guess, self.determinant_sign)
        if corrected is None:
            self._shorten(step / 2.0)
            return
        self.state, tangent = corrected
        determinant = loop_jacobian.determinant(loops, loops.linearise(self.state)[1])[0]
        self.descent_rate, self.determinant = (self.determinant - determinant) / step, determinant
        self.trial = min(max(self.trial, 0.03 * self.zero_distance), TRIAL_DISTANCE)
        self.curvature = direction * (tangent - self.tangent) / step
        self.tangent, self.angle = tangent, target
        self.states.append(self.state[0])
        self.step = min(2.0 * step, MAX_STEP)

    def _shorten(self, step: float) -> None:
        """Shorten the step and close the state, because its closure error counts more in a shorter step."""
        if step < MIN_STEP:
            raise AssemblyError(
                f"{self.loops.name}: the {_limit_text(self.loops, self.angle)} in this assembly; "
                "stay on this side of the dead centre or change the dimensions"
            )
        self.state = loop_jacobian.close(self.loops, self.state)
        self.tangent = loop_jacobian.tangent(self.loops, self.loops.linearise(self.state)[1])
        self.curvature, self.step = np.zeros_like(self.tangent), step


def _limit_text(loops: ModelLoops, angle: float) -> str:
    if loops.drivers is None:
        return f"crank cannot pass {angle:.7g} rad"
    return f"drivers cannot pass {loops.driver_text(angle)}"


def _change_point_before(loops: ModelLoops, state: Array, beyond: Array, angle: float) -> ChangePoint | None:
    """Return the change point between a closed state and a predicted one beyond it; None without one."""
    beyond[0, loops.crank_address] = angle
    closed = loop_jacobian.close_if_possible(loops, beyond)
    if closed is None or np.abs(closed - beyond).max() > MAX_CORRECTION * np.abs(state - beyond).max():
        return None
    return change_point_between(loops, state, closed[0])


def _state_near(loops: ModelLoops, change_point: ChangePoint, angle: float) -> Array:
    """Return the state at a crank angle close to a change point, (nq,)."""
    state = change_point.states_at(np.array([angle]))
    state[0, loops.crank_address] = angle
    singular = change_point.contains(np.array([angle]))[0]
    return (closed_near(loops, state) if singular else loop_jacobian.close(loops, state))[0]


def _corrected(loops: ModelLoops, previous: Array, guess: Array, sign: Array) -> tuple[Array, Array] | None:
    """Return the corrected state and its tangent; None if it may be in another assembly."""
    state = guess
    crank_step = float(guess[0, loops.crank_address] - previous[0, loops.crank_address])
    for _ in range(MAX_NEWTON_STEPS):
        residual, jacobian = loops.linearise(state)
        try:
            step, tangent = loop_jacobian.newton_step(loops, residual, jacobian)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        state = loops.displaced(state, step)
        if np.abs(state - guess).max() > MAX_CORRECTION * max(
            np.abs(previous - guess).max(), MIN_DISPLACEMENT
        ):
            return None
        if loops.closure_error(residual)[0] < max(NEWTON_TOLERANCE * crank_step**2, ROUNDING):
            # the last step may have crossed over, too
            jacobians = np.concatenate([jacobian, loops.linearise(state)[1]])
            signs = loop_jacobian.determinant_sign(loops, jacobians) * sign
            if not signs.all():
                before = loops.linearise(previous)[1].repeat(2, 0)
                signs = np.where(loop_jacobian.sign_changed(loops, before, jacobians), -1.0, 1.0)
            return None if signs.min() < 0.0 else (state, tangent)
    return None


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
        solution = loop_jacobian.close_if_possible(loops, guess)
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
