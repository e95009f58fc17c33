"""The motion of many designs of one mechanism by their loop equations, all together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.closure.checked_start import checked_start
from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.many_loops import Bools, ManyLoops, Rows, put_together, rough_coordinates
from mechsim.analytic.closure.many_paths import Law, ManyPaths
from mechsim.analytic.closure.tree_assembly import held_values, with_holds
from mechsim.analytic.closure.tree_motion import Coordinates, cross
from mechsim.analytic.closure.tree_rates import ClosedPart, rated
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, Motion, PointMotion
from mechsim.model.programs import Programs


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
class LikeLoops:
    """What designs that can be followed together have in common.

    Attributes:
        solver: of one of them, about where that one begins.
        law: parameters of the path -> what is prescribed, and its first two derivatives.
        begin: parameter at which the motion begins.
    """

    solver: LoopSolver
    law: Law
    begin: float


def can_be_followed_together(
    mechanism: Mechanism, joints: Sequence[str], programs: Programs | None = None
) -> LikeLoops | None:
    """Return what designs of a mechanism have in common; None where they cannot be followed together.

    For that a crank turns or programs move the drivers, there are loops, no joint of which is split, and of
    joints that close loops only hinges are asked for.

    Raises:
        AssemblyError: where its own loops do not close.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    if programs is None and not mechanism.has_crank:
        return None
    solver = checked_start(mechanism)
    loops = solver.loops
    if not len(loops.unknown) or loops.tree.mechanism is not mechanism:
        return None
    for name in joints:
        if loops.tree.places.get(name) is None and not KINDS[mechanism.joint(name).kind].hinge:
            return None
    held = held_values(mechanism)

    def turned(angle: Array) -> tuple[Array, Array, Array]:
        one, none = np.ones((1, len(angle))), np.zeros((1, len(angle)))
        return with_holds(angle[None], held), with_holds(one, 0.0 * held), with_holds(none, 0.0 * held)

    if programs is None:
        return LikeLoops(solver, turned, float(solver.pinned.values[loops.driven[0], 0]))

    def moved(clock: Array) -> tuple[Array, Array, Array]:
        value, first, second = programs.by_clock(clock)
        return with_holds(value, held), with_holds(first, 0.0 * held), with_holds(second, 0.0 * held)

    return LikeLoops(solver, moved, 0.0)


def many_motion(
    like: LikeLoops,
    started: StartedDesigns,
    angles: Array,
    speed: float,
    joints: Sequence[str],
    *,
    rates: bool,
) -> tuple[Motion, Bools]:
    """Return the motions of designs at crank angles, and of which designs they could be told, (d,).

    Args:
        like: what they have in common (see `can_be_followed_together`).
        started: the designs; their guesses say which assemblies are meant.
        angles: of the crank, or of the clock of programs, (p,) in [rad].
        speed: of the crank or the clock in [rad/s].
        joints: whose motion is wanted.
        rates: False leaves velocities and accelerations nought.

    Returns:
        Points and joints at d p instants, one design after another. Where a design is not told it must be
        solved by itself, which says why, or finds its path in cells as short as it needs.

    Accuracy: as `closure.solve`, of which the assembly too is kept: each step is certified for each design.
    """
    loops, one = like.solver.loops, like.solver.pinned
    d, p, tree = started.arrays.count, len(angles), loops.tree
    many = ManyLoops(loops, started.arrays)
    rough, winds = rough_coordinates(many, started)
    at, closed = put_together(many, rough, len(like.solver.rows))
    driven = list(loops.driven)
    good = winds & closed & (at.values[driven] == one.values[driven]).all(0)
    links = len(tree.branches)
    shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6)]
    found = LinkRows(*(np.zeros((*shape, d, p)) for shape in shapes))

    def kept(rows: Rows, places: Rows, part: ClosedPart) -> None:
        keep_part(found, rows, places, part, rates=rates)

    rows = np.flatnonzero(good)
    rows, begun = _begun(like, many, rows, Coordinates(at.values[:, rows], at.turns[..., rows]))
    good = np.isin(np.arange(d), rows)
    if len(rows):
        good[ManyPaths(many, like.law, like.begin).follow(rows, begun, angles, kept)] = False
    motion = record_of_rows(many, found, *_steady(np.tile(angles, (d, 1)), speed), joints)
    return motion, good


def _begun(like: LikeLoops, many: ManyLoops, rows: Rows, at: Coordinates) -> tuple[Rows, Coordinates]:
    """Return the designs whose drivers can go straight to where the path begins, and where they are then."""
    loops = like.solver.loops
    driven = list(loops.driven)
    here, there = like.solver.pinned.values[driven], like.law(np.array([like.begin]))[0]
    far = float(np.abs((there - here) / loops.units[driven, None]).max())
    if far == 0.0 or not len(rows):
        return rows, at

    def straight(s: Array) -> tuple[Array, Array, Array]:
        slope = np.repeat((there - here) / far, len(s), 1)
        return here + slope * s, slope, 0.0 * slope

    values, turns = (
        np.zeros((len(at.values), many.arrays.count)),
        np.zeros((*at.turns.shape[:3], many.arrays.count)),
    )

    def kept(some: Rows, _: Rows, part: ClosedPart) -> None:
        values[:, some], turns[..., some] = part.at.values, part.at.turns

    lost = ManyPaths(many, straight, 0.0).follow(rows, at, np.array([far]), kept)
    rows = np.setdiff1d(rows, lost)
    values[driven] = there
    return rows, Coordinates(values[:, rows], turns[..., rows])


