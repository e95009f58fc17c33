"""All curves of assemblies of a mechanism with one degree of freedom, from its guess and random starts."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.io.readers import load
from mechsim.kinematics.continuation.assembly_curve import AssemblyCurve
from mechsim.kinematics.continuation.free_loops import FreeLoops, free_loops
from mechsim.kinematics.continuation.segments import trace_curve
from mechsim.kinematics.group_assemblies import group_chain
from mechsim.kinematics.loops.assemblies import joined_poses
from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.kinematics import Coordinates, link_poses
from mechsim.kinematics.loops.mobility import require_determined
from mechsim.kinematics.loops.start import all_closed, assembled, poses_around_branch_point, random_poses
from mechsim.mechanism.links import GROUND, IDENTITY
from mechsim.mechanism.mechanism import Mechanism, described
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.loop_solver import loop_solver
from mechsim.numerics.rank import significant, singular_values
from mechsim.numerics.resources import Progress, no_progress

# distance of features below which a pose lies on a curve
ON_CURVE = 1e-7
# singular values below this fraction of the largest count as zero at a pose from a random start
RANK_TOLERANCE = 1e-5
# number of failed curves, and of curves, after which the search stops: a row of n loops has up to 2**n
MAX_FAILED, MAX_CURVES = 3, 40


class CurveSearch:
    """Sampled poses, and the curves on which they lie.

    Attributes:
        loops: of the mechanism.
        progress: called with a description of the work and the fraction done, at least.
        singular_values: least ones of poses on no curve when they were added, (n,); `dofs` as well.
    """

    def __init__(self, loops: FreeLoops, progress: Progress):
        self.loops, self.progress = loops, progress
        self.curves: list[AssemblyCurve] = []
        self.poses: list[Coordinates] = []
        self.curve_index = np.empty(0, dtype=np.intp)
        self.counted = np.empty(0, dtype=np.bool_)
        self.features: Array = np.empty((0, 3 * len(loops.features.links)))
        self.singular_values = np.empty(0)
        self.dofs = np.empty(0, dtype=np.intp)
        self.failed: list[str] = []

    def add(self, poses: Coordinates, *, counted: bool) -> None:
        """Add poses to the search."""
        if not len(poses):
            return
        loops, rank, n = self.loops.loops, self.loops.rank, len(poses)
        self.poses += [poses.select(np.array([i])) for i in range(n)]
        features = self.loops.features.values(link_poses(loops.tree, poses))
        self.features = np.concatenate([self.features, features])
        self.counted = np.concatenate([self.counted, np.full(n, counted)])
        self.curve_index = np.concatenate([self.curve_index, np.full(n, -1)])
        for i, curve in enumerate(self.curves):
            self._assign(i, curve)
        least, dofs, waiting = np.ones(n), np.ones(n, dtype=np.intp), self.curve_index[-n:] == -1
        if waiting.any():
            jacobian = loops.linearise(poses.select(waiting))[1][:, loops.unknown]
            values = singular_values(jacobian.transpose(2, 0, 1))
            dofs[waiting] += rank - significant(values, RANK_TOLERANCE).sum(1)
            if rank:
                least[waiting] = values[:, rank - 1]
        self.singular_values = np.concatenate([self.singular_values, least])
        self.dofs = np.concatenate([self.dofs, dofs])

    def trace(self, start: int) -> None:
        """Trace the curve through a pose."""
        which = len(self.curves) + 1

        def report(segments: int, limit: int) -> None:
            self.progress(f"component {which}, segment {segments} of at most {limit:,}", segments / limit)

        curve = AssemblyCurve(self.loops, trace_curve(self.loops, self.poses[start], progress=report))
        self.curves.append(curve)
        self.curve_index[start] = len(self.curves) - 1
        self._assign(len(self.curves) - 1, curve)

    def add_branches(self) -> None:
        """Add poses on the branches that leave the branch points of the last curve."""
        curve = self.curves[-1]
        for arc in curve.branch_points:
            coordinates = self.loops.unflat(curve.traced.segment_at(arc).evaluate(np.array([arc])))
            self.add(poses_around_branch_point(self.loops.loops, coordinates), counted=False)

    def trace_all(self) -> None:
        """Trace curves until every pose that can move lies on one, or there are many."""
        while len(self.failed) < MAX_FAILED and len(self.curves) < MAX_CURVES:
            waiting = np.flatnonzero((self.curve_index == -1) & (self.dofs == 1))
            if not len(waiting):
                return
            best = int(waiting[np.argmax(self.singular_values[waiting])])
            try:
                self.trace(best)
            except (AssemblyError, MobilityError) as error:
                self.curve_index[best] = -2
                self.failed.append(str(error))
                continue
            self.add_branches()

    def counts(self) -> list[int]:
        """Return how many counted poses lie on each curve."""
        return [int((self.counted & (self.curve_index == i)).sum()) for i in range(len(self.curves))]

    def left_out(self) -> list[str]:
        """Return one sentence for each group of assemblies that was not traced."""
        messages = [f"not traced: {reason}" for reason in self.failed]
        lost = self.counted & (self.curve_index < 0)
        for what, which in (
            ("in poses that cannot move", self.dofs < 1),
            ("where more than one degree of freedom is undetermined", self.dofs > 1),
            ("on curves that were not traced", self.dofs == 1),
        ):
            if count := int((lost & which).sum()):
                messages.append(f"{count} of {int(self.counted.sum())} assemblies found were {what}")
        return messages

    def _assign(self, index: int, curve: AssemblyCurve) -> None:
        waiting = np.flatnonzero(self.curve_index == -1)
        if len(waiting):
            self.curve_index[waiting[lie_on(curve, self.features[waiting])]] = index


def lie_on(curve: AssemblyCurve, features: Array) -> NDArray[np.bool_]:
    """Return which of n poses, given by their features, lie on a curve, (n,)."""
    segments = curve.traced.segments
    arcs = np.concatenate([segment.nodes for segment in segments])
    spacing = (np.diff(arcs, append=curve.length) ** 2).max()
    # squares of the distances from the nodes, (n, nodes)
    states, own = (segment.features.states for segment in segments), (features**2).sum(1)[:, None]
    distances = np.hstack([own + (rows**2).sum(1) - 2.0 * (features @ rows.T) for rows in states])
    # where a curve nearly crosses itself, several local minima are candidates
    minima = (distances <= np.roll(distances, 1, 1)) & (distances <= np.roll(distances, -1, 1))
    candidates = minima & (distances < spacing)
    return np.array(
        [
            any(_distance(curve, float(arc), pose) < ON_CURVE for arc in arcs[chosen])
            for pose, chosen in zip(features, candidates, strict=True)
        ],
        dtype=np.bool_,
    )


def _distance(curve: AssemblyCurve, arc: float, features: Array) -> float:
    """Return the distance of a pose's features from a curve near an arc."""
    distance = np.inf
    for _ in range(6):
        arc %= curve.length
        segment = curve.traced.segment_at(arc)
        gap = features - segment.features.value_at(arc)
        distance = float(np.abs(gap).max())
        derivative = segment.feature_rates.value_at(arc)
        step = float(gap @ derivative) / float(derivative @ derivative)
        # converged: the step no longer changes the distance
        if abs(step) < 0.1 * ON_CURVE:
            break
        arc += step
    return distance


