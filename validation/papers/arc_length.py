"""Tracing of a curve by arc length: tangent, adaptive step, correction, and detection of a closed curve."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root

if TYPE_CHECKING:
    from scipy.integrate import DOP853

# singular values below this fraction of the largest are zero: more than one direction is then free
SINGULAR = 1e-9


@dataclass(frozen=True, slots=True)
class Curve:
    """A traced curve.

    Attributes:
        points: on the curve to rounding, (n, dim); a closed curve ends where it started, up to whole
            periods of its coordinates.
        arc: length along the curve from the start, (n,).
        tangents: unit tangents, (n, dim).
        closed: whether the curve returned to its start.
        length: of the curve, arc[-1].
        steps: of the integration.
        newton: Newton iterations that brought the steps back onto the curve.
    """

    points: Array
    arc: Array
    tangents: Array
    closed: bool
    length: float
    steps: int
    newton: int

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class Frame:
    """The linearised system at a point.

    Attributes:
        tangent: unit tangent in the coordinates of the method, (dim,).
        jacobian: (m, k) by local coordinates.
        local: the tangent in local coordinates, (k,).
        rows: orthonormal combinations of equations that are independent at the point, (m, r).
        free: orthonormal local directions of these equations, (k, r + 1).
        mark_rate: rate of the method's marks along the curve.
    """

    tangent: Array
    jacobian: Array
    local: Array
    rows: Array
    free: Array
    mark_rate: Array


class Route(Protocol):
    """A manifold of one dimension that can be traced."""

    @property
    def name(self) -> str:
        """Name of the curve in messages."""
        ...

    @property
    def scale(self) -> float:
        """Characteristic length of the curve, in the unit of its coordinates."""
        ...

    def frame(self, y: Array, along: Array | None) -> Frame:
        """Linearise at y, the tangent making an acute angle with `along`."""
        ...

    def corrected(self, y: Array) -> tuple[Array, int]:
        """Return the nearest point of the curve by Newton's method, and the iterations it took."""
        ...

    def gap(self, y: Array, other: Array) -> Array:
        """Return the difference of the marks of two points: zero for the same point."""
        ...


def trace(
    route: Route,
    start: Array,
    *,
    direction: ArrayLike | None = None,
    length: float | None = None,
    tolerance: float = 1e-10,
    longest: float | None = None,
    most_steps: int = 10_000,
) -> Curve:
    """Trace a curve from a point of it until it closes or reaches a length.

    Args:
        route: the curve.
        start: a point of it, to within 1e-6 of its size.
        direction: selects one of both, (dim,); None is the default of the route.
        length: of an open curve; None requires a closed curve.
        tolerance: of the integration, in units of the curve's size: it determines the step and the error
            of the arc length; points are on the curve to rounding at any tolerance.
        longest: longest step; None is a quarter of the size.
        most_steps: steps before giving up.

    Raises:
        InputError: if the start is not on the curve, or more than one direction is free there.
        AssemblyError: where branches cross, or if the curve has not closed after `most_steps`.
    """
    from scipy.integrate import DOP853

    y, first, newton = _corrected_start(route, start, direction)
    points, arc, frames = [y], [0.0], [first]
    end = np.inf if length is None else length
    solver = DOP853(
        lambda _, y: route.frame(y, frames[-1].tangent).tangent,
        0.0,
        y,
        end,
        first_step=min(1e-3 * route.scale, end),
        max_step=0.25 * route.scale if longest is None else longest,
        rtol=tolerance,
        atol=tolerance * route.scale,
    )
    plane = first.mark_rate / (first.mark_rate @ first.mark_rate)
    while str(solver.status) == "running":
        if len(arc) > most_steps:
            raise AssemblyError(
                f"{route.name}: the curve has not closed after {most_steps} steps over a length of "
                f"{arc[-1]:.6g}; give the length at which to stop, or allow more steps"
            )
        _take_step(route, solver, points[-1])
        before, after = (float(plane @ route.gap(end, y)) for end in (points[-1], solver.y))
        if before < 0.0 <= after:
            closing = _closed_curve_end(route, solver, y, plane, first)
            if closing is not None:
                end, total, iterations = closing
                frames.append(route.frame(end, frames[-1].tangent))
                return _curve([*points, end], [*arc, total], frames, True, newton + iterations)
        point, frame, iterations = _corrected_step(route, solver, points[-1], frames[-1])
        newton += iterations
        points.append(point)
        arc.append(float(solver.t))
        frames.append(frame)
    return _curve(points, arc, frames, False, newton)


