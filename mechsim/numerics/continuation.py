"""Numerical continuation of an assembly along its driver motion, by segments of Chebyshev polynomials.

The polynomial of a segment predicts the next one; Newton's method corrects all its nodes together. A segment
is accepted if the correction and the interpolation error are small and the Jacobian determinant keeps its
sign. A sign change along a smooth path indicates a change point, where two assembly modes meet. It is
located, and the path continues through it. At a dead centre the path ends with the segment of `fold_points`.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Generic, Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError, SingularStartError
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array
from mechsim.numerics.collocation import Piecewise, error_matrix, nodes_between
from mechsim.numerics.loop_solver import (
    MIN_DETERMINANT_RATIO,
    MIN_SHARE_RATIO,
    E,
    Linearised,
    LoopSolver,
    Q,
    loop_solver,
)
from mechsim.numerics.path_segments import (
    CONTROL,
    ClosedNodes,
    PathStates,
    PrescribedValues,
    Segment,
)

# radius of the singular neighbourhood of a change point, relative to the half length of its segment: poses in
# it are taken from the polynomial, since the Jacobian is singular; and smallest distance of a start from a
# change point
SINGULAR_FRACTION, MIN_START_DISTANCE = 0.05, 1e-5
# distance of a path's end from its start below which a singular start may be the cause
AT_START = 1e-3
# largest residual at nodes, a hundredth of the truncation error; and signed distance from a singular pose
# below which nodes are closed to rounding
NODE_RESIDUAL, NEARLY_SINGULAR = 1e-11, 1e-4
# relative error of an estimated distance from a singular pose
ESTIMATE = 0.2
# attempts in a row below `MIN_EXTRAPOLATED`, after which the path ends: the loops do not close beyond, but
# within rounding of the residual they do; an end takes 100 attempts
MAX_SHORT = 300
# attempts in a row, and the distance by which they must advance: otherwise a path of 2 pi takes more than
# 60,000 attempts, many minutes
MAX_ATTEMPTS, MIN_ADVANCE = 1000, 0.1
# shortest segment in spacings of floating-point numbers at its parameter
LEAST_SPACINGS = 16.0
# length of a step up to which the tangent is the predictor: rounding spoils the polynomial of a shorter
# segment
MIN_EXTRAPOLATED = 1e-5
# length of the segment after a change point, relative to the one through it, whose many nodes extrapolate
# badly
NEXT_LENGTH = 0.3
# signed distance of a start from a singular pose above which a change point behind it does not affect its
# rates
WELL_CONDITIONED = 0.05
# numbers of pairs of assembly modes that can meet without a sign change of the determinant; and the
# interpolation error after the sign is flipped, relative to that before, below which a change point is
# assumed
PAIRS, MAX_ERROR_RATIO = (2, 4), 0.3
# shift of an end, relative to the interval, for a second search of a change point
END_SHIFT = 0.05
# distance that a path is traced beyond the requested parameter, not round, since change points often are
OVERSHOOT = 0.2137


@dataclass(frozen=True, slots=True)
class PathNames:
    """Names for messages: the moving element, and the position and instant at a parameter."""

    mover: str
    position: Callable[[float], str]
    instant: Callable[[float], str]


CRANK = PathNames("the crank", lambda s: f"{s:.7g} rad", lambda s: f"crank angle {s:.7g} rad")


@dataclass(frozen=True, slots=True)
class Crossing(Generic[E, Q]):
    """A change point of a path, at which two assembly modes meet.

    Attributes:
        parameter: parameter of the change point.
        radius: radius of its singular neighbourhood, in which poses are those of the segments' polynomials.
        before: segment centred on it, of the assembly mode before it; equal to `beyond` on a smooth path.
        beyond: segment centred on it, of the assembly mode after it.
    """

    parameter: float
    radius: float
    before: Segment[E, Q]
    beyond: Segment[E, Q]


class ContinuationPath(PathStates[E, Q]):
    """An assembly traced along a path of its drivers, as far as requested.

    Attributes:
        control: limits of segment lengths, and errors above which a segment is rejected.
        overshoot: distance that the path is traced beyond a requested parameter, if possible.
        singular_fraction: radius of a singular neighbourhood, relative to the half length of its segment.
        first: solver of the loops about the start.
        start: coordinates at the start: one set, or one for each of d designs.
        initial: path parameter at the start.
        crossings: change points, in the order in which they were passed.
        policy: policy at change points.
        words: names for messages.
    """

    control, overshoot, singular_fraction = CONTROL, OVERSHOOT, SINGULAR_FRACTION

    def __init__(
        self,
        first: LoopSolver[E, Q],
        prescribed: PrescribedValues,
        initial: float,
        policy: Literal["smooth", "branch"] = "smooth",
        words: PathNames = CRANK,
    ):
        super().__init__(first.loops, prescribed, len(first.reference))
        self.first, self.start, self.initial = first, first.reference, initial
        self.policy: Literal["smooth", "branch"] = policy
        self.words = words
        self.segments: dict[int, list[Segment[E, Q]]] = {1: [], -1: []}
        self.crossings: list[Crossing[E, Q]] = []
        # sign of the signed distance on the last segment; 0 if unknown
        self.sign = np.zeros(self.count)
        # segment through the next change point, and that change point, once known
        self._upcoming: tuple[Segment[E, Q], float] | None = None

    def extend(self, target: float) -> None:
        """Trace the assembly to a parameter, and a little beyond if possible.

        A change point is confirmed only after the path has passed it. A change point behind the start affects
        poses near the start.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly mode.
        """
        if target == self.initial and abs(self.first.at_reference.signed_distance[0]) > WELL_CONDITIONED:
            return
        direction = 1 if target > self.initial else -1
        with suppress(AssemblyError):
            self.reach(target + direction * self.overshoot, direction)
            return
        self.reach(target, direction)

    def reach(self, target: float, direction: int, length: float | None = None) -> None:
        """Trace the assembly to a parameter; the length is that of the next segment, if known.

        The last segment ends there, or at a dead centre a little farther on.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly mode.
            InputError: for a path that is too long, or on which many attempts advance by little.
        """
        segments, self._upcoming = self.segments[direction], None
        self.require_travel(self.end(direction), target)
        if length is None:
            self.sign = np.zeros(self.count)
            length = NEXT_LENGTH * segments[-1].length if segments else self.control.first_length
            if not segments and self.segments[-direction]:
                length *= self.control.max_growth  # the segment on the other side predicts it
            length = max(length, 2.0 * _shortest(self, self.end(direction)))
        short, attempts, before, advanced = 0, 0, self.end(direction), True
        while (remaining := direction * (target - self.end(direction))) > 0.0:
            current, attempts = self.end(direction), attempts + 1
            if segments and segments[-1].final:
                raise _end_error(self, current, self.remaining_text(current, target))
            if attempts % MAX_ATTEMPTS == 0:
                self._require_advance(before, current)
                before = current
            step = remaining if remaining <= length else min(length, 0.6 * remaining)
            segment, length = self.next_segment(current, direction, step)
            short = short + 1 if length < MIN_EXTRAPOLATED else 0
            if segment is None and advanced and segments and self.count == 1 and self._upcoming is None:
                from mechsim.numerics.fold_points import fold_segment

                segment = fold_segment(self, segments[-1], direction, _shortest(self, current))
            advanced = segment is not None
            if segment is not None:
                segments.append(segment)
            elif length < _shortest(self, current) or short > MAX_SHORT:
                raise _end_error(self, current, self.remaining_text(current, target))

    def require_travel(self, start: float, target: float) -> None:
        """Reject a path that is too long; the default has no limit."""

    def _require_advance(self, before: float, current: float) -> None:
        """Reject a path on which the last `MAX_ATTEMPTS` attempts advanced by too little."""
        if abs(current - before) < MIN_ADVANCE:
            raise InputError(
                f"{self.name}: {self.words.mover} cannot be followed beyond {self.words.position(current)}: "
                f"{MAX_ATTEMPTS} steps advanced by {abs(current - before):.2g} of the path parameter, less "
                f"than {MIN_ADVANCE:g}, as with lengths of very different size; check the dimensions or the "
                "motion laws"
            )

    def remaining_text(self, current: float, target: float) -> str:
        """Return a message's addition about the remaining distance from the end of the path to its target."""
        return ""

    def end(self, direction: int) -> float:
        """Return the parameter reached in one direction."""
        return float(self.segments[direction][-1].nodes[-1]) if self.segments[direction] else self.initial

    def next_segment(self, current: float, direction: int, step: float) -> tuple[Segment[E, Q] | None, float]:
        """Return the next segment, None if it is rejected, and the length to try next."""
        if self._upcoming is not None:
            remaining = direction * (float(self._upcoming[0].nodes[0]) - current)
            if remaining < ROUNDING:
                return self._segment_past(self._upcoming, current, direction)
            step = min(step, remaining)
        solver = self._solver(current, direction)
        nodes, weights = nodes_between(current, current + direction * step, CONTROL.nodes)
        closed = self.closed(solver, nodes, self.predicted(current, direction, solver, nodes), NODE_RESIDUAL)
        if closed is None:
            return None, self.control.shrink * step
        return self.accepted(Segment(nodes, closed.states, weights, solver), closed, direction)

    def accepted(
        self, segment: Segment[E, Q], closed: ClosedNodes, direction: int
    ) -> tuple[Segment[E, Q] | None, float]:
        """Return a segment through closed nodes, None if it is rejected, and the length to try next."""
        step, solver = segment.length, segment.solver
        if closed.linearised.nearly_singular(NEARLY_SINGULAR, ESTIMATE):
            # otherwise nodes up to 1e-7 rad beyond a dead centre count as closed
            rounded = self.closed(solver, segment.nodes, closed.states)
            if rounded is None:
                return None, self.control.shrink * step
            closed = rounded
        error, loops = closed.error, closed.linearised
        if error[0] > CONTROL.max_error:
            return None, self.control.shrink * step
        adequate, by_determinant = solver.adequate(loops)
        segment = replace(segment, states=closed.states, adequate=adequate[-1:])
        if not by_determinant.all():
            segment, loops = _with_adequate_rows(self, segment, loops, by_determinant)
        share, signs = segment.solver.share(loops), loops.determinant[0]
        if share.min() < MIN_SHARE_RATIO * share.max():
            return None, self.control.shrink * step
        sign_changes = np.flatnonzero(signs[1:] != signs[:-1])
        if len(sign_changes):
            approached = self._approached_change_point(segment, int(sign_changes[0]), direction)
            return None, step if approached else self.control.shrink * step
        index = even_change_point(loops.determinant[1])
        if index is not None and self._approached_change_point(segment, index, direction, even=True):
            return None, step
        middle_sign, segments = float(signs[CONTROL.nodes // 2]), self.segments[direction]
        if self.sign[0] * middle_sign < 0.0 and segment.solver is segments[-1].solver:
            # the change point lies at the end of the last segment
            length = segments[-1].length
            return None, 0.6 * length if self.drop_last_segment(direction) else self.control.shrink * step
        self.sign = np.array([middle_sign])
        growth = float(self.growth(step, direction, error, closed.displacement)[0])
        return segment, float(np.clip(step * growth, self.control.min_length, self.control.max_length))

    def growth(self, step: float, direction: int, error: Array, displacement: Array) -> Array:
        """Return the largest ratios of the next segment's length to this one's, (d,)."""
        if not self.segments[direction]:
            return self.control.growth(error)  # predicted by the tangent
        return self.control.growth(error, displacement, self.segments[direction][-1].length / step)

    def _approached_change_point(
        self, segment: Segment[E, Q], index: int, direction: int, *, even: bool = False
    ) -> bool:
        """Return whether a change point lies beyond a node; the path then ends where its segment begins.

        Otherwise there is a sharp bend or the end of the path, which shorter segments resolve.
        """
        from mechsim.numerics.branch_points import change_point_between, segment_through

        a, b = segment.nodes[index : index + 2]
        change_point = change_point_between(self, segment, float(a), float(b))
        if change_point is None and even:
            # rounding can hide a zero without a sign change from one pair of ends
            change_point = change_point_between(self, segment, float(a + END_SHIFT * (b - a)), float(b))
        if change_point is not None:
            self._upcoming = segment_through(self, segment, change_point, direction)
        if change_point is None or self._upcoming is None:
            return False
        first = float(self._upcoming[0].nodes[0])
        while direction * (first - self.end(direction)) < -ROUNDING and self.drop_last_segment(direction):
            pass
        return True

    def _segment_past(
        self, upcoming: tuple[Segment[E, Q], float], current: float, direction: int
    ) -> tuple[Segment[E, Q], float]:
        """Return the segment beyond a change point, and the length to try next.

        Raises:
            AssemblyError: if the path begins at the change point, or the drivers do not move the other
                branch.
        """
        from mechsim.numerics.branch_points import branch_segment

        self._upcoming, self.sign = None, np.zeros(self.count)
        segment, change_point = upcoming
        if direction * (change_point - current) < MIN_START_DISTANCE:
            raise AssemblyError(
                f"{self.name}: two assembly modes meet at {self.words.instant(change_point)}, too near the "
                "start or another change point to be distinguished; start elsewhere or change the dimensions"
            )
        beyond = branch_segment(self, segment, change_point) if self.policy == "branch" else segment
        if beyond is None:
            raise AssemblyError(
                f"{self.name}: {self.words.mover} cannot pass {self.words.position(change_point)} with "
                "policy 'branch', since it does not move in the other branch; use policy 'smooth'"
            )
        first, last = current, float(beyond.nodes[-1])
        if self.policy == "branch":
            self.segments[direction].append(segment.restricted(current, change_point))
            first = change_point
        distance_after = direction * (last - change_point)
        radius = self.singular_fraction * distance_after
        self.crossings.append(Crossing(change_point, radius, segment, beyond))
        return beyond.restricted(first, last), NEXT_LENGTH * distance_after

    def drop_last_segment(self, direction: int) -> bool:
        """Drop the last segment; False if there is none, or if it contains a change point."""
        if not self.segments[direction]:
            return False
        first, last = self.segments[direction][-1].nodes[[0, -1]]
        if any(
            direction * (point - first) >= 0.0 and direction * (last - point) >= 0.0
            for point in self.change_points
        ):
            return False
        self.segments[direction].pop()
        self.sign = np.zeros(self.count)
        return True

    def _solver(self, current: float, direction: int) -> LoopSolver[E, Q]:
        """Return the solver of the next segment: that of the last segment if it is regular at its end."""
        if not self.segments[direction]:
            return self.first
        segment = self.segments[direction][-1]
        if segment.adequate is not None and segment.adequate.all():
            return segment.solver
        q = self.unflat(segment.states[[-1]], np.array([current]))
        if segment.adequate is None and segment.solver.adequate(segment.solver.linearise(q))[0].all():
            return segment.solver
        return loop_solver(self.loops, q, segment.solver.null_space)

    def predicted(self, current: float, direction: int, solver: LoopSolver[E, Q], s: Array) -> Array:
        """Return states at parameters, predicted by the previous segment or the tangent."""
        segments = self.segments[direction]
        if segments and abs(float(s[-1]) - current) > MIN_EXTRAPOLATED:
            return segments[-1].evaluate(s)
        if not segments and self.segments[-direction]:
            return self.segments[-direction][0].evaluate(s)
        driven, k = list(self.loops.driven), len(s)
        advance = np.zeros((self.loops.count, k))
        advance[driven] = (self.prescribed(s) - self.prescribed(np.array([current]))) / self.loops.units[
            driven, None
        ]
        last = self.unflat(segments[-1].states[[-1]], np.array([current])) if segments else self.start
        linearised = solver.linearise(last) if segments else solver.at_reference
        residual = linearised.changes(advance)[solver.rows]
        rhs = np.zeros((k * self.count, len(solver.loops.unknown)))
        rhs[:, : len(solver.rows)] = residual.reshape(len(solver.rows), len(rhs)).T
        step = solver.whole_step(-linearised.solution(rhs))
        return self.flat(self.loops.displaced(last.repeated(k), np.repeat(advance, self.count, 1) + step))

    def chunks(self, s: Array) -> Iterator[tuple[LoopSolver[E, Q], NDArray[np.intp], Array]]:
        """Yield solvers, the indices of their parameters (n,), and initial guesses of the states.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly mode.
        """
        for end in (float(s.max()), float(s.min())):
            self.extend(end)
        traced = self.traced
        states = np.empty((len(s), traced.segments[0].states.shape[1]))
        solved: dict[int, tuple[LoopSolver[E, Q], list[NDArray[np.intp]]]] = {}
        for segment, index in traced.groups(s):
            states[index] = segment.evaluate(s[index])
            solved.setdefault(id(segment.solver), (segment.solver, []))[1].append(index)
        for solver, indices in solved.values():
            index = np.sort(np.concatenate(indices))
            yield solver, index, states[index]

    @property
    def change_points(self) -> list[float]:
        """Parameters at which assembly modes meet, in the order in which they were passed."""
        return [crossing.parameter for crossing in self.crossings]

    @property
    def traced(self) -> Piecewise[Segment[E, Q]]:
        """All segments; for an untraced path one segment with the start as its only node."""
        start = Segment(
            np.array([self.initial]), self.flat(self.start), np.ones(1), self._solver(self.initial, 1)
        )
        return Piecewise([*self.segments[-1][::-1], *self.segments[1]] or [start])

    def near_change_point(self, s: Array) -> NDArray[np.bool_]:
        """Return which parameters lie in the singular neighbourhood of a change point, (n,)."""
        singular = [np.abs(s - crossing.parameter) < crossing.radius for crossing in self.crossings]
        return np.logical_or.reduce([np.zeros(len(s), dtype=np.bool_), *singular])

    def interpolated(self, s: Array) -> Q:
        """Return coordinates from the segments' polynomials at parameters (n,)."""
        return self.unflat(self.traced.evaluate(s), s)

    def derivatives(self, s: Array) -> tuple[Array, Array]:
        """Return first and second derivatives of flattened states by the parameter, from the polynomials."""
        first = self.traced.derivative()
        return first.evaluate(s), first.derivative().evaluate(s)


def even_change_point(log_determinant: Array) -> int | None:
    """Return the node before a change point at which an even number of pairs of modes meet; or None.

    The determinant has a zero without a sign change there. Its root of that order is smooth only if its sign
    is flipped beyond the change point.

    Args:
        log_determinant: logarithm of the determinant's magnitude at the nodes, (k,).
    """
    roots = np.exp((log_determinant - log_determinant.max())[:, None] / PAIRS)
    errors = np.abs(_errors_with_flips(len(roots)) @ roots).max(1)
    smooth = errors[:-1] < MAX_ERROR_RATIO * errors[-1]
    return int(errors[:-1, smooth.any(0).argmax()].argmin()) if smooth.any() else None


@cache
def _errors_with_flips(count: int) -> Array:
    """Return matrices of interpolation errors with the signs after each node flipped; the last with none."""
    flips = np.where(np.arange(count) > np.arange(count)[:, None], -1.0, 1.0)
    return error_matrix(count) * flips[:, None]


def _shortest(path: ContinuationPath[E, Q], current: float) -> float:
    """Return the length below which a segment has no distinct nodes, or is singular."""
    return max(path.control.min_length, LEAST_SPACINGS * float(np.spacing(abs(current))))


def _end_error(path: ContinuationPath[E, Q], parameter: float, remaining: str) -> AssemblyError:
    """Return the error with the reason why a path ends."""
    text = f"{path.name}: {path.words.mover} cannot pass {path.words.position(parameter)} in this assembly"
    if abs(parameter - path.initial) < AT_START and _singular_start(path):
        return SingularStartError(
            f"{text}, since its start, {path.words.position(path.initial)}, is a dead centre or a "
            f"change point, where assembly modes cannot be distinguished; start elsewhere{remaining}"
        )
    # a screw does not return after a revolution
    start = f" (it starts at {path.words.position(path.initial)})" if abs(path.initial) > REVOLUTION else ""
    return AssemblyError(
        f"{text}{start}; stay on this side of the dead centre or change the dimensions{remaining}"
    )


def _singular_start(path: ContinuationPath[E, Q]) -> bool:
    """Return whether the rank of the loops is lower at the start than near it."""
    loops, first = path.loops, path.first
    step = np.zeros((loops.count, 1))
    step[loops.unknown, 0] = AT_START * first.null_space.sum(0)
    jacobian = loops.linearise(displaced := loops.displaced(path.start, step))[1]
    if not np.isfinite(jacobian).all():
        return False
    return loop_solver(loops, displaced, jacobian=jacobian).nullity < first.nullity


def _with_adequate_rows(
    path: PathStates[E, Q], segment: Segment[E, Q], closed: Linearised, by_determinant: NDArray[np.bool_]
) -> tuple[Segment[E, Q], Linearised]:
    """Return a segment solved by equations of full rank near a singular pose, and its loops.

    Equations that are redundant elsewhere may be independent there.

    Args:
        path: path of the poses.
        segment: segment solved by equations that lose rank at some node.
        closed: loops at its nodes.
        by_determinant: nodes at which the equations are adequate by their determinant.
    """
    old_solver = segment.solver
    # the nearest node may be the singular pose itself
    nearest_index = np.argsort(np.abs(closed.signed_distance))[1:2]
    if by_determinant[nearest_index[0]]:
        return segment, closed
    nearest = path.unflat(segment.states[nearest_index], segment.nodes[nearest_index])
    solver = loop_solver(path.loops, nearest, old_solver.null_space, closed.jacobian[..., nearest_index])
    if np.array_equal(solver.rows, old_solver.rows):
        return segment, closed
    own_determinant = abs(np.linalg.det(closed.matrix[nearest_index[0]]))
    best_determinant = abs(np.linalg.det(solver.linearise(nearest).matrix[0]))
    if solver.nullity != old_solver.nullity or own_determinant > MIN_DETERMINANT_RATIO * best_determinant:
        return segment, closed
    improved = path.closed(solver, segment.nodes, segment.states)
    if improved is None:
        return segment, closed
    return replace(
        segment,
        states=improved.states,
        solver=solver,
        adequate=solver.adequate(improved.linearised)[0][-1:],
    ), improved.linearised
