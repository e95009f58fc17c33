"""A curve of assemblies in segments: corrected nodes, and polynomials through them over arc length.

The polynomials of the previous segment predict the next. A corrector perpendicular to the curve closes the
loops at all nodes together. A segment is accepted if it is smooth and close to its prediction. A turning
point of a coordinate needs no special treatment. A branch point is passed on the smooth branch; it is
located, and no node lies near it, since the equations are singular there.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.continuation.free_loops import CorrectedNodes, FreeLoops
from mechsim.kinematics.loops.constraints import CoupledRow, TreeLoops, TreeSolver
from mechsim.kinematics.loops.kinematics import Coordinates, link_poses
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array
from mechsim.numerics.collocation import Interpolant, Piecewise, extrapolated, integral, through
from mechsim.numerics.newton import root

# limits for a closed curve: displacement in characteristic lengths, and revolutions of a multi-turn angle
# (one in a coupling, as a screw's)
MAX_DISPLACEMENT, MAX_REVOLUTIONS = 1000, 100


def _counted(row: CoupledRow) -> NDArray[np.bool_]:
    """Return of which coordinates a coupling counts revolutions, (count,)."""
    right = (row.right_weights != 0.0) & (not row.coupling.repeats)
    return ((row.left_weights != 0.0) | right) & (not row.has_revolutions)


def require_return(loops: TreeLoops, initial: Coordinates, current: Coordinates) -> None:
    """Raise AssemblyError if a displacement or multi-turn angle is too large for a closed curve.

    Args:
        loops: of the mechanism.
        initial: coordinates at the start of the curve.
        current: coordinates at the present point.

    Raises:
        AssemblyError: naming the coordinate.
    """
    tree, counted = loops.tree, np.zeros(loops.tree.count, dtype=np.bool_)
    for coupling in loops.couplings:
        counted |= _counted(coupling)
    displacement = np.abs(current.values - initial.values)[:, 0] / loops.units
    limit = np.where(tree.slides, MAX_DISPLACEMENT, np.where(counted, MAX_REVOLUTIONS * REVOLUTION, np.inf))
    index = int(np.argmax(displacement / limit)) if len(displacement) else 0
    if not len(displacement) or displacement[index] < limit[index]:
        return
    name = next(coordinate for coordinate, address in tree.index_of.items() if address == index)
    reason = (
        f"has moved by {MAX_DISPLACEMENT:,} times the characteristic length {tree.length:.4g} m"
        if tree.slides[index]
        else f"has made {MAX_REVOLUTIONS} revolutions, and its value is multi-turn"
    )
    raise AssemblyError(
        f"{tree.mechanism.name}: the curve of assemblies is not closed: {name} {reason}; solve or simulate "
        "it over the range you need, or limit the coordinate by links"
    )


# nodes of a segment; every second one predicts the next segment
NODES = 17
# first, longest and shortest arc length of a segment
FIRST_LENGTH, MAX_LENGTH, MIN_LENGTH = 0.05, 3.0, 1e-9
# segments shorter than this predict the next by polynomials of this low degree
SHORT_LENGTH, LOW_DEGREE = 1e-3, 3
# limits for an accepted segment: interpolation error of every second node, and distance of the features from
# their prediction relative to the length of the segment
MAX_INTERPOLATION_ERROR, MAX_CORRECTOR_DISPLACEMENT = 3e-9, 2e-2
# least cosine between the tangents at a segment's start and at any of its nodes
MIN_COSINE = 0.5
# angle between these tangents for which the next segment is planned
MAX_GROWTH_ANGLE = 0.9 * float(np.arccos(MIN_COSINE))
# arc length that nodes keep from a branch point, which is searched for where the singular value that vanishes
# there is below SEARCH_RATIO of the largest
MIN_DISTANCE_FROM_BRANCH_POINT, SEARCH_RATIO = 2e-3, 0.3
# residual of a coupling at states shifted by whole revolutions, in its unit, at which it repeats
REPEATED = 1e-6
# limit on the number of segments of a curve
MAX_SEGMENTS = 3000


@dataclass(frozen=True)
class CurveSegment(Interpolant):
    """A segment of a curve: polynomials over arc through the flattened coordinates of its nodes.

    Attributes:
        coordinates: at the nodes.
        features: polynomials of the pose features.
        tangent: rates of the unknown coordinates at its end, in their units, (unknowns,).
        solver: solves its poses.
        largest_singular_value: maximum so far of the singular value that vanishes at branch points.
        longest: arc length that its accuracy and its change of direction would have allowed.
    """

    coordinates: Coordinates
    features: Interpolant
    tangent: Array
    solver: TreeSolver
    largest_singular_value: float
    longest: float

    @cached_property
    def feature_rates(self) -> Interpolant:
        """Derivatives of the pose features by arc."""
        return self.features.derivative()

    def predicted(self, arc: Array) -> Array:
        """Return flattened coordinates extrapolated beyond its end by a polynomial of lower degree.

        A higher degree amplifies the rounding of the nodes, most of all in short segments.
        """
        degree = NODES // 2 if self.length > SHORT_LENGTH else LOW_DEGREE
        scaled, ahead = ((2.0 * values - self.low - self.high) / self.length for values in (self.nodes, arc))
        return extrapolated(scaled, self.states, degree, ahead)


@dataclass(frozen=True)
class TracedCurve(Piecewise[CurveSegment]):
    """A closed curve as segments by arc.

    Attributes:
        length: arc of the whole curve.
        branch_points: arcs of its branch points.
    """

    length: float
    branch_points: tuple[float, ...]


def trace_curve(
    loops: FreeLoops,
    start: Coordinates,
    progress: Callable[[int, int], None] | None = None,
) -> TracedCurve:
    """Trace a curve of assemblies until it returns to its start.

    Args:
        loops: of the mechanism.
        start: one set of closed coordinates, away from branch points.
        progress: called after each segment with the number of segments and their limit.

    Raises:
        AssemblyError: where the curve has no smooth continuation, or does not close.
        MobilityError: where more than one degree of freedom is undetermined.
    """
    tree = loops.loops.tree
    along = np.zeros(tree.count)
    along[tree.index_of[tree.mechanism.drivers[0]]] = 1.0
    solver, initial = loops.solver(start, along[loops.loops.unknown]), start
    segments: list[CurveSegment] = []
    branch_points: list[float] = []
    length, largest = FIRST_LENGTH, 0.0
    start_node = loops.close(solver, start)
    assert start_node is not None
    plane = start_node.rates[0] / np.linalg.norm(start_node.rates[0])
    while len(segments) < MAX_SEGMENTS:
        segment, crossed, length = _next_segment(loops, segments, solver, start, length, largest)
        if segment is None:
            if length < MIN_LENGTH:
                mechanism, driver = tree.mechanism, tree.mechanism.drivers[0]
                raise AssemblyError(
                    f"{mechanism.name}: the curve of assemblies has no smooth continuation at {driver} = "
                    f"{start.values[tree.index_of[driver], 0]:.7g}; change the dimensions a little"
                )
            continue
        branch_points += crossed
        closing_arc = _closing_arc(segment, start_node.features[0], plane, not segments)
        if closing_arc is not None and not _same_revolutions(
            loops, [*segments, segment], closing_arc, initial
        ):
            closing_arc = None
        segments.append(segment)
        if closing_arc is not None:
            return TracedCurve(
                tuple(segments), closing_arc, tuple(arc for arc in branch_points if arc < closing_arc)
            )
        if progress is not None:
            progress(len(segments), MAX_SEGMENTS)
        largest = max(largest, segment.largest_singular_value)
        start = loops.unflat(segment.states[-1:])
        require_return(loops.loops, initial, start)
        solver = loops.solver(start, segment.tangent, solver)
    raise AssemblyError(
        f"{loops.loops.tree.mechanism.name}: the curve has not returned to its start after an arc length of "
        f"{segments[-1].high:.4g} in {MAX_SEGMENTS:,} segments, the limit; gears repeat after as many "
        "revolutions as their ratio requires, and never for an irrational ratio: change it, or solve the "
        "mechanism over the revolutions you need"
    )


def _next_segment(
    loops: FreeLoops,
    traced: list[CurveSegment],
    solver: TreeSolver,
    start: Coordinates,
    length: float,
    largest: float,
) -> tuple[CurveSegment | None, list[float], float]:
    """Return the next segment, or None to try another length; its branch points; and the length to try."""
    low = traced[-1].high if traced else 0.0
    arcs = 0.5 * length * (1.0 - np.cos(np.pi * np.arange(NODES) / (NODES - 1)))
    straight = np.zeros((loops.loops.tree.count, NODES))
    straight[loops.loops.unknown] = np.outer(solver.null_space[0], arcs)
    guesses = [loops.unflat(traced[-1].predicted(low + arcs))] if traced else []
    if length < SHORT_LENGTH or not traced:
        # near high curvature the tangent is less affected by rounding than the polynomial prediction
        guesses.append(loops.loops.displaced(start.repeated(NODES), straight))
    segment = nodes = None
    for guess in guesses:
        nodes = loops.close(solver, guess)
        segment = None if nodes is None else _accepted_segment(loops, nodes, guess, solver, low, largest)
        if segment is not None:
            break
    if segment is None or nodes is None:
        return None, [], 0.5 * length
    half = through(segment.nodes[::2], segment.states[::2])
    error = float(np.abs(half.evaluate(segment.nodes[1::2]) - segment.states[1::2]).max())
    if error > MAX_INTERPOLATION_ERROR:
        return None, [], min(0.5, 0.9 * (MAX_INTERPOLATION_ERROR / error) ** (2.0 / NODES)) * length
    branch_points = _branch_points(loops, segment, nodes)
    flips = int((nodes.determinant_sign[1:] != nodes.determinant_sign[:-1]).sum())
    if flips > len(branch_points):
        # no branch point, but high curvature, which a shorter segment resolves
        return None, [], 0.5 * length
    if any(np.abs(segment.nodes - arc).min() < MIN_DISTANCE_FROM_BRANCH_POINT for arc in branch_points):
        return None, [], 0.87 * length
    growth = 0.8 * (MAX_INTERPOLATION_ERROR / max(error, 1e-16)) ** (2.0 / NODES)
    longest = min(MAX_LENGTH, max(0.5, min(growth, segment.longest / segment.length)) * segment.length)
    # where these lengths decrease, towards high curvature, they go on to do so
    change = min(1.0, longest / traced[-1].longest) if traced else 1.0
    next_length = max(0.5 * segment.length, change * longest)
    return replace(segment, longest=longest), branch_points, next_length


def _accepted_segment(
    loops: FreeLoops,
    nodes: CorrectedNodes,
    guess: Coordinates,
    solver: TreeSolver,
    low: float,
    largest: float,
) -> CurveSegment | None:
    """Return the segment through corrected nodes; None if far from the prediction or out of order."""
    speed = np.sqrt((nodes.rates**2).sum(1))
    cosines = (nodes.rates @ nodes.rates[0]) / (speed * speed[0])
    # nodes that coincide within rounding determine no polynomial
    distinct = np.diff(nodes.length) > 1e-14 * max(1.0, low)
    if not (cosines.min() > MIN_COSINE and distinct.all()):
        return None
    arcs = low + integral(nodes.length, speed)
    predicted = loops.features.values(link_poses(loops.loops.tree, guess))
    if not np.abs(predicted - nodes.features).max() < MAX_CORRECTOR_DISPLACEMENT * (arcs[-1] - low):
        return None
    curve, features = (
        through(arcs, values) for values in (loops.loops.flat(nodes.coordinates), nodes.features)
    )
    largest = max(largest, float(nodes.singular_values.max()))
    angle = float(np.arccos(np.minimum(cosines, 1.0)).max())
    longest = min(2.0, MAX_GROWTH_ANGLE / max(angle, 1e-16)) * (arcs[-1] - low)
    tangent = nodes.tangents[-1]
    return CurveSegment(
        arcs, curve.states, curve.weights, nodes.coordinates, features, tangent, solver, largest, longest
    )


def _branch_points(loops: FreeLoops, segment: CurveSegment, nodes: CorrectedNodes) -> list[float]:
    """Return the arcs of the branch points in a segment."""
    branch_points: list[float] = []
    least = nodes.singular_values
    for i in range(NODES):
        before, after = max(i - 1, 0), min(i + 1, NODES - 1)
        if not (
            least[i] <= min(least[before], least[after])
            and least[i] < SEARCH_RATIO * segment.largest_singular_value
        ):
            continue
        low, high = float(segment.nodes[before]), float(segment.nodes[after])
        arc = loops.branch_point(segment.solver, segment.evaluate, low, high, segment.largest_singular_value)
        if arc is not None and all(
            abs(arc - other) >= MIN_DISTANCE_FROM_BRANCH_POINT for other in branch_points
        ):
            branch_points.append(arc)
    return branch_points


def _closing_arc(segment: CurveSegment, start: Array, plane: Array, first: bool) -> float | None:
    """Return the arc at which a segment returns to the start of the curve; None if it does not."""
    ahead = (segment.features.states - start) @ plane
    for i in np.flatnonzero((ahead[:-1] < 0.0) & (ahead[1:] >= 0.0)):
        if first and i == 0:
            continue

        def past(arc: float) -> float:
            return float((segment.features.value_at(arc) - start) @ plane)

        low, high = float(segment.nodes[i]), float(segment.nodes[i + 1])
        root_arc = root(past, low, high) if past(low) < 0.0 < past(high) else high
        if np.abs(segment.features.value_at(root_arc) - start).max() < ROUNDING:
            return root_arc
    return None


def _same_revolutions(
    loops: FreeLoops, segments: list[CurveSegment], arc: float, initial: Coordinates
) -> bool:
    """Whether couplings that count revolutions repeat on the curve after those made so far.

    The equation of a screw does not, since its slide returns; that of an indexing drive does.
    """
    tree = loops.loops.tree
    change = segments[-1].value_at(arc)[: tree.count] * loops.loops.units - initial.values[:, 0]
    revolutions = np.where(tree.slides, 0.0, REVOLUTION * np.rint(change / REVOLUTION))
    states = np.concatenate([segment.states for segment in segments])
    values = loops.unflat(states).values + revolutions[:, None]
    counting = [bool(_counted(row).any()) for row in loops.loops.couplings]
    return bool((np.abs(loops.loops.coupled(values)[0][counting]) < REPEATED).all())