def extrema(route: Route, curve: Curve, rate: Callable[[Frame], float]) -> Array:
    """Return the points of a curve at which a rate along it vanishes, (k, dim).

    Args:
        route: the traced manifold.
        curve: the result.
        rate: of the coordinate that has an extremum.

    Accuracy: exact to rounding; the root is computed on corrected points of the curve.
    """
    result: list[Array] = []
    rates = np.array([rate(route.frame(y, t)) for y, t in zip(curve.points, curve.tangents, strict=True)])
    for i in np.flatnonzero((rates[:-1] < 0.0) != (rates[1:] < 0.0)).tolist():

        def between(fraction: float, i: int = i) -> tuple[Array, float]:
            y = route.corrected(_hermite(curve, i, fraction))[0]
            return y, rate(route.frame(y, curve.tangents[i]))

        result.append(between(root(lambda fraction: between(fraction)[1], 0.0, 1.0))[0])
    return np.array(result).reshape(len(result), curve.points.shape[1])


def _corrected_start(route: Route, start: Array, direction: ArrayLike | None) -> tuple[Array, Frame, int]:
    try:
        y, newton = route.corrected(start)
        moved = float(np.linalg.norm(y - start))
    except AssemblyError as error:
        raise InputError(f"{route.name}: no point of the curve is near the start; {error}") from error
    if not moved <= 1e-6 * route.scale:
        raise InputError(
            f"{route.name}: the start is {moved:.3g} off the curve; the nearest point of it is {y.tolist()}"
        )
    try:
        along = None if direction is None else np.asarray(direction, dtype=np.float64)
        return y, route.frame(y, along), newton
    except AssemblyError as error:
        raise InputError(f"{error}; use another start") from error


def _take_step(route: Route, solver: "DOP853", q: Array) -> None:
    """Advance the solver by a step."""
    solver.step()
    if str(solver.status) == "failed":
        raise AssemblyError(
            f"{route.name}: no step is short enough at {q.tolist()}; the curve is not smooth there"
        )


def _corrected_step(route: Route, solver: "DOP853", q: Array, previous: Frame) -> tuple[Array, Frame, int]:
    """Correct the end of a step and continue the solver there; return point, frame and iterations."""
    point, iterations = route.corrected(solver.y)
    frame = route.frame(point, previous.tangent)
    if _passes_branch_point(previous, frame):
        raise AssemblyError(
            f"{route.name}: branches of the curve cross between {q.tolist()} and {point.tolist()}; "
            "the continuation is not determined there; change the dimensions a little"
        )
    solver.y, solver.f = point, frame.tangent
    return point, frame, iterations


def _closed_curve_end(
    route: Route, solver: "DOP853", start: Array, plane: Array, first: Frame
) -> tuple[Array, float, int] | None:
    """Return the end of a closed curve, its length and the iterations, if the last step passed the start."""
    dense = solver.dense_output()
    q = root(lambda s: float(plane @ route.gap(dense(s), start)), float(solver.t_old or 0.0), float(solver.t))
    if not np.linalg.norm(route.gap(dense(q), start)) <= 1e-3 * route.scale:
        return None
    y, first_iterations = route.corrected(dense(q))
    frame = route.frame(y, first.tangent)
    gap, tangent_change = route.gap(y, start), frame.mark_rate - first.mark_rate
    same_direction = np.linalg.norm(tangent_change) <= 1e-3 * np.linalg.norm(first.mark_rate)
    if not (np.linalg.norm(gap) <= 1e-6 * route.scale and same_direction):
        return None
    excess = float(plane @ gap)
    end, more_iterations = route.corrected(y - excess * frame.tangent)
    return end, q - excess, first_iterations + more_iterations


def _passes_branch_point(before_frame: Frame, after_frame: Frame) -> bool:
    """Return whether the determinant of the system changed its sign: a branch point was passed."""

    def determinant(frame: Frame) -> float:
        across = before_frame.rows.T @ frame.jacobian @ before_frame.free
        return float(np.linalg.det(np.vstack([across, frame.local @ before_frame.free])))

    return not determinant(before_frame) * determinant(after_frame) > 0.0


def _hermite(curve: Curve, i: int, fraction: float) -> Array:
    step = curve.arc[i + 1] - curve.arc[i]
    p, q = curve.points[i], curve.points[i + 1]
    a, b = step * curve.tangents[i], step * curve.tangents[i + 1]
    remaining = 1.0 - fraction
    return remaining**2 * ((1.0 + 2.0 * fraction) * p + fraction * a) + fraction**2 * (
        (3.0 - 2.0 * fraction) * q - remaining * b
    )


def _curve(points: list[Array], arc: list[float], frames: list[Frame], closed: bool, newton: int) -> Curve:
    tangents = np.array([frame.tangent for frame in frames])
    return Curve(np.array(points), np.array(arc), tangents, closed, float(arc[-1]), len(arc) - 1, newton)