def keep_part(found: LinkRows, rows: Rows, places: Rows, part: ClosedPart, *, rates: bool) -> None:
    """Keep the closed instants of some designs at some angles."""
    where = np.ix_(rows, places)
    shape = (len(rows), len(places))
    at = (slice(None), *where)
    found.values[at] = part.at.values.reshape(-1, *shape)
    here = part.loops.here
    found.position[:, :, where[0], where[1]] = here.position.reshape(-1, 3, *shape)
    found.rotation[:, :, :, where[0], where[1]] = here.rotation.reshape(-1, 3, 3, *shape)
    if not rates:
        return
    moved = rated(None, part, conditioned=False)
    for name in ("rates", "second"):
        getattr(found, name)[at] = getattr(moved, name).T.reshape(-1, *shape)
    for name in ("velocity", "acceleration"):
        turned = getattr(moved, name).transpose(1, 2, 0).reshape(-1, 6, *shape)
        getattr(found, name)[:, :, where[0], where[1]] = turned


def _steady(angles: Array, speed: float) -> tuple[Array, Array, Array]:
    return angles, np.full_like(angles, speed), np.zeros_like(angles)


def record_of_rows(
    many: ManyLoops, found: LinkRows, angle: Array, speed: Array, acceleration: Array, joints: Sequence[str]
) -> Motion:
    """Return what was found as a record; rates by the crank angle become those in time.

    The crank's angle, speed and acceleration are (d, p) each.
    """
    mechanism, tree = many.loops.tree.mechanism, many.loops.tree
    # rates are by the crank angle so far
    for first, second in (("rates", "second"), ("velocity", "acceleration")):
        by_angle = getattr(found, first)
        setattr(found, second, getattr(found, second) * speed**2 + by_angle * acceleration)
        setattr(found, first, by_angle * speed)
    points = {
        name: _point(many, found, link, many.arrays.points[name])
        for name, (link, _) in mechanism.points.items()
        if link != GROUND
    }
    told: dict[str, JointMotion] = {}
    for name in joints:
        place = tree.places.get(name)
        if place is None:
            told[name] = _hinge(many, found, mechanism.joint(name))
        else:
            parts = (found.values[place], found.rates[place], found.second[place])
            value, rate, second = (one.ravel() for one in parts)
            told[name] = JointMotion(value, rate, second, "m" if tree.slides[place] else "rad")
    crank, pace, gain = angle.ravel(), speed.ravel(), acceleration.ravel()
    return Motion("loop equations", crank, pace, gain, points, joints=told)


def _point(many: ManyLoops, found: LinkRows, link: str, local: Array) -> PointMotion:
    """Return the motion of a point (3, d) of a link, fields (d p, 3)."""
    i = many.loops.tree.links[link]
    arm = np.einsum("kd,ikdp->idp", local, found.rotation[i])
    spin, turning = found.velocity[i, 3:], found.acceleration[i, 3:]
    swing = cross(spin, arm)
    bend = cross(turning, arm) + cross(spin, swing)
    return PointMotion(
        (found.position[i] + arm).reshape(3, -1).T,
        (found.velocity[i, :3] + swing).reshape(3, -1).T,
        (found.acceleration[i, :3] + bend).reshape(3, -1).T,
    )


def _hinge(many: ManyLoops, found: LinkRows, joint: Joint) -> JointMotion:
    """Return the motion of a hinge that closes a loop, fields (d p,)."""
    _, frame_a, _, frame_b = many.arrays.ends[joint.name]
    (turn_a, spin_a, more_a), (turn_b, spin_b, more_b) = (
        _side(many, found, end.link, frame) for end, frame in ((joint.a, frame_a), (joint.b, frame_b))
    )
    seen, axis = turn_b[:, 0], turn_a[:, 2]
    value = np.arctan2((turn_a[:, 1] * seen).sum(0), (turn_a[:, 0] * seen).sum(0))
    rate, second = ((axis * one).sum(0) for one in (spin_b - spin_a, more_b - more_a))
    return JointMotion(value.ravel(), rate.ravel(), second.ravel())


def _side(many: ManyLoops, found: LinkRows, link: str, frame: Array) -> tuple[Array, Array, Array]:
    """Return a joint's frame on one side (3, 3, d, p), and how that link turns, (3, d, p) each."""
    if link == GROUND:
        p = found.values.shape[2]
        nothing = np.zeros((3, frame.shape[2], p))
        return np.repeat(frame[..., None], p, -1), nothing, nothing
    i = many.loops.tree.links[link]
    turn = np.einsum("ijdp,jkd->ikdp", found.rotation[i], frame)
    return turn, found.velocity[i, 3:], found.acceleration[i, 3:]
