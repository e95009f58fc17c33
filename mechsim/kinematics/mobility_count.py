"""Mobility by Somov-Malyshev and by Grübler over planar pairs, confirmed by rank and explained."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import AssemblyError, several
from mechsim.kinematics.loops.mobility import dof_count, solver_at_generic_pose, undetermined_names
from mechsim.kinematics.loops.motion import assemble, spinning_links
from mechsim.mechanism.joint_kinds import KINDS, REVOLUTE
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import PARALLEL_TOLERANCE, hinged_normals, plane_normals
from mechsim.numerics.arrays import Array
from mechsim.numerics.graphs import components

# components of a null vector below this are rounding: singular vectors have errors of 1e-16 divided by the
# gap of RANK_TOLERANCE between zero and nonzero singular values
ZERO_COMPONENT = 1e-6


def plane_normal(mechanism: Mechanism) -> Array | None:
    """Return the normal of the plane of a planar mechanism, or None if it is spatial.

    Returns:
        Unit vector in the ground frame, (3,), or None; planar as in `motion_plane.plane_normals`.
    """
    normals = plane_normals(mechanism)
    return None if normals is None else normals[GROUND]


def pinned(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with revolute joints for the spherical joints of links that hinges keep in a plane.

    Within the plane both keep two points together. Others are returned as they are.
    """
    normals, pins = hinged_normals(mechanism), list[Joint]()
    if normals is None or all(not KINDS[joint.kind].ball for joint in mechanism.joints):
        return mechanism
    for joint in mechanism.joints:
        if KINDS[joint.kind].ball and not KINDS[joint.kind].slides:
            a, b = (End(end.link, end.point, vector(normals[end.link])) for end in (joint.a, joint.b))
            joint = replace(joint, kind=REVOLUTE, a=a, b=b)
        pins.append(joint)
    return replace(mechanism, joints=tuple(pins))


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
    shared = _on_one_pin(hinges, PARALLEL_TOLERANCE * mechanism.characteristic_length)
    order = {name: i for i, name in enumerate(body)}
    pairs: list[Pairs] = []
    for pin in components([joint.name for joint in hinges], shared):
        links = {body[link] for name in pin for link in mechanism.joint(name).links}
        pairs.append(Pairs(tuple(sorted(links, key=order.__getitem__)), True, tuple(pin)))
    slides = (joint for joint in moving if KINDS[joint.kind].slides and not KINDS[joint.kind].turns)
    return pairs + [Pairs((body[joint.a.link], body[joint.b.link]), False, (joint.name,)) for joint in slides]


def rigid(mechanism: Mechanism) -> dict[str, str]:
    """Return link (the ground included) -> the first link of those that are fixed to it."""
    order = [GROUND, *(link.name for link in mechanism.links)]
    bodies = components(order, [joint.links for joint in mechanism.joints if _welded(mechanism, joint)])
    position = {name: i for i, name in enumerate(order)}
    first = {name: min(body, key=position.__getitem__) for body in bodies for name in body}
    return {name: first[name] for name in order}


def _welded(mechanism: Mechanism, joint: Joint) -> bool:
    """Whether a joint cannot move: it has no degree of freedom, or is locked."""
    kind = KINDS[joint.kind]
    return not kind.dof or (not kind.ball and mechanism.locked.keys() >= {*joint.coordinates})