# crank angles at which the assemblies of the Assur groups are added to the random starts
GROUP_ANGLES = 12


def add_group_poses(search: CurveSearch, loops: TreeLoops) -> tuple[list[NDArray[np.intp]], str]:
    """Add every assembly of the Assur groups at some crank angles of the first curve to a search.

    Returns:
        Indices of the poses at each crank angle, and why there are none; empty text if there are.
    """
    curve, added = search.curves[0], list[NDArray[np.intp]]()
    try:
        chain = group_chain(loops.tree.original)
    except InputError as error:
        return [], str(error)
    for arc in np.linspace(0.0, curve.length, GROUP_ANGLES, endpoint=False):
        q = curve.loops.unflat(curve.traced.segment_at(float(arc)).evaluate(np.array([arc])))
        own = link_poses(loops.tree, q).by_link(loops.tree.links)
        poses = {GROUND: IDENTITY} | {name: pose.select(0) for name, pose in own.items()}
        try:
            groups = chain.assemblies(poses)
        except InputError as error:
            return [], str(error)
        first, every = len(search.poses), groups.poses
        if every:
            search.add(all_closed(loops, loops.read(joined_poses(every))), counted=False)
        if not groups.complete:
            return [], f"its Assur groups have more than {len(every)} poses at a position"
        if len(search.poses) - first == len(every):
            added.append(np.arange(first, len(search.poses)))
    return added, ""


# default number of random starts, default seed, and limit on the number
STARTS, SEED, MAX_STARTS = 300, 1, 100_000


