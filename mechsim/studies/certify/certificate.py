"""Certificate of a motion: its segments proven, joined, and what could not be proven, with the reason."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import units
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.arrays import Array
from mechsim.studies.certify.computed_motion import ComputedMotion, computed_motion
from mechsim.studies.certify.segments import (
    Segments,
    halves,
    segments_that_join,
    tested_segments,
    with_misses,
)
from mechsim.studies.certify.tolerances import joint_radii
from mechsim.studies.sensitivity.tolerances import parsed_tolerances
from mechsim.subjects.readers import load, parametric_model

if TYPE_CHECKING:
    from mechsim.subjects.readers import Model

# segments at first of a radian of the path parameter; the shortest, relative to the range; and the most
FIRST_PER_UNIT, SHORTEST, MAX_SEGMENTS = 20, 1e-10, 200_000
# tests in a row that fail at a single driver position: shorter segments do not help
MAX_MISSES = 4


@dataclass(frozen=True)
class SingularPoint:
    """A singular configuration on the path, enclosed.

    Attributes:
        parameter: path parameter.
        width: half-width of the interval that contains it.
        kind: "dead centre", "change point", or "not enclosed" where no test located it.
    """

    parameter: float
    width: float
    kind: str


@dataclass(frozen=True)
class Certificate:
    """What interval arithmetic proves of a motion.

    Attributes:
        name: of the mechanism.
        certified: whether over the whole range exactly one configuration lies in the tube, the Jacobian is
            regular there, and neighbouring segments join.
        reason: why it is not certified; empty if it is.
        range: of the path parameter, from and to.
        segments: number of segments proven.
        proven: part of the range that they cover.
        singular: singular points of the motion.
        min_singular_value: lower bound of the smallest singular value of the Jacobian on the proven segments,
            in radians and parts of the characteristic length.
        tube: largest half-width of the tube in which the configuration lies, in the same units.
        equations: number of equations that are solved; others hold identically.
    """

    name: str
    certified: bool
    reason: str
    range: tuple[float, float]
    segments: int
    proven: float
    singular: tuple[SingularPoint, ...]
    min_singular_value: float
    tube: float
    equations: int

    def __bool__(self) -> bool:
        return self.certified


def certified_motion(
    solver: KinematicSolver, between: tuple[float, float] | None, radii: Mapping[str, Array]
) -> Certificate:
    """Return the certificate of a motion.

    Args:
        solver: of the mechanism.
        between: range of the path parameter; None for all of it.
        radii: half-widths of the mechanism's dimensions, as in `ClosureEquations`.
    """
    if between is not None and not between[0] < between[1]:
        raise InputError(f"the range {between[0]:g} to {between[1]:g} rad is empty; give from < to")
    try:
        motion = computed_motion(solver, between, radii)
    except AssemblyError as error:
        return _uncertified(solver.name, between or (0.0, 0.0), str(error), 0)
    equations = motion.equations
    solved, unknown = len(equations.kept), len(equations.unknown)
    whole = (motion.low, motion.high)
    if solved < unknown:
        return _uncertified(
            solver.name, whole, f"{unknown - solved} coordinates are free at fixed drivers", solved
        )
    if solved > unknown:
        reason = (
            f"overconstrained: {solved} equations for {unknown} unknowns, none of which holds identically"
        )
        return _uncertified(solver.name, whole, reason, solved)
    proven, rest = proven_segments(motion)
    return _certificate(solver.name, motion, proven, rest)


def _uncertified(name: str, between: tuple[float, float], reason: str, equations: int) -> Certificate:
    return Certificate(name, False, reason, between, 0, 0.0, (), 0.0, np.inf, equations)


def proven_segments(motion: ComputedMotion) -> tuple[Segments, list[tuple[float, float]]]:
    """Return the segments that are proven, and the intervals on which none is, in ascending order."""
    count = max(2, int(np.ceil(FIRST_PER_UNIT * (motion.high - motion.low))))
    edges = np.linspace(motion.low, motion.high, count + 1)
    guess = motion.configurations(0.5 * (edges[:-1] + edges[1:]))
    waiting = [tested_segments(motion, edges[:-1], edges[1:], guess)]
    shortest = SHORTEST * (motion.high - motion.low)
    proven: list[Segments] = []
    rest: list[tuple[float, float]] = []
    while waiting:
        segments = waiting.pop()
        proven.append(segments.select(segments.proven))
        failed = with_misses(motion, segments.select(~segments.proven))
        count += len(failed)
        final = (failed.half < shortest) | (failed.misses >= MAX_MISSES) | (count > MAX_SEGMENTS)
        rest += [*zip(failed.low[final].tolist(), failed.high[final].tolist(), strict=True)]
        failed = failed.select(~final)
        if len(failed):
            both = [tested_segments(motion, *half) for half in halves(failed, motion.equations)]
            first, second = (replace(half, misses=failed.misses) for half in both)
            waiting.append(first.joined_with(second))
    segments = proven[0]
    for chunk in proven[1:]:
        segments = segments.joined_with(chunk)
    return segments, _merged(rest)


def _merged(intervals: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return intervals in ascending order, those that touch as one."""
    merged: list[tuple[float, float]] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            low = merged.pop()[0]
        merged.append((low, high))
    return merged