def _on_one_pin(hinges: Sequence[Joint], tolerance: float) -> Iterator[tuple[str, str]]:
    """Yield the pairs of revolute joints that share a link and an axis on it."""
    on_link: dict[str, list[tuple[str, End]]] = {}
    for joint in hinges:
        for end in (joint.a, joint.b):
            on_link.setdefault(end.link, []).append((joint.name, end))
    for ends in on_link.values():
        points, axes = (np.array([getattr(end, name) for _, end in ends]) for name in ("point", "axis"))
        gaps = np.linalg.norm(np.cross(points[:, None] - points, axes[:, None]), axis=2)
        yield from ((ends[i][0], ends[j][0]) for i, j in np.argwhere(np.triu(gaps <= tolerance, 1)))


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
        in_plane: (constraints of a joint in the plane, number of such joints) of a planar mechanism, whose
            spherical joints are pins; None in space.
        redundant: number of redundant constraints in space.
        crank_moves: whether the crank can move.
        first_order: whether the mechanism can move to first order, but closes on neither side of its pose.
        undetermined: coordinates and points that can move with the crank locked, one for each DOF.
        idle: links that spin in place with the crank locked, if nothing else moves.
    """

    actual: int
    links: int
    joints: tuple[tuple[int, int], ...]
    gears: int
    in_plane: tuple[tuple[int, int], ...] | None
    redundant: int
    crank_moves: bool
    first_order: bool
    undetermined: tuple[str, ...]
    idle: tuple[str, ...]

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
        if self.in_plane is None:
            return None
        return 3 * self.links - sum(constraints * count for constraints, count in self.in_plane) - self.gears

    @property
    def redundant_in_plane(self) -> int:
        """Number of constraints that are redundant even within the plane; in space all redundant ones."""
        return self.redundant if self.grubler is None else self.actual - self.grubler

    def lines(self) -> list[str]:
        """Return the mobility in words: the result, then each count, then the explanation."""
        gears = f" - {self.gears}" if self.gears else ""
        space, plane = (
            "".join(f" - {constraints}*{count}" for constraints, count in joints or ())
            for joints in (self.joints, self.in_plane)
        )
        lines = [
            f"W = {self.actual} by the rank of the loop Jacobian",
            f"Somov-Malyshev (space): W = 6*{self.links}{space}{gears} = {self.somov_malyshev}",
        ]
        if self.grubler is not None:
            lines.append(f"Grübler (plane): W = 3*{self.links}{plane}{gears} = {self.grubler}")
        return lines + self._explanation()

    def _explanation(self) -> list[str]:
        lines: list[str] = []
        out_of_plane = self.redundant - self.redundant_in_plane
        if out_of_plane:
            loops = sum(count for _, count in self.joints) - self.links
            each = "three for " + ("the planar loop" if loops == 1 else f"each of {loops} planar loops")
            reason = each if out_of_plane == 3 * loops else "its loops are planar"
            lines.append(f"{several(out_of_plane, 'redundant constraint')} in space: {reason}")
        if self.redundant_in_plane:
            where = "" if self.in_plane is None else " within the plane"
            count = several(self.redundant_in_plane, "redundant constraint")
            lines.append(f"{count}{where}: it moves because of its special dimensions")
        lines += [
            f"undriven degree of freedom: {name} moves with the crank locked" for name in self.undetermined
        ]
        lines += [f"idle degree of freedom: {link} spins" for link in self.idle]
        if self.actual == 0:
            lines.append("locked: no link can move")
        elif not self.crank_moves:
            lines.append("locked: the crank cannot move")
        if self.first_order:
            lines.append("locked but for a small play: the loops close on neither side of this pose")
        return lines

    def __str__(self) -> str:
        return "; ".join(self.lines())


def _constraints(mechanism: Mechanism, out_of_plane: int = 0) -> tuple[tuple[int, int], ...]:
    """Return (constraints of a joint, number of such joints), decreasing, without those out of the plane."""
    kinds = [KINDS[joint.kind] for joint in mechanism.joints]
    count = Counter(kind.forces + kind.moments - out_of_plane for kind in kinds)
    return tuple(sorted(((own, number) for own, number in count.items() if own > 0), reverse=True))


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
    best = max((dof_count(mechanism, poses) for poses in stands), key=lambda count: count.rank)
    crank_moves = best.mobility > best.passive
    solver = solver_at_generic_pose(mechanism)[0]
    undetermined = tuple(undetermined_names(solver))
    flat = pinned(mechanism)
    in_plane = None if plane_normal(flat) is None else _constraints(flat, 3)
    return Mobility(
        actual=best.mobility,
        links=len(mechanism.links),
        joints=_constraints(mechanism),
        gears=len(mechanism.laws),
        in_plane=in_plane,
        redundant=best.redundant,
        crank_moves=crank_moves,
        first_order=crank_moves and len(stands) == 1,
        undetermined=undetermined,
        idle=() if undetermined else tuple(sorted(spinning_links(solver))),
    )
