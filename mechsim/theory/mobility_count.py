"""Mobility by Somov-Malyshev and by Grübler over planar pairs, confirmed by rank and explained."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mechsim.analytic.loops.constraints import tree_loops
from mechsim.analytic.loops.kinematics import twists
from mechsim.analytic.loops.mobility import DofCount, dof_count
from mechsim.analytic.loops.motion import assemble
from mechsim.errors import AssemblyError, several
from mechsim.model.joint_kinds import KINDS, Axis, Kind
from mechsim.model.joints import End, Joint
from mechsim.model.link_poses import PARALLEL_TOLERANCE, plane_normals
from mechsim.model.links import GROUND, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.graphs import components
from mechsim.numerics.rank import null_spaces

# components of a null vector below this are rounding: singular vectors have errors of 1e-16 divided by the
# gap of RANK_TOLERANCE between zero and nonzero singular values
ZERO_COMPONENT = 1e-6


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the point at the ground's origin, (3,) in [m/s], and angular velocity, (3,) in [rad/s]."""

    velocity: Array
    spin: Array

    def velocity_at(self, point: Array) -> Array:
        return self.velocity + np.cross(self.spin, point)


def motion_words(
    mechanism: Mechanism, poses: Mapping[str, Pose], body: tuple[str, ...], twist: Twist
) -> str | None:
    """Return about or along which joints a body moves; None if no joint determines it."""
    length = mechanism.characteristic_length
    ends = [
        (joint, end)
        for joint in joints_between(mechanism, set(body))
        for end in (joint.a, joint.b)
        if end.link in body
    ]
    positions = {joint.name: poses[end.link].point(end.point)[0] for joint, end in ends}
    speed = float(np.linalg.norm(twist.spin))
    if speed <= ZERO_COMPONENT:
        along = _along(poses, ends, twist.velocity, lambda kind: kind.slides)
        return f"slides along the axis of joint {along[0]}" if along else None
    direction = twist.spin / speed
    pitch = float(twist.velocity @ direction) / speed
    verb = "spins" if abs(pitch) <= ZERO_COMPONENT * length else "screws"
    foot = np.cross(direction, twist.velocity) / speed
    on_axis = [
        name
        for name, position in positions.items()
        if np.linalg.norm(np.cross(position - foot, direction)) <= ZERO_COMPONENT * length
    ]
    along = _along(poses, ends, direction, lambda kind: kind.turns)
    for name in along:
        if name in on_axis:
            return f"{verb} about the axis of joint {name}"
    for first, second in combinations(on_axis, 2):
        if np.linalg.norm(positions[first] - positions[second]) > ZERO_COMPONENT * length:
            return f"{verb} about the line through {first} and {second}"
    if on_axis:
        return f"{verb} about a line through {on_axis[0]} along ({', '.join(f'{x:.3g}' for x in direction)})"
    return None


def _along(
    poses: Mapping[str, Pose],
    ends: list[tuple[Joint, End]],
    direction: Array,
    axes: Callable[[Kind], tuple[Axis, ...]],
) -> list[str]:
    """Return the joints with an axis of given kinds parallel to a direction."""
    unit = direction / np.linalg.norm(direction)
    return [
        joint.name
        for joint, end in ends
        if "a" in axes(KINDS[joint.kind])
        and np.linalg.norm(np.cross(poses[end.link].rotation[0] @ np.asarray(end.axis), unit))
        <= ZERO_COMPONENT
    ]


def joints_between(mechanism: Mechanism, links: set[str]) -> list[Joint]:
    """Return the joints between some links and the others."""
    return [joint for joint in mechanism.joints if (joint.a.link in links) != (joint.b.link in links)]


