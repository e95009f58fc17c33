"""The states of an assembly as a function of the crank angle, by interpolation between closed states."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import closing, loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import SINGULAR_RADIUS, ChangePoint, closed_near, determinant
from mechsim.simulation.poses.trace import MIN_STEP, trace
from mechsim.simulation.state import quaternion_addresses

# correction of an interpolated pose up to which it certainly stays in the assembly, and correction from which
# it may not although the determinant's sign is the same: measured 2e-7 and 1e-2 at most
CERTAIN_CORRECTION, MAX_CORRECTION = 1e-6, 5e-2
# minimum distance of interpolation knots in crank angle, in [rad]; and number of knots of a polynomial
MIN_KNOT_DISTANCE, INTERPOLATION_KNOTS = 1e-2, 10


@dataclass(frozen=True)
class AssemblyPath:
    """The states of an assembly as a function of the crank angle.

    Attributes:
        loops: of the model.
        knots: states by ascending crank angle, (k, nq), closed to within `max_correction`.
        gain: change of a state by a revolution, (nq,), where the knots span one closed revolution; else None.
        determinant_sign: at the first knot, +1 or -1; 0 if unknown.
        certain_correction: a correction of a pose up to this cannot lead into another assembly.
        max_correction: a correction beyond this may, although the sign is the same.
        change_points: that the path passes smoothly.
    """

    loops: ModelLoops
    knots: Array
    gain: Array | None
    determinant_sign: float
    certain_correction: float = CERTAIN_CORRECTION
    max_correction: float = MAX_CORRECTION
    change_points: tuple[ChangePoint, ...] = ()

    def states_at(self, angles: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return closed states at crank angles, (n, nq), and which of them certainly lie on the path."""
        revolutions = self.revolutions(angles)
        reduced = angles - revolutions * REVOLUTION
        guess = self._guess(reduced)
        is_near = np.zeros(len(angles), dtype=np.bool_)
        for change_point in self.change_points:
            close = change_point.contains(reduced)
            guess[close] = change_point.states_at(reduced[close])
            is_near |= close
        if self.gain is not None:
            guess += revolutions[:, None] * self.gain
        guess[:, self.loops.crank_address] = angles
        if is_near.any():
            states, certain = guess, is_near.copy()
            states[is_near] = closed_near(self.loops, guess[is_near])
            if not is_near.all():
                states[~is_near], certain[~is_near] = self._closed(guess[~is_near], reduced[~is_near])
            return states, certain
        return self._closed(guess, reduced)

    def near_change_points(self, angles: Array) -> Iterator[tuple[ChangePoint, NDArray[np.intp], Array]]:
        """Yield change points, the indices of crank angles near them, and these angles.

        The angles are reduced by whole revolutions to the range of the change point's.
        """
        reduced = angles - self.revolutions(angles) * REVOLUTION
        for change_point in self.change_points:
            close = np.flatnonzero(change_point.contains(reduced))
            if len(close):
                yield change_point, close, reduced[close]

    def sign_changes(self, angles: Array) -> Array:
        """Return +1 where the determinant has the sign of the first knot, -1 where it has changed, (n,)."""
        first = float(self.knots[0, self.loops.crank_address])
        passed = [m.multiplicity * ((angles > m.angle) & (m.angle > first)) for m in self.change_points]
        return (-1.0) ** np.sum(passed, axis=0)

    def _closed(self, guess: Array, reduced: Array) -> tuple[Array, NDArray[np.bool_]]:
        states = closing.close_if_possible(self.loops, guess)
        if states is None:
            return guess, np.zeros(len(guess), dtype=np.bool_)
        correction = np.abs(states - guess).max(1)
        certain = correction <= self.certain_correction
        uncertain = np.flatnonzero(~certain)
        if len(uncertain):
            jacobian = self.loops.linearise(states[uncertain])[1]
            same_side = self._on_same_side(jacobian, reduced[uncertain])
            certain[uncertain] = (correction[uncertain] < self.max_correction) & same_side
        return states, certain

    def _on_same_side(self, jacobian: Array, reduced: Array) -> NDArray[np.bool_]:
        """Return whether Jacobians (n, m, nv) have the path's determinant sign at crank angles, (n,)."""
        if self.determinant_sign != 0.0:
            expected = self.determinant_sign * self.sign_changes(reduced)
            return loop_jacobian.determinant_sign(self.loops, jacobian) * expected >= 0.0
        knot_angles = self.knots[:, self.loops.crank_address]
        nearest = np.abs(reduced[:, None] - knot_angles).argmin(1)
        changed = self.sign_changes(reduced) * self.sign_changes(knot_angles[nearest]) < 0.0
        before = self.loops.linearise(self.knots[nearest])[1]
        return loop_jacobian.sign_changed(self.loops, before, jacobian) == changed

    def revolutions(self, angles: Array) -> Array:
        """Return the whole revolutions between crank angles and the range of the knots, (n,)."""
        if self.gain is None:
            return np.zeros(len(angles))
        return np.floor((angles - self.knots[0, self.loops.crank_address]) / REVOLUTION)

    def refined(self, times: int) -> "AssemblyPath":
        """Return the path with more knots, by a factor; unchanged where the new knots are not certain."""
        first, last = self.knots[[0, -1], self.loops.crank_address]
        knots, certain = self.states_at(np.linspace(first, last, times * len(self.knots)))
        return (
            replace(self, knots=knots, certain_correction=CERTAIN_CORRECTION, max_correction=MAX_CORRECTION)
            if certain.all()
            else self
        )

    @cached_property
    def _guess(self) -> Callable[[Array], Array]:
        knots = _spaced_knots(self.knots, self.loops.crank_address) if len(self.knots) > 1 else self.knots
        return partial(
            _interpolated, knots[:, self.loops.crank_address], _same_sign_quaternions(self.loops, knots)
        )


