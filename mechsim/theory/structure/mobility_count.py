"""Mobility: counted by Somov-Malyshev and by Grübler, confirmed by rank, and the difference explained."""

from collections import Counter
from dataclasses import dataclass

from mechsim.analytic.loops import Freedom, assemble, freedom
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.theory.structure.passive_dofs import FreeMotion, free_motions
from mechsim.theory.structure.planar import plane_normal

# how far the crank is turned to either side, in [rad], to tell a special pose from the rule: far
# enough for the rank to see, near enough for almost any range
ASIDE = 1e-3


@dataclass(frozen=True, slots=True)
class Mobility:
    """How many freedoms a mechanism has, by count and in truth.

    Attributes:
        actual: freedoms by the rank of the loop Jacobian; what counts.
        links: number of moving links.
        joints: (constraints of a joint, how many joints have them), falling.
        gears: number of gears, each of which takes one freedom.
        planar: whether all moves in one plane, so that Grübler's count applies.
        redundant: constraints in space that repeat what others say.
        crank_moves: whether the crank can move at all.
        first_order: whether the mechanism seems to move but closes on neither side of its pose.
        free: the freedoms left with the crank held, by name.
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

        A joint that leaves nothing free takes three, one that leaves the plane free none.
        """
        if not self.planar:
            return None
        return (
            3 * self.links - sum((constraints - 3) * count for constraints, count in self.joints) - self.gears
        )

    @property
    def idle(self) -> tuple[FreeMotion, ...]:
        """The freedoms that change nothing wanted."""
        return tuple(motion for motion in self.free if motion.idle)

    @property
    def redundant_in_plane(self) -> int:
        """Constraints that repeat others even within the plane; in space all redundant ones."""
        return self.redundant if self.grubler is None else self.actual - self.grubler

    def lines(self) -> list[str]:
        """Return the mobility in words, the result first, then each count, then what explains it."""
        gears = f" - {self.gears}" if self.gears else ""
        constraints = "".join(f" - {constraints}*{count}" for constraints, count in self.joints)
        lines = [
            f"mobility W = {self.actual} by the rank of the loop Jacobian",
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
                f"{_several(out_of_plane, 'redundant constraint')} of space: three for "
                + ("the planar loop" if loops == 1 else f"each of {loops} planar loops")
            )
        if self.redundant_in_plane:
            where = " within the plane" if self.planar else ""
            count = _several(self.redundant_in_plane, "redundant constraint")
            lines.append(f"{count}{where}: special dimensions make it move")
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
    """Count the freedoms of a mechanism, confirm them by rank and name those the crank does not take.

    The rank is taken at the start and a little to either side of it, and the largest counts: at a
    special pose (a flattened parallelogram) it is smaller than it is as a rule.

    Args:
        mechanism: the mechanism.

    Returns:
        The counts, the true number and what explains the difference.

    Raises:
        AssemblyError: if the loops do not close at the mechanism's start.

    Source: papers.md sections 1-4 for the counts; rank of the loop Jacobian, `closure.freedom`.
    """
    stands = _stands(mechanism)
    ranked: list[tuple[Freedom, dict[str, Pose]]] = [(freedom(mechanism, poses), poses) for poses in stands]
    best, poses = max(ranked, key=lambda item: item[0].rank)
    crank_moves = best.mobility > best.passive
    constraints = Counter(6 - KINDS[joint.kind].freedoms for joint in mechanism.joints)
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


def _stands(mechanism: Mechanism) -> list[dict[str, Pose]]:
    """Return the assembled start, then what closes a little to either side of it."""
    stands = [assemble(mechanism, [mechanism.start])]
    for aside in (ASIDE, -ASIDE):
        try:
            stands.append(assemble(mechanism, [mechanism.start + aside], stands[0], most_steps=20))
        except AssemblyError:
            continue  # a dead centre or a locked structure: the other stands tell
    return stands


def _several(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