def plane_normal(mechanism: Mechanism) -> Array | None:
    """Return the normal of the plane of a planar mechanism, or None if it is spatial.

    Returns:
        Unit vector in the ground frame, (3,), or None; planar as in `model.link_poses.plane_normals`.
    """
    normals = plane_normals(mechanism)
    return None if normals is None else normals[GROUND]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Lower pairs at one point of a planar chain.

    Attributes:
        links: the connected links: two, or more on one pin. k links on a pin make k - 1 pairs.
        hinge: whether they rotate on a pin; otherwise the two slide.
        joints: the joints of the description that make them.
    """

    links: tuple[str, ...]
    hinge: bool
    joints: tuple[str, ...]


def planar_pairs(mechanism: Mechanism) -> list[Pairs]:
    """Return the pairs of a planar chain, with revolute joints on one pin combined.

    A description can connect three links on a pin in several ways, and the structure must not depend on this.
    Links that are fixed to each other count once; a joint that does not constrain the plane is no pair.
    """
    body = rigid(mechanism)
    moving = [joint for joint in mechanism.joints if not _welded(mechanism, joint)]
    hinges = [joint for joint in moving if KINDS[joint.kind].hinge]
    tolerance = PARALLEL_TOLERANCE * mechanism.characteristic_length
    shared = [(a.name, b.name) for a, b in combinations(hinges, 2) if _on_one_pin(a, b, tolerance)]
    order = [link.name for link in mechanism.links]
    pairs: list[Pairs] = []
    for pin in components([joint.name for joint in hinges], shared):
        links = {body[end.link] for name in pin for end in (mechanism.joint(name).a, mechanism.joint(name).b)}
        pairs.append(Pairs(tuple(sorted(links, key=[GROUND, *order].index)), True, tuple(pin)))
    slides = (joint for joint in moving if KINDS[joint.kind].slides and not KINDS[joint.kind].turns)
    return pairs + [Pairs((body[joint.a.link], body[joint.b.link]), False, (joint.name,)) for joint in slides]


def rigid(mechanism: Mechanism) -> dict[str, str]:
    """Return link (the ground included) -> the first link of those that are fixed to it."""
    order = [GROUND, *(link.name for link in mechanism.links)]
    bodies = components(order, [joint.links for joint in mechanism.joints if _welded(mechanism, joint)])
    return {name: min(next(body for body in bodies if name in body), key=order.index) for name in order}


def _welded(mechanism: Mechanism, joint: Joint) -> bool:
    """Whether a joint cannot move: it has no degree of freedom, or is locked."""
    kind = KINDS[joint.kind]
    return not kind.dof or (not kind.ball and mechanism.locked.keys() >= {*joint.coordinates})


def _on_one_pin(first: Joint, second: Joint, tolerance: float) -> bool:
    """Whether two revolute joints share a link and an axis on it."""
    for end in (first.a, first.b):
        for other in (second.a, second.b):
            if end.link == other.link:
                gap = np.asarray(end.point) - np.asarray(other.point)
                if float(np.linalg.norm(np.cross(gap, end.axis))) <= tolerance:
                    return True
    return False


@dataclass(frozen=True, slots=True)
class FreeMotion:
    """A degree of freedom that the crank does not determine.

    Attributes:
        links: the moving links.
        idle: whether it is passive: no tracked point moves, and where a link on the frame takes part, no
            joint moves either (a wheel or rod that rotates in place).
        text: the motion in words.
    """

    links: tuple[str, ...]
    idle: bool
    text: str

    def __str__(self) -> str:
        return f"{'idle' if self.idle else 'undriven'} degree of freedom: {self.text}"


def free_motions(mechanism: Mechanism, poses: Mapping[str, Pose], count: int) -> tuple[FreeMotion, ...]:
    """Return the degrees of freedom with the crank locked, in words.

    The basis of the null space of the loop Jacobian is chosen so that each vector moves few links.

    Args:
        mechanism: the mechanism.
        poses: moving link -> one pose that closes the loops, arrays with a leading axis of length 1.
        count: number of these degrees of freedom (`loops.DofCount.passive`).
    """
    if count == 0:
        return ()
    loops, q = tree_loops(mechanism, {name: pose.select(0) for name, pose in poses.items()}, {})
    _, jacobian, placed = loops.linearise(q)
    rates = np.zeros((loops.tree.count, count))
    rates[loops.unknown] = np.linalg.svd(jacobian[:, loops.unknown, 0])[2][-count:].T
    scale = np.array([mechanism.characteristic_length] * 3 + [1.0] * 3)
    every = twists(loops.tree, placed, rates * loops.units[:, None])[[*loops.tree.links.values()]]
    space = np.linalg.qr((every / scale[:, None]).reshape(-1, count))[0]  # (6 links, count)
    motions: list[FreeMotion] = []
    for vector in _localised(space, len(mechanism.links)):
        components = dict(zip(loops.tree.links, vector.reshape(-1, 6), strict=True))
        moving = {
            name: Twist(*np.split(scale * component, 2))
            for name, component in components.items()
            if np.linalg.norm(component) > ZERO_COMPONENT * np.linalg.norm(vector)
        }
        motions.append(_named(mechanism, poses, moving))
    return tuple(motions)


def _localised(space: Array, links: int) -> Iterable[Array]:
    """Yield a basis of a space of twists, (6 links, k), whose vectors move few links each."""
    basis = np.zeros((space.shape[1], 0))
    for count in range(1, links + 1):
        for chosen in combinations(range(links), count):
            outside = np.ones(links, dtype=bool)
            outside[list(chosen)] = False
            rows = space[np.repeat(outside, 6)]
            inside = null_spaces(np.vstack([rows, basis.T]), 0.0, ZERO_COMPONENT)[1].T
            for i in range(inside.shape[1]):
                basis = np.column_stack([basis, inside[:, i]])
                yield space @ inside[:, i]
            if basis.shape[1] == space.shape[1]:
                return


def _named(mechanism: Mechanism, poses: Mapping[str, Pose], twists: Mapping[str, Twist]) -> FreeMotion:
    still = ZERO_COMPONENT * mechanism.characteristic_length

    def moves(link: str, local: Vector) -> bool:
        position = poses[link].point(local)[0]
        return float(np.linalg.norm(twists[link].velocity_at(position))) > still

    moved = [
        point for point, (link, local) in mechanism.points.items() if link in twists and moves(link, local)
    ]
    ends = [end for joint in mechanism.joints for end in (joint.a, joint.b) if end.link in twists]
    on_frame = any(GROUND in (joint.a.link, joint.b.link) for joint in joints_between(mechanism, set(twists)))
    felt = on_frame and any(moves(end.link, end.point) for end in ends)
    words = _words(mechanism, poses, twists) + (f", which moves {', '.join(moved)}" if moved else "")
    return FreeMotion(tuple(twists), not moved and not felt, words)


def _words(mechanism: Mechanism, poses: Mapping[str, Pose], twists: Mapping[str, Twist]) -> str:
    """Return the motion of each rigid body in words; bodies without such a joint move with the others."""
    phrases: list[str] = []
    carried: list[str] = []
    for body in _rigid_bodies(twists, mechanism.characteristic_length):
        motion = motion_words(mechanism, poses, body, twists[body[0]])
        if motion:
            phrases.append(f"{' and '.join(body)} {motion}")
        else:
            carried += body
    if not phrases:
        return f"{' and '.join(carried)} {'moves' if len(carried) == 1 else 'move'}"
    return ", ".join(phrases) + (f", carrying {' and '.join(carried)}" if carried else "")


def _rigid_bodies(twists: Mapping[str, Twist], length: float) -> list[tuple[str, ...]]:
    """Return groups of links that move as one rigid body."""
    bodies: list[list[str]] = []
    for name, twist in twists.items():
        for body in bodies:
            first = twists[body[0]]
            gap = np.concatenate([(twist.velocity - first.velocity) / length, twist.spin - first.spin])
            if np.linalg.norm(gap) <= ZERO_COMPONENT:
                body.append(name)
                break
        else:
            bodies.append([name])
    return [tuple(body) for body in bodies]


# displacement of the crank to either side, in [rad], that distinguishes a special pose from the general one:
# large enough for the rank, small enough for almost any range
CRANK_STEP = 1e-3


@dataclass(frozen=True, slots=True)
class Mobility:
    """Degrees of freedom of a mechanism, by counting and by rank.

    Attributes:
        actual: degrees of freedom by the rank of the loop Jacobian, the decisive number.
        links: number of moving links.
        joints: (constraints of a joint, number of such joints), decreasing.
        gears: number of gears, each of which removes one degree of freedom.
        planar: whether the mechanism is planar, so that Grübler's count applies.
        redundant: number of redundant constraints in space.
        crank_moves: whether the crank can move.
        first_order: whether the mechanism can move to first order, but closes on neither side of its pose.
        free: the degrees of freedom with the crank locked.
    """

    actual: int
    links: int
    joints: tuple[tuple[int, int], ...]
    gears: int
    planar: bool
    redundant: int
    crank_moves: bool
    first_order: bool
    free: tuple[FreeMotion, ...]

    @property
    def somov_malyshev(self) -> int:
        """W = 6n - 5 p5 - 4 p4 - 3 p3 - gears, the count in space. Paper 000, section on mobility."""
        return 6 * self.links - sum(constraints * count for constraints, count in self.joints) - self.gears

    @property
    def grubler(self) -> int | None:
        """W = 3n - 2 p5 - gears, the count in a plane (Chebyshev, Grübler); None in space.

        A joint without a degree of freedom in the plane removes three, one that does not constrain the plane
        none.
        """
        if not self.planar:
            return None
        return (
            3 * self.links - sum((constraints - 3) * count for constraints, count in self.joints) - self.gears
        )

    @property
    def idle(self) -> tuple[FreeMotion, ...]:
        """The passive degrees of freedom."""
        return tuple(motion for motion in self.free if motion.idle)

    @property
    def redundant_in_plane(self) -> int:
        """Number of constraints that are redundant even within the plane; in space all redundant ones."""
        return self.redundant if self.grubler is None else self.actual - self.grubler

    def lines(self) -> list[str]:
        """Return the mobility in words: the result, then each count, then the explanation."""
        gears = f" - {self.gears}" if self.gears else ""
        constraints = "".join(f" - {constraints}*{count}" for constraints, count in self.joints)
        lines = [
            f"W = {self.actual} by the rank of the loop Jacobian",
            f"Somov-Malyshev (space): W = 6*{self.links}{constraints}{gears} = {self.somov_malyshev}",
        ]
        if self.grubler is not None:
            constraints = "".join(
                f" - {constraints - 3}*{count}" for constraints, count in self.joints if constraints > 3
            )
            lines.append(f"Grübler (plane): W = 3*{self.links}{constraints}{gears} = {self.grubler}")
        return lines + self._explanation()

    def _explanation(self) -> list[str]:
        lines: list[str] = []
        out_of_plane = self.redundant - self.redundant_in_plane
        if out_of_plane:
            loops = out_of_plane // 3
            lines.append(
                f"{several(out_of_plane, 'redundant constraint')} in space: three for "
                + ("the planar loop" if loops == 1 else f"each of {loops} planar loops")
            )
        if self.redundant_in_plane:
            where = " within the plane" if self.planar else ""
            count = several(self.redundant_in_plane, "redundant constraint")
            lines.append(f"{count}{where}: it moves because of its special dimensions")
        lines += [str(motion) for motion in self.free]
        if self.actual == 0:
            lines.append("locked: no link can move")
        elif not self.crank_moves:
            lines.append("locked: the crank cannot move")
        if self.first_order:
            lines.append("locked but for a small play: the loops close on neither side of this pose")
        return lines

    def __str__(self) -> str:
        return "; ".join(self.lines())


def mobility(mechanism: Mechanism) -> Mobility:
    """Count the degrees of freedom, confirm them by rank and name those that the crank does not determine.

    The rank is the largest at the start and at a small distance to either side: at a special pose (a flat
    parallelogram) it is smaller than in general.

    Args:
        mechanism: the mechanism.

    Returns:
        The counts, the actual number, and the explanation of the difference.

    Raises:
        AssemblyError: if the loops do not close at the mechanism's start.

    Source: docs/explanation/sources.md for the counts; rank of the loop Jacobian, `loops.dof_count`.
    """
    # the assembled start, and closed configurations at a small distance to either side
    stands = [assemble(mechanism, [mechanism.start])]
    for aside in (CRANK_STEP, -CRANK_STEP):
        try:
            stands.append(assemble(mechanism, [mechanism.start + aside], stands[0]))
        except AssemblyError:
            continue  # a dead centre or a locked structure: the other poses count
    ranked: list[tuple[DofCount, Mapping[str, Pose]]] = [
        (dof_count(mechanism, poses), poses) for poses in stands
    ]
    best, poses = max(ranked, key=lambda item: item[0].rank)
    crank_moves = best.mobility > best.passive
    constraints = Counter(KINDS[joint.kind].forces + KINDS[joint.kind].moments for joint in mechanism.joints)
    return Mobility(
        actual=best.mobility,
        links=len(mechanism.links),
        joints=tuple(sorted(constraints.items(), reverse=True)),
        gears=len(mechanism.laws),
        planar=plane_normal(mechanism) is not None,
        redundant=best.redundant,
        crank_moves=crank_moves,
        first_order=crank_moves and len(stands) == 1,
        free=free_motions(mechanism, poses, best.passive),
    )