@dataclass(frozen=True, slots=True)
class BranchPoint:
    """A pose at which curves of assemblies cross: from it the mechanism can continue along either.

    Attributes:
        angle: of the crank in [rad], on the first of the curves.
        locations: index of each curve that passes it, and its arc there; a curve may pass twice.
    """

    angle: float
    locations: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class AssemblyTrace:
    """Every assembly of a mechanism, as closed curves.

    Attributes:
        mechanism: the traced mechanism.
        curves: the first contains the mechanism's guess; the others by number of starts that ended on them.
        branch_points: points at which they cross each other or themselves.
        starts: number of random starts.
        closed: number of starts that converged to an assembly.
        seed: seed of the random numbers.
        left_out: assemblies that were not traced, with the reason; one sentence each.
        complete_at: number of crank angles at which every assembly is on these curves, by Assur groups.
        reason: why it is 0, if the mechanism has no such groups.
    """

    mechanism: Mechanism
    curves: tuple[AssemblyCurve, ...]
    branch_points: tuple[BranchPoint, ...]
    starts: int
    closed: int
    seed: int
    left_out: tuple[str, ...] = ()
    complete_at: int = 0
    reason: str = ""

    __repr__ = short_repr


def trace(
    model: object,
    *,
    starts: int = STARTS,
    seed: int = SEED,
    progress: Progress = no_progress,
) -> AssemblyTrace:
    """Trace every assembly of a mechanism with one degree of freedom, through all turning points.

    Assemblies form closed curves. If the crank rotates fully, a curve is one assembly over one revolution, or
    over as many as the gears need to repeat. If it only oscillates, a curve contains both assemblies between
    its dead centres. The first curve contains the mechanism's guess; the others are found from random starts
    and from branch points. A curve on which a fraction p of the starts ends is missed with probability
    (1 - p) to the power of the number of starts.

    Args:
        model: as in `load`: a name, a file, a MuJoCo object, a mechanism or a solver.
        starts: number of random starts; 0 traces the curve of the guess and those connected to it.
        seed: seed of the random numbers: the same seed gives the same curves.
        progress: called with a description of the work and the fraction done, at least.

    Raises:
        InputError: unless starts and seed are whole numbers in range.
        AssemblyError: if the loops do not close at the guess, or its curve does not close: a slider or screw
            is unbounded, or the curve is longer than 3,000 segments.
        MobilityError: unless exactly one degree of freedom besides passive ones is undetermined.

    Source: arc-length continuation (Dragilev's method) as in the paper on the RRSRR
        (docs/explanation/sources.md); here with polynomial predictors.
    """
    for name, value, most in (("starts", starts, MAX_STARTS), ("the seed", seed, 2**32)):
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"{name} of a trace: {value!r}; give a whole number from 0 to {most}")
    mechanism = described(model if isinstance(model, Mechanism) else load(model))  # pyright: ignore[reportArgumentType]
    loops, own = assembled(mechanism)
    require_determined(loop_solver(loops, own))
    # locked coordinates stay locked, drivers become free
    driven, loops = loops, replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    free, initial = _starting_point(loops, own)
    search = CurveSearch(free, progress)
    search.add(initial, counted=False)
    search.trace(0)
    search.add_branches()
    closed = 0
    for finished, poses in random_poses(loops, own, starts, seed):
        search.add(poses, counted=True)
        closed += len(poses)
        progress(f"{finished} of {starts} random starts", finished / starts)
    by_groups, reason = add_group_poses(search, driven)
    search.trace_all()
    complete_at = sum(bool((search.curve_index[poses] >= 0).all()) for poses in by_groups)
    counts = search.counts()
    order = [0, *sorted(range(1, len(counts)), key=lambda i: -counts[i])]
    curves = tuple(replace(search.curves[i], starts_ended=counts[i]) for i in order)
    return AssemblyTrace(
        mechanism,
        curves,
        _merged_branch_points(curves),
        starts,
        closed,
        seed,
        tuple(search.left_out()),
        complete_at,
        reason,
    )


def _starting_point(loops: TreeLoops, own: Coordinates) -> tuple[FreeLoops, Coordinates]:
    """Return the equations and a start for tracing: near the guess if that is a branch point."""
    try:
        return free_loops(loops, own), own
    except MobilityError:
        neighbours = poses_around_branch_point(loops, own)
        for i in range(len(neighbours)):
            neighbour = neighbours.select(np.array([i]))
            try:
                return free_loops(loops, neighbour), neighbour
            except MobilityError:
                continue
        raise


def _merged_branch_points(curves: tuple[AssemblyCurve, ...]) -> tuple[BranchPoint, ...]:
    """Return the branch points of all curves, each listed once."""
    features: list[Array] = []
    locations: list[list[tuple[int, float]]] = []
    for i, curve in enumerate(curves):
        for arc in curve.branch_points:
            values = curve.traced.segment_at(arc).features.value_at(arc)
            same = [k for k, other in enumerate(features) if np.abs(other - values).max() < ON_CURVE]
            if same:
                locations[same[0]].append((i, arc))
            else:
                features.append(values)
                locations.append([(i, arc)])
    return tuple(
        BranchPoint(float(curves[passages[0][0]].poses_at(passages[0][1]).angle[0]), tuple(passages))
        for passages in locations
    )