def traced_path(
    loops: ModelLoops, knots: Array, change_points: Sequence[ChangePoint], gain: Array | None = None
) -> AssemblyPath:
    """Return the path through traced, nearly closed states by ascending crank angle, (k, nq)."""
    path = AssemblyPath(loops, closing.close(loops, knots), gain, 1.0, change_points=tuple(change_points))
    # the majority of the knots: at a dead centre, where a path may start or end, the sign is rounding
    signs = loop_jacobian.determinant_sign(loops, loops.linearise(path.knots)[1]) * path.sign_changes(
        path.knots[:, loops.crank_address]
    )
    return replace(path, determinant_sign=float(np.sign(signs.sum())))


def _interpolated(knot_angles: Array, states: Array, angles: Array) -> Array:
    """Return the polynomial interpolation through the nearest knots, (n, nq).

    Args:
        knot_angles: in ascending order, (k,).
        states: at the knots, (k, nq).
        angles: (n,).
    """
    count = min(INTERPOLATION_KNOTS, len(knot_angles))
    first = np.clip(np.searchsorted(knot_angles, angles) - count // 2, 0, len(knot_angles) - count)
    values = np.zeros((len(angles), states.shape[1]))
    for i in range(count):
        others = np.delete(np.arange(count), i)
        other_angles = knot_angles[first[:, None] + others]
        weight = ((angles[:, None] - other_angles) / (knot_angles[first + i][:, None] - other_angles)).prod(1)
        values += weight[:, None] * states[first + i]
    return values


def _spaced_knots(knots: Array, address: int) -> Array:
    """Return the knots without those too close together, between which interpolation amplifies rounding."""
    kept = [0]
    for i in range(1, len(knots)):
        if knots[i, address] - knots[kept[-1], address] > MIN_KNOT_DISTANCE:
            kept.append(i)
    return knots[kept] if len(kept) > 1 else knots[[0, -1]]


def _same_sign_quaternions(loops: ModelLoops, states: Array) -> Array:
    """Return states with continuous quaternion signs; q and -q are the same rotation."""
    smooth = states.copy()
    for address in quaternion_addresses(loops.model):
        q = smooth[:, address : address + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth


# crank angle, in [rad], of the finite differences of the determinant at a change point; minimum ratio of its
# derivatives for the other branch to be reachable by the crank; maximum error of the predicted state on the
# other branch, relative to the step; and maximum number of halvings of the step
PROBE_DISTANCE, MIN_CURVATURE, MAX_PREDICTION_ERROR, MAX_HALVINGS = 1e-4, 1e-6, 0.3, 6
# accuracy of a change point's angle, in [rad], measured 1.5e-11: rates within it are those of the path beyond
CHANGE_POINT_TOLERANCE = 1e-10


@dataclass(frozen=True)
class BranchPath:
    """Smooth paths, each in one assembly, from each change point to the next.

    Attributes:
        pieces: by ascending crank angle; each extends smoothly a little beyond the change points at its ends.
        change_points: between them.
        gain: change of a state by a revolution, (nq,), where the pieces span a closed revolution; else None.
    """

    pieces: tuple[AssemblyPath, ...]
    change_points: tuple[ChangePoint, ...]
    gain: Array | None = None

    def split(self, angles: Array) -> Iterator[tuple[AssemblyPath, NDArray[np.intp], Array]]:
        """Yield paths, the indices of the crank angles on each, and these reduced by whole revolutions.

        An angle at a change point belongs to the path beyond it.
        """
        reduced = angles - self.revolutions(angles) * REVOLUTION
        piece_index = np.searchsorted(self._cuts - CHANGE_POINT_TOLERANCE, reduced, side="right")
        for i, piece in enumerate(self.pieces):
            rows = np.flatnonzero(piece_index == i)
            if len(rows):
                yield piece, rows, reduced[rows]

    def revolutions(self, angles: Array) -> Array:
        """Return the whole revolutions between crank angles and the range of the pieces, (n,)."""
        if self.gain is None:
            return np.zeros(len(angles))
        first = self.pieces[0]
        return np.floor((angles - first.knots[0, first.loops.crank_address]) / REVOLUTION)

    def near_change_points(self, angles: Array) -> Iterator[tuple[ChangePoint, NDArray[np.intp], Array]]:
        """Yield change points, the indices of crank angles near them, and these angles."""
        for piece, rows, reduced in self.split(angles):
            for change_point, close, reduced_near in piece.near_change_points(reduced):
                yield change_point, rows[close], reduced_near

    @cached_property
    def _cuts(self) -> Array:
        return np.array([change_point.angle for change_point in self.change_points])


@dataclass(frozen=True)
class _Leg:
    """Traced states from one change point to the next, and the change points near its ends."""

    states: list[Array]
    change_points: list[ChangePoint]


def branch_path(loops: ModelLoops, start: Array, low: float, high: float) -> BranchPath:
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
    return BranchPath(tuple(pieces), (*before[::-1], *after))


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