def _certificate(
    name: str, motion: ComputedMotion, segments: Segments, rest: list[tuple[float, float]]
) -> Certificate:
    joins = segments_that_join(motion, segments)
    proven = float((segments.high - segments.low).sum()) / (motion.high - motion.low)
    covered = len(segments) > 0 and segments.low[0] == motion.low and segments.high[-1] == motion.high
    reason = ""
    if motion.end_message:
        reason = motion.end_message
    elif rest:
        reason = (
            f"no test succeeded at {len(rest)} intervals, the first from {rest[0][0]:.9g} to {rest[0][1]:.9g}"
        )
    elif not joins.all():
        first = int(np.argmin(joins))
        reason = f"solutions are not proven to join at {segments.high[first]:.9g}"
    elif not covered:
        reason = "segments do not cover the range"
    return Certificate(
        name,
        not reason,
        reason,
        (motion.low, motion.high),
        len(segments),
        proven,
        (),
        float(segments.singular_value.min(initial=np.inf)),
        float(segments.enclosure.max(initial=0.0)),
        len(motion.equations.kept),
    )


def certify(
    model: "Model",
    angles: str | tuple[float, float] | None = None,
    *,
    within: Mapping[str, str | float] | None = None,
    set: Mapping[str, str | float] | None = None,
    **options: Any,
) -> Certificate:
    """Prove by interval arithmetic that a motion has one regular configuration at each driver position.

    The proof covers a tube around the computed motion: at each driver position exactly one configuration lies
    in it, the Jacobian of the loop equations is regular in it, and neighbouring segments of the tube join.

    Args:
        model: as `load` takes it.
        angles: range of the crank angle, as "10:350deg" or in [rad]; None for all that it reaches.
            Under motion laws the range is all of them.
        within: dimension -> tolerance, as "0.02mm" or in SI; the proof then covers all mechanisms within.
        set: parameter -> its value, as `load` takes it.
        options: what else `load` takes.

    Returns:
        The certificate; what is not proven is not certified, with the reason and the singular points.

    Raises:
        InputError: for an empty range, an unknown dimension, and as `load`.

    Source: Krawczyk (1969); Neumaier, Interval Methods for Systems of Equations (1990), section 5.1.

    Example:
        >>> import mechsim as ms
        >>> ms.certify("four_bar").certified
        True
    """
    radii: Mapping[str, Array] = {}
    if within:
        designs = parametric_model(model, set, **options)
        solver = designs.make({})
        bounds = parsed_tolerances(within, designs.dimensions, solver.mechanism)
        if bounds.clearances:
            raise InputError("within takes tolerances of dimensions; a clearance of a joint is none")
        radii = joint_radii(designs, bounds.bounds)
    else:
        solver = load(model, set, **options)
    solver.motion_laws.require_drivers(solver.mechanism)
    if angles is not None and not solver.motion_laws.crank:
        raise InputError(f"{solver.name} is driven by motion laws; angles are of a crank: give a duration")
    return certified_motion(solver, _range_of(angles), radii)


def _range_of(angles: str | tuple[float, float] | None) -> tuple[float, float] | None:
    if angles is None:
        return None
    ends = units.parse_angles(angles.replace(":", ","), "the range") if isinstance(angles, str) else angles
    if len(ends) != 2:
        raise InputError(f"the range {angles!r} is not two angles; write start:stop, for example 10:350deg")
    return float(ends[0]), float(ends[1])
