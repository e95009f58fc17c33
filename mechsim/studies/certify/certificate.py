"""Certificate of a motion: proven segments, their joins, and intervals without a proof, with the reason."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import units
from mechsim.errors import AssemblyError, InputError
from mechsim.io.readers import load, open_model, parametric_model
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import join, select_instants
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import Progress, no_progress
from mechsim.studies.certify.computed_motion import ComputedMotion, computed_motion, law_not_enclosed
from mechsim.studies.certify.segments import (
    Bools,
    Segments,
    batches,
    halves,
    inside,
    segments_that_join,
    tested_segments,
    with_misses,
)
from mechsim.studies.certify.singular_points import SingularPoint, enclosed_singular_point
from mechsim.studies.certify.toml_intervals import radii_within
from mechsim.studies.sensitivity.tolerances import parsed_tolerances

if TYPE_CHECKING:
    from mechsim.io.readers import Model

# initial segments per radian of the path parameter; minimum half-length of a segment relative to the range;
# maximum number of segments
FIRST_PER_UNIT, SHORTEST, MAX_SEGMENTS = 20, 1e-9, 200_000
# successive tests that fail even at a single driver position, after which a segment is not halved again
MAX_MISSES = 4
# half-length relative to the range below which failed segments are also tested at a single driver position
COARSE = 1e-3
# maximum number of intervals without proof that are searched for singular points
MAX_SINGULAR = 20


def instant_text(value: float, unit: str, digits: int) -> str:
    """Return a crank angle in degrees, or a time or coordinate in its unit."""
    return f"{math.degrees(value):.{digits}g} deg" if unit == "rad" else f"{value:.{digits}g} {unit}"


@dataclass(frozen=True)
class Certificate:
    """Result of an interval proof of a motion.

    Attributes:
        name: name of the mechanism.
        certified: whether, over the whole range, exactly one configuration lies in the tube, the Jacobian is
            regular there, and neighbouring segments join.
        reason: reason why the motion is not certified; empty if it is.
        range: lower and upper end of the crank angle in [rad], or of the time in [s] under motion laws.
        segments: number of proven segments.
        proven: fraction of the range that they cover.
        singular: singular points of the motion.
        min_singular_value: lower bound of the smallest singular value of the Jacobian on the proven segments,
            in radians and characteristic lengths; infinite without loops.
        tube: largest half-width of the tube that contains the configuration, in the same units.
        equations: number of solved equations; the others hold identically.
        unit: unit of range and singular points, "rad" or "s".
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
    unit: str = "rad"

    def __bool__(self) -> bool:
        return self.certified

    @property
    def summary(self) -> str:
        """The proven statement, or the reason for a failure, in one sentence."""
        low, high = (instant_text(end, self.unit, 4) for end in self.range)
        if not self.certified:
            return f"not certified from {low} to {high}: {self.reason}"
        certified = f"certified from {low} to {high}: at each driver position exactly one configuration"
        if not self.equations:
            return f"{certified}, for there is no loop"
        return (
            f"{certified} in a tube of half-width {self.tube:.2g} about the computed motion, and no "
            f"singularity (smallest singular value at least {self.min_singular_value:.2g}, "
            f"{self.segments} segments)"
        )


# shares of the time after which the motion is solved and its segments are tested; measured in humanoid_ankle
SOLVED, TESTED = 0.1, 0.55


def certified_motion(
    solver: KinematicSolver,
    between: tuple[float, float] | None = None,
    radii: Mapping[str, Array] | None = None,
    progress: Progress = no_progress,
) -> Certificate:
    """Return the certificate of a motion.

    Args:
        solver: solver of the mechanism.
        between: range of the path parameter; None for the whole range.
        radii: half-widths of the mechanism's dimensions, as in `ClosureEquations`; None for exact dimensions.
        progress: called with a text and the finished fraction.
    """
    if between is not None and not between[0] < between[1]:
        raise InputError(f"the range {between[0]:g} to {between[1]:g} rad is empty; give from < to")
    laws = solver.motion_laws

    def uncertified(between: tuple[float, float], reason: str, equations: int = 0) -> Certificate:
        proof = Certificate(solver.name, False, reason, between, 0, 0.0, (), 0.0, np.inf, equations)
        return _in_instants(proof, laws)

    requested = between or (0.0, 0.0 if laws.crank else laws.length)
    if driver := law_not_enclosed(laws):
        reason = (
            f"the motion law of {driver} cannot be enclosed; give a table, or an expression of "
            "+ - * / **, sin, cos, tan, sqrt and exp"
        )
        return uncertified(requested, reason)
    progress("the motion", 0.0)
    try:
        motion = computed_motion(solver, between, radii or {})
    except AssemblyError as error:
        return uncertified(requested, str(error))
    equations = motion.equations
    solved, unknown = len(equations.kept), len(equations.unknown)
    whole = (motion.low, motion.high)
    if solved < unknown:
        return uncertified(whole, f"{unknown - solved} coordinates are free at fixed drivers", solved)
    if solved > unknown:
        motion = motion.with_independent_rows()
    proof = _in_instants(_certificate(solver.name, motion, between or whole, progress), laws)
    if solved == unknown or not proof.certified:
        return proof
    reason = (
        f"overconstrained: {unknown} of {solved} equations have exactly one solution in the tube, a regular "
        "one; that it satisfies the others is not proven, for they hold only with exact dimensions"
    )
    return replace(proof, certified=False, reason=reason)


