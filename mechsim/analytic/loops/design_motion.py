"""The motion of many designs of one mechanism by their loop equations, all together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.design_paths import (
    Bools,
    DesignPaths,
    Rows,
    assembled_designs,
    followed,
)
from mechsim.analytic.loops.mobility import checked_start
from mechsim.analytic.loops.motion import instants_of_laws, straight_line, with_locked_values
from mechsim.analytic.loops.path_rates import Instants, LoopMotion, closed_chunks, with_rates
from mechsim.analytic.loops.record import link_motion, point_on
from mechsim.analytic.loops.solver import LoopSolver, loop_solver
from mechsim.analytic.vector_method.rotations import dot
from mechsim.errors import AssemblyError
from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, LinkMotion, Motion
from mechsim.model.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class SharedLoops:
    """What designs that can be followed together have in common.

    Attributes:
        solver: of one of them, about where that one begins.
        motion_laws: of the drivers.
        initial: parameter at which the motion begins.
    """

    solver: LoopSolver
    motion_laws: MotionLaws
    initial: float

    def prescribed(self, s: Array) -> Array:
        """Return what is prescribed at parameters (n,) of the path, (driven, n)."""
        return self.instants(s, 1.0, 0.0).value

    def instants(self, s: Array, speed: ArrayLike, acceleration: ArrayLike) -> Instants:
        """Return instants at parameters (n,) of the path and its rates, (n,) or scalar."""
        rates = (np.broadcast_to(values, s.shape) for values in (speed, acceleration))
        return with_locked_values(self.solver.loops, instants_of_laws(self.motion_laws, s, *rates))


def shared_loops(
    mechanism: Mechanism, joints: Sequence[str], motion_laws: MotionLaws = CRANK
) -> SharedLoops | None:
    """Return what designs of a mechanism have in common; None where they cannot be followed together.

    For that a crank turns or programs move the drivers, there are loops, no joint of which is split, and of
    joints that close loops only hinges are asked for.

    Raises:
        AssemblyError: where its own loops do not close.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    if motion_laws.crank and not mechanism.has_crank:
        return None
    solver = checked_start(mechanism)
    loops = solver.loops
    if not len(loops.unknown) or loops.tree.mechanism is not mechanism:
        return None
    for name in joints:
        if loops.tree.index_of.get(name) is None and not KINDS[mechanism.joint(name).kind].hinge:
            return None
    initial = float(solver.reference.values[loops.driven[0], 0]) if motion_laws.crank else 0.0
    return SharedLoops(solver, motion_laws, initial)


def many_motion(
    like: SharedLoops, started: StartedDesigns, angles: Array, speed: float, joints: Sequence[str]
) -> tuple[Motion, Bools]:
    """Return the motions of designs at crank angles, and which designs were solved, (d,).

    Args:
        like: what they have in common (see `shared_loops`).
        started: the designs; their guesses say which assemblies are meant.
        angles: path parameters, (p,) in [rad].
        speed: rate of the path parameter in [rad/s].
        joints: whose motion is wanted.

    Returns:
        Points and joints at d p instants, one design after another. A design that was not solved
        must be solved by itself, with the segments that it needs or an error that gives the reason.

    Accuracy: as `closure.solve`, of which the assembly too is kept: each step is certified for each design.
    """
    instants = like.instants(angles, speed, 0.0)
    count = started.arrays.count
    motion, solved = empty_motion(like, count * len(angles)), np.zeros(count, dtype=np.bool_)
    for path in _paths_from_start(like, started):
        for subset in followed(path, (angles.max(), angles.min())):
            for rows in _stored(subset, instants, motion):
                solved[rows] = True
    angle, rate, second = (
        np.tile(values, count) for values in (angles, instants.speed, instants.acceleration)
    )
    return design_record(like, started.arrays, motion, angle, rate, second, joints), solved


def _paths_from_start(like: SharedLoops, started: StartedDesigns) -> Iterator[DesignPaths]:
    """Yield the paths of designs that are assembled as they are to be where the motion begins."""
    loops, driven = like.solver.loops, list(like.solver.loops.driven)
    designs, q, closed = assembled_designs(loops, started, len(like.solver.rows))
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
        q = path.unflat(path.segments[1][-1].states[-1:], np.array([distance]), target)
        yield DesignPaths(loop_solver(path.loops, q), like.prescribed, like.initial)


def _stored(path: DesignPaths, instants: Instants, motion: LoopMotion) -> Iterator[Rows]:
    """Put the motions of designs at instants of their paths into that of all; yield which are solved."""
    rows, count = path.designs.which, len(instants.parameter)
    try:
        for chunk in closed_chunks(path, instants):
            index = (rows * count + chunk.index[:, None]).ravel()
            store(motion, index, with_rates(path, chunk, conditioned=False))
        yield rows
    except AssemblyError:
        # one is too near a singular pose
        for half in np.array_split(np.arange(path.count), 2) if path.count > 1 else ():
            yield from _stored(path.select(half), instants, motion)


def empty_motion(like: SharedLoops, count: int) -> LoopMotion:
    """Return a motion at so many instants to be filled."""
    tree = like.solver.loops.tree
    links = len(tree.branches)
    shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6), ()]
    return LoopMotion(*(np.zeros((count, *shape)) for shape in shapes))


def store(motion: LoopMotion, index: Rows, subset: LoopMotion) -> None:
    """Put the motion at some instants into that at all."""
    for field in fields(LoopMotion):
        getattr(motion, field.name)[index] = getattr(subset, field.name)


def design_record(
    like: SharedLoops,
    arrays: DesignArrays,
    motion: LoopMotion,
    angle: Array,
    speed: Array,
    acceleration: Array,
    joints: Sequence[str],
) -> Motion:
    """Return the motion of d designs as a record, at as many instants of each, one design after another."""
    tree = like.solver.loops.tree
    mechanism, repeat = tree.mechanism, len(angle) // arrays.count
    links = {name: motion.link(i) for name, i in tree.links.items()}
    points = {
        name: point_on(links[link], np.repeat(arrays.points[name].T, repeat, 0))
        for name, (link, _) in mechanism.points.items()
        if link != GROUND
    }
    coordinates: dict[str, JointMotion] = {}
    for name in joints:
        index = tree.index_of.get(name)
        if index is None:
            coordinates[name] = _hinge(arrays, links, mechanism.joint(name), repeat)
        else:
            value, rate, second = (table[:, index] for table in (motion.values, motion.rates, motion.second))
            coordinates[name] = JointMotion(value, rate, second, "m" if tree.slides[index] else "rad")
    return Motion("loop equations", angle, speed, acceleration, points, joints=coordinates)


def _hinge(arrays: DesignArrays, links: dict[str, LinkMotion], joint: Joint, repeat: int) -> JointMotion:
    """Return the motion of a hinge that closes a loop."""
    _, frame_a, _, frame_b = arrays.ends[joint.name]
    a, b = (link_motion(end.link, links) for end in (joint.a, joint.b))
    side_a, side_b = (
        link.rotation @ np.repeat(np.moveaxis(frame, -1, 0), repeat, 0)
        for link, frame in ((a, frame_a), (b, frame_b))
    )
    axis, along = side_a[..., 2], side_b[..., 0]
    return JointMotion(
        np.arctan2(dot(side_a[..., 1], along), dot(side_a[..., 0], along)),
        dot(axis, b.angular_velocity - a.angular_velocity),
        dot(axis, b.angular_acceleration - a.angular_acceleration),
    )
