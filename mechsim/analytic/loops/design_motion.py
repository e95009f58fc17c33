"""The motion of many designs of one mechanism by their loop equations, all together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.loops.design_paths import (
    Bools,
    Law,
    ManyLoops,
    ManyPaths,
    Rows,
    assemble_designs,
    initial_coordinates,
)
from mechsim.analytic.loops.kinematics import Coordinates, cross
from mechsim.analytic.loops.mobility import checked_start
from mechsim.analytic.loops.path_rates import ClosedChunk, with_rates
from mechsim.analytic.loops.solver import LoopSolver
from mechsim.analytic.loops.start import locked_values, with_locked
from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, Motion, PointMotion
from mechsim.model.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import Array


@dataclass
class LinkRows:
    """Where links are and how they move at instants (designs, poses), component first.

    Attributes:
        values: coordinates of the tree, (count, d, p); `rates` and `second` alike.
        position: of each link, (links, 3, d, p).
        rotation: (links, 3, 3, d, p).
        velocity: of the origin, then angular, (links, 6, d, p).
        acceleration: alike.
    """

    values: Array
    rates: Array
    second: Array
    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class SharedLoops:
    """What designs that can be followed together have in common.

    Attributes:
        solver: of one of them, about where that one begins.
        law: parameters of the path -> what is prescribed, and its first two derivatives.
        initial: parameter at which the motion begins.
    """

    solver: LoopSolver
    law: Law
    initial: float


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
    locked = locked_values(mechanism)

    def motion_law(s: Array) -> tuple[Array, Array, Array]:
        value, first, second = motion_laws.along_path(s)
        return with_locked(value, locked), with_locked(first, 0.0 * locked), with_locked(second, 0.0 * locked)

    initial = float(solver.reference.values[loops.driven[0], 0]) if motion_laws.crank else 0.0
    return SharedLoops(solver, motion_law, initial)


def many_motion(
    like: SharedLoops,
    started: StartedDesigns,
    angles: Array,
    speed: float,
    joints: Sequence[str],
    *,
    rates: bool,
) -> tuple[Motion, Bools]:
    """Return the motions of designs at crank angles, and which designs were solved, (d,).

    Args:
        like: what they have in common (see `shared_loops`).
        started: the designs; their guesses say which assemblies are meant.
        angles: path parameters, (p,) in [rad].
        speed: rate of the path parameter in [rad/s].
        joints: whose motion is wanted.
        rates: False leaves velocities and accelerations zero.

    Returns:
        Points and joints at d p instants, one design after another. A design that was not solved
        must be solved by itself, with the segments that it needs or an error that gives the reason.

    Accuracy: as `closure.solve`, of which the assembly too is kept: each step is certified for each design.
    """
    loops, reference = like.solver.loops, like.solver.reference
    d, p, tree = started.arrays.count, len(angles), loops.tree
    many = ManyLoops(loops, started.arrays)
    guess, same_revolutions = initial_coordinates(many, started)
    q, closed = assemble_designs(many, guess, len(like.solver.rows))
    driven = list(loops.driven)
    converged = same_revolutions & closed & (q.values[driven] == reference.values[driven]).all(0)
    links = len(tree.branches)
    shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6)]
    links_motion = LinkRows(*(np.zeros((*shape, d, p)) for shape in shapes))

    def store(rows: Rows, columns: Rows, chunk: ClosedChunk) -> None:
        store_chunk(links_motion, rows, columns, chunk, rates=rates)

    rows = np.flatnonzero(converged)
    rows, initial = _moved_to_start(like, many, rows, Coordinates(q.values[:, rows], q.turns[..., rows]))
    converged = np.isin(np.arange(d), rows)
    if len(rows):
        converged[ManyPaths(many, like.law, like.initial).follow(rows, initial, angles, store)] = False
    motion = record_of_rows(many, links_motion, *_steady(np.tile(angles, (d, 1)), speed), joints)
    return motion, converged


def _moved_to_start(
    like: SharedLoops, many: ManyLoops, rows: Rows, q: Coordinates
) -> tuple[Rows, Coordinates]:
    """Return the designs whose drivers can go straight to where the path begins, and where they are then."""
    loops = like.solver.loops
    driven = list(loops.driven)
    start, target = like.solver.reference.values[driven], like.law(np.array([like.initial]))[0]
    distance = float(np.abs((target - start) / loops.units[driven, None]).max())
    if distance == 0.0 or not len(rows):
        return rows, q

    def law(s: Array) -> tuple[Array, Array, Array]:
        direction = np.repeat((target - start) / distance, len(s), 1)
        return start + direction * s, direction, 0.0 * direction

    values, rotations = (
        np.zeros((len(q.values), many.arrays.count)),
        np.zeros((*q.turns.shape[:3], many.arrays.count)),
    )

    def store(indices: Rows, _: Rows, chunk: ClosedChunk) -> None:
        values[:, indices], rotations[..., indices] = chunk.q.values, chunk.q.turns

    failed = ManyPaths(many, law, 0.0).follow(rows, q, np.array([distance]), store)
    rows = np.setdiff1d(rows, failed)
    values[driven] = target
    return rows, Coordinates(values[:, rows], rotations[..., rows])


def store_chunk(
    links_motion: LinkRows, rows: Rows, columns: Rows, chunk: ClosedChunk, *, rates: bool
) -> None:
    """Keep the closed instants of some designs at some angles."""
    grid = np.ix_(rows, columns)
    shape = (len(rows), len(columns))
    index = (slice(None), *grid)
    links_motion.values[index] = chunk.q.values.reshape(-1, *shape)
    poses = chunk.linearised.poses
    links_motion.position[:, :, grid[0], grid[1]] = poses.position.reshape(-1, 3, *shape)
    links_motion.rotation[:, :, :, grid[0], grid[1]] = poses.rotation.reshape(-1, 3, 3, *shape)
    if not rates:
        return
    chunk_rates = with_rates(None, chunk, conditioned=False)
    for name in ("rates", "second"):
        getattr(links_motion, name)[index] = getattr(chunk_rates, name).T.reshape(-1, *shape)
    for name in ("velocity", "acceleration"):
        component = getattr(chunk_rates, name).transpose(1, 2, 0).reshape(-1, 6, *shape)
        getattr(links_motion, name)[:, :, grid[0], grid[1]] = component


def _steady(angles: Array, speed: float) -> tuple[Array, Array, Array]:
    return angles, np.full_like(angles, speed), np.zeros_like(angles)


def record_of_rows(
    many: ManyLoops,
    links_motion: LinkRows,
    angle: Array,
    speed: Array,
    acceleration: Array,
    joints: Sequence[str],
) -> Motion:
    """Return what was found as a record; rates by the crank angle become those in time.

    The crank's angle, speed and acceleration are (d, p) each.
    """
    mechanism, tree = many.loops.tree.mechanism, many.loops.tree
    # rates are by the crank angle so far
    for first, second in (("rates", "second"), ("velocity", "acceleration")):
        by_angle = getattr(links_motion, first)
        setattr(links_motion, second, getattr(links_motion, second) * speed**2 + by_angle * acceleration)
        setattr(links_motion, first, by_angle * speed)
    points = {
        name: _point(many, links_motion, link, many.arrays.points[name])
        for name, (link, _) in mechanism.points.items()
        if link != GROUND
    }
    coordinates: dict[str, JointMotion] = {}
    for name in joints:
        index = tree.index_of.get(name)
        if index is None:
            coordinates[name] = _hinge(many, links_motion, mechanism.joint(name))
        else:
            histories = (links_motion.values[index], links_motion.rates[index], links_motion.second[index])
            value, rate, second = (history.ravel() for history in histories)
            coordinates[name] = JointMotion(value, rate, second, "m" if tree.slides[index] else "rad")
    crank, crank_speed, second_rate = angle.ravel(), speed.ravel(), acceleration.ravel()
    return Motion("loop equations", crank, crank_speed, second_rate, points, joints=coordinates)


def _point(many: ManyLoops, links_motion: LinkRows, link: str, local: Array) -> PointMotion:
    """Return the motion of a point (3, d) of a link, fields (d p, 3)."""
    i = many.loops.tree.links[link]
    arm = np.einsum("kd,ikdp->idp", local, links_motion.rotation[i])
    angular_velocity, angular_acceleration = links_motion.velocity[i, 3:], links_motion.acceleration[i, 3:]
    tangential = cross(angular_velocity, arm)
    normal = cross(angular_acceleration, arm) + cross(angular_velocity, tangential)
    return PointMotion(
        (links_motion.position[i] + arm).reshape(3, -1).T,
        (links_motion.velocity[i, :3] + tangential).reshape(3, -1).T,
        (links_motion.acceleration[i, :3] + normal).reshape(3, -1).T,
    )


def _hinge(many: ManyLoops, links_motion: LinkRows, joint: Joint) -> JointMotion:
    """Return the motion of a hinge that closes a loop, fields (d p,)."""
    _, frame_a, _, frame_b = many.arrays.ends[joint.name]
    (rotation_a, spin_a, alpha_a), (rotation_b, spin_b, alpha_b) = (
        _side(many, links_motion, end.link, frame) for end, frame in ((joint.a, frame_a), (joint.b, frame_b))
    )
    axis_b, axis = rotation_b[:, 0], rotation_a[:, 2]
    value = np.arctan2((rotation_a[:, 1] * axis_b).sum(0), (rotation_a[:, 0] * axis_b).sum(0))
    rate, second = ((axis * vector).sum(0) for vector in (spin_b - spin_a, alpha_b - alpha_a))
    return JointMotion(value.ravel(), rate.ravel(), second.ravel())


def _side(many: ManyLoops, links_motion: LinkRows, link: str, frame: Array) -> tuple[Array, Array, Array]:
    """Return a joint's frame on one side (3, 3, d, p), and how that link turns, (3, d, p) each."""
    if link == GROUND:
        p = links_motion.values.shape[2]
        zero = np.zeros((3, frame.shape[2], p))
        return np.repeat(frame[..., None], p, -1), zero, zero
    i = many.loops.tree.links[link]
    rotation = np.einsum("ijdp,jkd->ikdp", links_motion.rotation[i], frame)
    return rotation, links_motion.velocity[i, 3:], links_motion.acceleration[i, 3:]