def _in_instants(proof: Certificate, laws: MotionLaws) -> Certificate:
    """Return the certificate with its path parameters as crank angles in [rad] or times in [s]."""
    return replace(
        proof,
        unit=laws.unit,
        range=(proof.range[0] / laws.rate, proof.range[1] / laws.rate),
        singular=tuple(
            replace(point, parameter=point.parameter / laws.rate, width=point.width / laws.rate)
            for point in proof.singular
        ),
    )


def proven_segments(
    motion: ComputedMotion, progress: Progress = no_progress
) -> tuple[Segments, list[tuple[float, float]], bool]:
    """Return the proven segments, the intervals without a proof, and whether `MAX_SEGMENTS` were tested."""
    count = max(2, int(np.ceil(FIRST_PER_UNIT * (motion.high - motion.low))))
    edges = np.linspace(motion.low, motion.high, count + 1)
    guess = motion.configurations(0.5 * (edges[:-1] + edges[1:]))
    untested = batches(count)[::-1]
    waiting: list[Segments] = []
    shortest, finished = SHORTEST * (motion.high - motion.low), 0.0
    proven: list[Segments] = []
    rest: list[tuple[float, float]] = []
    while waiting or untested:
        if waiting:
            halved = waiting.pop()
            segments = tested_segments(motion, *halves(halved, motion.equations))
            segments = replace(segments, misses=np.tile(halved.misses, 2))
        else:
            batch = untested.pop()
            segments = tested_segments(motion, edges[batch], edges[batch + 1], select_instants(guess, batch))
        proven.append(select_instants(segments, segments.proven))
        finished += float((proven[-1].high - proven[-1].low).sum())
        fraction = finished / (motion.high - motion.low)
        progress(f"{count:,} segments, at most {MAX_SEGMENTS:,}", SOLVED + (TESTED - SOLVED) * fraction)
        failed = select_instants(segments, ~segments.proven)
        if failed.half.max(initial=0.0) < COARSE * (motion.high - motion.low):
            failed = with_misses(motion, failed)
        count += len(failed)
        final = (failed.half < shortest) | (failed.misses >= MAX_MISSES) | (count > MAX_SEGMENTS)
        rest += [*zip(failed.low[final].tolist(), failed.high[final].tolist(), strict=True)]
        failed = select_instants(failed, ~final)
        waiting += [select_instants(failed, batch) for batch in batches(len(failed)) if len(batch)]
    segments = join(proven)
    # intervals in ascending order; adjacent intervals are merged
    merged: list[tuple[float, float]] = []
    for low, high in sorted(rest):
        if merged and low <= merged[-1][1]:
            low = merged.pop()[0]
        merged.append((low, high))
    return select_instants(segments, np.argsort(segments.low)), merged, count > MAX_SEGMENTS


def _certificate(
    name: str, motion: ComputedMotion, between: tuple[float, float], progress: Progress
) -> Certificate:
    segments, rest, spent = proven_segments(motion, progress)
    progress(f"{len(segments):,} segments that join", TESTED)
    joins = segments_that_join(motion, segments) if len(segments) else np.ones(0, dtype=np.bool_)
    ends = [end for end, target in zip((motion.low, motion.high), between, strict=True) if end != target]
    singular = _singular_points(motion, rest, ends if motion.end_message else [])
    reason = _reason(motion, segments, rest, joins, singular)
    if reason and spent:
        reason += f"; the work budget of {MAX_SEGMENTS:,} segments is spent"
    return Certificate(
        name,
        not reason,
        reason,
        between,
        len(segments),
        float((segments.high - segments.low).sum()) / (between[1] - between[0]),
        singular,
        float(segments.singular_value.min(initial=np.inf)),
        float(segments.enclosure.max(initial=0.0)),
        len(motion.equations.kept),
    )


