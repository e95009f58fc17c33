"""The motion of many designs of one mechanism by their loop equations, all together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.closure.checked_start import checked_start
from mechsim.analytic.closure.loop_solver import loop_solver
from mechsim.analytic.closure.many_loops import Bools, ManyLoops, Rows, put_together, rough_coordinates
from mechsim.analytic.closure.many_paths import ManyPaths
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import cross
from mechsim.analytic.closure.tree_rates import ClosedPart, rated
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import alike, design_arrays
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import GROUND, Joint, Mechanism
from mechsim.model.motion import JointMotion, Motion, PointMotion


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


def can_be_followed_together(mechanism: Mechanism, joints: Sequence[str]) -> TreeLoops | None:
    """Return the loops of a mechanism whose designs can be followed together; None where they cannot.

    For that one crank turns, nothing is held or coupled, no link spins by itself, and of joints that close
    loops only hinges are asked for.

    Raises:
        AssemblyError: where its own loops do not close.
        MobilityError: where the crank leaves joints or tracked points open.
    """
    if not mechanism.has_crank or mechanism.holds or mechanism.laws:
        return None
    loops, start = checked_start(mechanism)
    if not len(loops.unknown) or loop_solver(loops, start).open:
        return None
    for name in joints:
        if loops.tree.places.get(name) is None and not KINDS[mechanism.joint(name).kind].hinge:
            return None
    return loops


def many_motion(
    loops: TreeLoops,
    designs: Sequence[Mechanism],
    angles: Array,
    speed: float,
    joints: Sequence[str],
    *,
    rates: bool,
) -> tuple[Motion, Bools]:
    """Return the motions of designs at crank angles, and of which designs they could be told, (d,).

    Args:
        loops: of a mechanism like them (see `can_be_followed_together`).
        designs: their guesses say which assemblies are meant.
        angles: of the crank, (p,) in [rad].
        speed: of the crank in [rad/s].
        joints: whose motion is wanted.
        rates: False leaves velocities and accelerations nought.

    Returns:
        Points and joints at d p instants, one design after another. Where a design is not told it must be
        solved by itself, which says why, or finds its path in cells as short as it needs.

    Accuracy: as `closure.solve`, of which the assembly too is kept: each step is certified for each design.
    """
    d, p, tree = len(designs), len(angles), loops.tree
    like = np.array([alike(tree.mechanism, one) for one in designs])
    # another kind of mechanism only keeps its place
    designs = [one if same else tree.mechanism for one, same in zip(designs, like, strict=True)]
    many = ManyLoops(loops, design_arrays(tree.mechanism, designs))
    rough = rough_coordinates(designs)
    start = loop_solver(loops, checked_start(tree.mechanism)[1])
    at, closed = put_together(many, rough, len(start.rows))
    crank = tree.places[tree.mechanism.crank.name]
    begin = float(at.values[crank, 0])
    good = like & closed & (at.values[crank] == begin)
    links = len(tree.branches)
    shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6)]
    found = LinkRows(*(np.zeros((*shape, d, p)) for shape in shapes))

    def kept(rows: Rows, places: Rows, part: ClosedPart) -> None:
        _keep(found, rows, places, part, rates=rates)

    rows = np.flatnonzero(good)
    if len(rows):
        begun = type(at)(at.values[:, rows], at.turns[..., rows])
        good[ManyPaths(many, begin).follow(rows, begun, angles, kept)] = False
    motion = _motion(many, found, np.tile(angles, d), speed, joints)
    return motion, good


def _keep(found: LinkRows, rows: Rows, places: Rows, part: ClosedPart, *, rates: bool) -> None:
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


def _motion(many: ManyLoops, found: LinkRows, crank: Array, speed: float, joints: Sequence[str]) -> Motion:
    """Return what was found as a record; rates by the crank angle become those in time."""
    mechanism, tree = many.loops.tree.mechanism, many.loops.tree
    # rates are by the crank angle so far
    for name, power in (("rates", 1), ("velocity", 1), ("second", 2), ("acceleration", 2)):
        setattr(found, name, getattr(found, name) * speed**power)
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
    pace = np.full_like(crank, speed)
    return Motion("loop equations", crank, pace, np.zeros_like(crank), points, joints=told)


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
