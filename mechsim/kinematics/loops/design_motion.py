"""The motion of many designs of one mechanism by their loop equations, all together."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver, axes_aligned, with_sides
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses
from mechsim.kinematics.loops.mobility import checked_start
from mechsim.kinematics.loops.motion import instants_of_laws, straight_line, with_locked_values
from mechsim.kinematics.loops.path import Instants, LoopMotion, LoopPath, closed_chunks, with_rates
from mechsim.kinematics.loops.record import joint_motions, point_on
from mechsim.kinematics.loops.start import ASSEMBLY, CLOSED
from mechsim.mechanism.design_arrays import DesignArrays, Ends, StartedDesigns
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import JointMotion, Motion
from mechsim.mechanism.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.numerics.loop_solver import LoopSystem, loop_solver
from mechsim.numerics.newton import newton
from mechsim.numerics.path_segments import ClosedNodes, Segment, StepControl
from mechsim.numerics.rank import least_norm, significant

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices

Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]
# largest number of cached equations, by number of instants
MAX_KEPT = 4


@dataclass(frozen=True)
class DesignLoops(TreeLoops):
    """Loop equations of d designs that differ only in the positions of joints and points.

    Lengths of all designs are in units of the characteristic length of the tree's mechanism. Of n instants,
    consecutive groups of d belong to the d designs.

    Attributes:
        arrays: dimensions of the designs.
        which: their indices among all designs, (d,).
    """

    arrays: DesignArrays
    which: Rows

    def select(self, which: Rows) -> "DesignLoops":
        """Return the loops of a subset of the designs."""
        return replace(self, arrays=self.arrays.subset(which), which=self.which[which])

    def linearise(self, q: Coordinates, poses: LinkPoses | None = None) -> tuple[Array, Array, LinkPoses]:
        """Return residuals, Jacobians and links about n sets of coordinates, as `TreeLoops`."""
        return self.at_instants(len(q)).linearise(q, poses)

    def sparse(
        self, q: Coordinates, poses: LinkPoses | None = None
    ) -> "tuple[Array, SparseMatrices, LinkPoses]":
        """Return residuals, Jacobians and links as `linearise`."""
        return self.at_instants(len(q)).sparse(q, poses)

    def at_instants(self, count: int, /) -> TreeLoops:
        """Return the equations with the dimensions of each of `count` instants."""
        return self._repeated(count // len(self.which))

    @cached_property
    def _repeated(self) -> Callable[[int], TreeLoops]:
        """Number of repetitions -> equations of all designs in order, repeated."""

        def repeated(times: int) -> TreeLoops:
            sides: dict[str, Ends] = {}
            for name, (a, b, c, d) in self.arrays.ends.items():
                sides[name] = np.tile(a, times), np.tile(b, times), np.tile(c, times), np.tile(d, times)
            return with_sides(self, sides)

        return lru_cache(MAX_KEPT)(repeated)


def closed_designs(
    like: TreeLoops, started: StartedDesigns, rank: int
) -> tuple[DesignLoops, Coordinates, Bools]:
    """Return loops of designs, the coordinates in which they close nearest to their guesses, and which do.

    A design counts as one that does not close if it closes with another rank than `like`, with antiparallel
    axes or references, or after other revolutions of coupled joints.
    """
    arrays = started.arrays
    designs = DesignLoops(
        like.tree, like.cuts, like.turn_offsets, like.driven, arrays, np.arange(arrays.count)
    )
    guess = like.with_multi_turn(like.read(started.guess, arrays.sides()), started.coordinates)
    loops = designs.at_instants(arrays.count)
    result = newton(LoopSystem(loops, loops.unknown), guess, ASSEMBLY, least_norm)
    closed = (result.residual < CLOSED) & axes_aligned(loops, result.q)
    closed &= significant(np.linalg.svd(result.linearised.matrix, compute_uv=False)).sum(1) == rank
    for revolutions, offset in zip(like.revolutions_between(guess), like.turn_offsets, strict=True):
        closed &= revolutions == offset
    return designs, result.q, closed


# fraction of the designs for which a longer step must be suitable
GROWTH_QUANTILE = 0.2


class Divided(Exception):  # noqa: N818
    """Designs cannot continue with the same segments.

    Attributes:
        subsets: subsets that can, each with the length of its next segment.
    """

    def __init__(self, *subsets: tuple["DesignPaths", float]):
        self.subsets = subsets


class DesignPaths(LoopPath):
    """Paths of d designs traced with the same segments.

    A rejected segment affects only the designs that need shorter ones; they are separated from the others.
    """

    control = StepControl(min_length=4e-3, target_error=2e-5, target_correction=2e-2)
    overshoot = 0.0

    @property
    def designs(self) -> DesignLoops:
        """Loop equations of the designs."""
        assert isinstance(self.loops, DesignLoops)
        return self.loops

    def select(self, which: Rows | Bools) -> "DesignPaths":
        """Return the paths of a subset of the designs."""
        loops = self.designs.select(np.arange(self.count)[which])
        solvers = {
            id(solver): replace(solver, loops=loops, reference=solver.reference.select(which))
            for solver in (self.first, *(each.solver for half in self.segments.values() for each in half))
        }
        subset = DesignPaths(solvers[id(self.first)], self.prescribed, self.initial, self.policy, self.words)
        subset.sign = self.sign[which]
        for direction, segments in self.segments.items():
            subset.segments[direction] = [
                replace(
                    segment,
                    states=segment.states.reshape(len(segment.nodes), self.count, -1)[:, which].reshape(
                        len(segment.nodes), -1
                    ),
                    solver=solvers[id(segment.solver)],
                    adequate=None if segment.adequate is None else segment.adequate[which],
                )
                for segment in segments
            ]
        return subset

    def accepted(
        self, segment: Segment[TreeLoops, Coordinates], closed: ClosedNodes, direction: int
    ) -> tuple[Segment[TreeLoops, Coordinates] | None, float]:
        """Return a segment, None if it is rejected for all designs, and the length to try next.

        Raises:
            Divided: if it is rejected for some of them.
        """
        if self.count == 1:
            return super().accepted(segment, closed, direction)
        step, segments = segment.length, self.segments[direction]
        signs = closed.linearised.determinant[0].reshape(-1, self.count)
        # determinants of other equations have other signs
        same_rows = len(segments) > 0 and segments[-1].solver is segment.solver
        sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[0])
        error = closed.error
        valid = closed.valid & (error <= self.control.max_error) & (signs == sign).all(0)
        if not valid.any():
            return None, self.control.shrink * step
        growth = self.growth(step, direction, error, closed.displacement)[valid]
        longer = min(self.control.max_length, step * float(np.quantile(growth, GROWTH_QUANTILE)))
        segment = replace(segment, adequate=segment.solver.adequate(closed.linearised.last(self.count))[0])
        if valid.all():
            self.sign = sign
            return segment, longer
        rejected = self.select(~valid)
        segments.append(segment)
        kept = self.select(valid)
        kept.sign = sign[valid]
        raise Divided((kept, longer), (rejected, self.control.shrink * step))

    def _solver(self, current: float, direction: int) -> TreeSolver:
        adequate = self.segments[direction][-1].adequate if self.segments[direction] else None
        if self.count > 1 and adequate is not None and adequate.any() and not adequate.all():
            length = self.segments[direction][-1].length
            raise Divided((self.select(adequate), length), (self.select(~adequate), length))
        return super()._solver(current, direction)


def followed(paths: DesignPaths, targets: Sequence[float]) -> list[DesignPaths]:
    """Return designs traced to parameters, divided as needed, without those that fail."""
    finished = [paths]
    for target in targets:
        waiting: list[tuple[DesignPaths, float | None]] = [(path, None) for path in finished]
        finished = []
        while waiting:
            path, length = waiting.pop()
            try:
                path.reach(target, 1 if target > path.initial else -1, length)
            except Divided as divided:
                waiting += divided.subsets
            except AssemblyError:
                continue
            else:
                finished += [] if path.change_points else [path]
    return finished


@dataclass(frozen=True)
class SharedLoops:
    """Common properties of designs that can be traced together.

    Attributes:
        solver: solver of one of them about its start.
        motion_laws: motion laws of the drivers.
        initial: path parameter at the start of the motion.
    """

    solver: TreeSolver
    motion_laws: MotionLaws
    initial: float

    def prescribed(self, s: Array) -> Array:
        """Return the prescribed coordinates at path parameters (n,), (driven, n)."""
        return self.instants(s, 1.0, 0.0).value

    def instants(self, s: Array, speed: ArrayLike, acceleration: ArrayLike) -> Instants:
        """Return instants at path parameters (n,) and rates, (n,) or scalar."""
        rates = (np.broadcast_to(values, s.shape) for values in (speed, acceleration))
        return with_locked_values(self.solver.loops, instants_of_laws(self.motion_laws, s, *rates))


def shared_loops(
    mechanism: Mechanism, joints: Sequence[str], motion_laws: MotionLaws = CRANK
) -> SharedLoops | None:
    """Return the common properties of designs of a mechanism; None if they cannot be traced together.

    The drivers are a crank or follow motion laws, there are loops, no joint of a loop is split, and requested
    joints that close loops are hinges.

    Raises:
        AssemblyError: if the loops of the mechanism do not close.
        MobilityError: if the drivers leave joints or tracked points undetermined, or are redundant.
    """
    if motion_laws.crank and not mechanism.has_crank:
        return None
    solver = checked_start(mechanism)
    loops = solver.loops
    if not len(loops.unknown) or loops.tree.mechanism is not mechanism:
        return None
    closing = (mechanism.joint(name) for name in joints if name not in loops.tree.index_of)
    if not all(KINDS[joint.kind].hinge for joint in closing):
        return None
    initial = float(solver.reference.values[loops.driven[0], 0]) if motion_laws.crank else 0.0
    return SharedLoops(solver, motion_laws, initial)


def many_motion(
    like: SharedLoops, started: StartedDesigns, angles: Array, speed: float, joints: Sequence[str]
) -> tuple[Motion, Bools]:
    """Return the motions of designs at crank angles, and which designs were solved, (d,).

    Args:
        like: their common properties (see `shared_loops`).
        started: the designs; their guesses select the assembly modes.
        angles: path parameters, (p,) in [rad].
        speed: rate of the path parameter in [rad/s].
        joints: names of the requested joints.

    Returns:
        Points, links and joints at d p instants, one design after another. A design that was not solved must
        be solved separately, with its own segments or an error that states the reason.

    Accuracy: as `loops.solve`, with the same assembly mode: each step is certified for each design.
    """
    instants = like.instants(angles, speed, 0.0)
    count = started.arrays.count
    motion, solved = empty_motion(like, count * len(angles)), np.zeros(count, dtype=np.bool_)
    for path in _paths_from_start(like, started):
        for subset in followed(path, (angles.max(), angles.min())):
            for rows in _stored(subset, instants, motion):
                solved[rows] = True
    crank = [np.tile(values, count) for values in (angles, instants.speed, instants.acceleration)]
    return design_record(like, started.arrays, motion, crank, joints), solved


def _paths_from_start(like: SharedLoops, started: StartedDesigns) -> Iterator[DesignPaths]:
    """Yield the paths of designs that are assembled at the start of the motion."""
    loops, driven = like.solver.loops, list(like.solver.loops.driven)
    designs, q, closed = closed_designs(loops, started, len(like.solver.rows))
    start, target = like.solver.reference.values[driven], like.prescribed(np.array([like.initial]))
    rows = np.flatnonzero(closed & (q.values[driven] == start).all(0))
    if not len(rows):
        return
    designs, q = designs.select(rows), q.select(rows)
    line, distance = straight_line(loops, start, target)
    if distance == 0.0:
        yield DesignPaths(loop_solver(designs, q), like.prescribed, like.initial)
        return
    for path in followed(DesignPaths(loop_solver(designs, q), line, 0.0), (distance,)):
        # the last segment may continue to a dead centre
        last, s = path.segments[1][-1], np.array([distance])
        q = path.unflat(last.evaluate(s), s, target)
        yield DesignPaths(loop_solver(path.loops, q), like.prescribed, like.initial)


def _stored(path: DesignPaths, instants: Instants, motion: LoopMotion) -> Iterator[Rows]:
    """Store the motions of designs at instants of their paths in that of all; yield which are solved."""
    rows, count = path.designs.which, len(instants.parameter)
    try:
        for chunk in closed_chunks(path, instants):
            index = (rows * count + chunk.index[:, None]).ravel()
            store(motion, index, with_rates(path, chunk, conditioned=False))
        yield rows
    except AssemblyError:
        # a design is too near a singular pose
        for half in np.array_split(np.arange(path.count), 2) if path.count > 1 else ():
            yield from _stored(path.select(half), instants, motion)


def empty_motion(like: SharedLoops, count: int) -> LoopMotion:
    """Return an empty motion for a number of instants."""
    tree = like.solver.loops.tree
    links = len(tree.branches)
    shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6), ()]
    return LoopMotion(*(np.zeros((count, *shape)) for shape in shapes))


def store(motion: LoopMotion, index: Rows, subset: LoopMotion) -> None:
    """Store the motion of some instants in that of all instants."""
    for field in fields(LoopMotion):
        getattr(motion, field.name)[index] = getattr(subset, field.name)


def design_record(
    like: SharedLoops, arrays: DesignArrays, motion: LoopMotion, crank: Sequence[Array], joints: Sequence[str]
) -> Motion:
    """Return the motion of d designs as a record, at as many instants of each, one design after another.

    The crank has its angle, speed and acceleration at these instants, (n,) each.
    """
    tree = like.solver.loops.tree
    mechanism, repeat = tree.mechanism, len(crank[0]) // arrays.count
    links = {name: motion.link(i) for name, i in tree.links.items()}
    points = {
        name: point_on(links[link], np.repeat(arrays.points[name].T, repeat, 0))
        for name, (link, _) in mechanism.points.items()
        if link != GROUND
    }
    coordinates: dict[str, JointMotion] = {}
    for name in joints:
        if (index := tree.index_of.get(name)) is not None:
            tables = motion.values[:, index], motion.rates[:, index], motion.second[:, index]
            coordinates[name] = JointMotion(*tables, "m" if tree.slides[index] else "rad")
            continue
        # the motion of a hinge that closes a loop
        _, frame_a, _, frame_b = arrays.ends[name]
        sides = np.repeat(frame_a, repeat, -1), np.repeat(frame_b, repeat, -1)
        coordinates |= joint_motions(mechanism.joint(name), links, sides)
    angle, speed, acceleration = crank
    return Motion("loop equations", angle, speed, acceleration, points, links, coordinates)