def _singular_points(
    motion: ComputedMotion, rest: list[tuple[float, float]], ends: list[float]
) -> tuple[SingularPoint, ...]:
    """Return the singular points in the intervals without a proof and at the ends of the motion."""
    if len(rest) > MAX_SINGULAR:
        return ()
    middles = [0.5 * (low + high) for low, high in rest if not any(low <= end <= high for end in ends)]
    points: list[SingularPoint] = []
    for parameter in sorted([*ends, *middles]):
        point = enclosed_singular_point(motion, parameter)
        same = points and abs(point.parameter - points[-1].parameter) <= point.width + points[-1].width
        if not same or not np.isfinite(point.width):
            points.append(point)
    return tuple(points)


def _reason(
    motion: ComputedMotion,
    segments: Segments,
    rest: list[tuple[float, float]],
    joins: Bools,
    singular: tuple[SingularPoint, ...],
) -> str:
    """Return the reason why a motion is not certified; empty if it is."""

    def instant(parameter: float) -> str:
        return instant_text(parameter / motion.motion_laws.rate, motion.motion_laws.unit, 9)

    enclosed = [point for point in singular if np.isfinite(point.width)]
    if singular and len(enclosed) == len(singular):
        labels = ", ".join(f"{instant(point.parameter)} ({point.kind})" for point in singular)
        return f"the motion is singular at {labels}"
    if motion.end_message:
        return motion.end_message
    if rest:
        low, high = rest[0]
        return f"no proof on {len(rest)} intervals, the first from {instant(low)} to {instant(high)}"
    if not joins.all():
        return f"segments are not proven to join at {instant(segments.high[int(np.argmin(joins))])}"
    # the computed motion is solved at the centres: near a singularity what is interpolated has errors above
    # the width of the tubes
    centre = segments.centre
    solved = tested_segments(motion, centre, centre, motion.configurations(centre))
    if not (solved.proven & inside(motion.equations, solved, segments)).all():
        return "the tube leaves the computed motion"
    covered = len(segments) and segments.low[0] == motion.low and segments.high[-1] == motion.high
    return "" if covered else "segments do not cover the range"


def certify(
    model: Model,
    angles: str | tuple[float | str, float | str] | None = None,
    *,
    within: Mapping[str, str | float] | None = None,
    set: Mapping[str, str | float] | None = None,
    progress: Progress = no_progress,
    **options: Any,
) -> Certificate:
    """Prove by interval arithmetic that a motion has one regular configuration at each driver position.

    The proof covers a tube around the computed motion: at each driver position exactly one configuration lies
    in it, the Jacobian of the loop equations is regular in it, and neighbouring segments of the tube join.

    Args:
        model: as `load` takes it.
        angles: range of the crank angle, as "10:350deg", or its ends as text or in [rad]; None for the whole
            reachable range. Under motion laws the range is their whole duration.
        within: dimension -> tolerance, as "0.02mm" or in SI; the proof then covers all mechanisms within.
        set: parameter -> its value, as `load` takes it.
        progress: called with a text and the finished fraction.
        options: further arguments of `load`.

    Returns:
        The certificate; without a complete proof it states the reason and the singular points.

    Raises:
        InputError: if the range is empty or a dimension is unknown, and as in `load`.

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
        bounds = parsed_tolerances(within, designs.dimensions, solver.mechanism, declared=solver.written)
        if bounds.clearances:
            raise InputError(
                "within takes tolerances of dimensions, not clearances of joints; leave the clearance out"
            )
        radii = radii_within(open_model(model), set or {}, designs, bounds.bounds)
    else:
        solver = load(model, set, **options)
    solver.motion_laws.require_drivers(solver.mechanism)
    if angles is None:
        return certified_motion(solver, None, radii, progress)
    if not solver.motion_laws.crank:
        raise InputError(
            f"{solver.name} is driven by motion laws, and angles apply to a crank; give a duration"
        )
    ends = units.parse_angles(angles.replace(":", ","), "the range") if isinstance(angles, str) else angles
    if len(ends) != 2:
        raise InputError(f"the range {angles!r} is not two angles; write start:stop, for example 10:350deg")
    low, high = (float(units.si(end, "rad", "the range")) for end in ends)
    return certified_motion(solver, (low, high), radii, progress)
