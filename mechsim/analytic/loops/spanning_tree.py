"""A mechanism as a tree of links with coordinates, and the joints that close its loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.tree_joints import JointSides, TreeJoint
from mechsim.analytic.loops.tree_layout import Layout, layout
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.link_poses import split
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class SpanningTree:
    """Links in the order in which they are placed, each by one joint; the joints left close the loops.

    A coordinate is a displacement in [m], an angle in [rad], or one of the three turns of a ball.

    Attributes:
        mechanism: the mechanism; joints that must be branches though they close loops are split in it.
        original: the mechanism as it was before.
        branches: by which joint each link is placed, nearest the frame first.
        cuts: the joints that close the loops.
    """

    mechanism: Mechanism
    original: Mechanism
    branches: tuple[TreeJoint, ...]
    cuts: tuple[Joint, ...]

    @cached_property
    def links(self) -> dict[str, int]:
        """Moving link of the mechanism as it was given -> index."""
        return {link.name: self.index[link.name] for link in self.original.links}

    @cached_property
    def index(self) -> dict[str, int]:
        """Moving link -> index, also of links that split joints led to."""
        return {link.name: i for i, link in enumerate(self.mechanism.links)}

    @cached_property
    def constants(self) -> dict[int, JointSides]:
        """Index of a link -> the sides of the branch that places it."""
        sides: dict[int, JointSides] = {}
        for branch in self.branches:
            a, b = branch.joint.a, branch.joint.b
            parent_end, child_end = (a, b) if branch.forward else (b, a)
            sides[branch.child] = JointSides(
                parent_end.frame, np.array(parent_end.point), child_end.frame, np.array(child_end.point)
            )
        return sides

    @cached_property
    def layout(self) -> Layout:
        """What its links are placed by, all poses at once."""
        return layout(self.branches, self.constants)

    @cached_property
    def size(self) -> float:
        """The mechanism's, in [m]."""
        return self.mechanism.size

    @cached_property
    def count(self) -> int:
        """How many coordinates there are."""
        return sum(branch.kind.freedoms for branch in self.branches)

    @cached_property
    def balls(self) -> tuple[TreeJoint, ...]:
        """The branches that turn about every axis."""
        return tuple(branch for branch in self.branches if branch.kind.ball)

    @cached_property
    def ball_indices(self) -> list[int]:
        """Indices of the turns of balls, which are no angles."""
        return [ball.first_angle + i for ball in self.balls for i in range(3)]

    @cached_property
    def moved_by(self) -> Array:
        """Which coordinates move which link, (links, count), 1 or 0."""
        moved = np.zeros((len(self.mechanism.links), self.count))
        for branch in self.branches:
            if branch.parent >= 0:
                moved[branch.child] = moved[branch.parent]
            moved[branch.child, branch.first : branch.first + branch.kind.freedoms] = 1.0
        return moved

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Which coordinates are displacements, (count,)."""
        slides = np.zeros(self.count, dtype=np.bool_)
        for branch in self.branches:
            slides[branch.first : branch.first + len(branch.kind.slides)] = True
        return slides

    @cached_property
    def units(self) -> Array:
        """What one unit of each coordinate is in the equations: the size for displacements, else 1 rad."""
        return np.where(self.slides, self.size, 1.0)

    def first_index(self, joint: str) -> int | None:
        """Return the index of the first coordinate of a joint; None where it closes a loop."""
        return next((branch.first for branch in self.branches if branch.joint.name == joint), None)

    @cached_property
    def index_of(self) -> dict[str, int]:
        """Coordinate of a branch -> its index."""
        return {
            name: branch.first + i
            for branch in self.branches
            for i, name in enumerate(branch.joint.coordinates)
        }

    def coupled(self, terms: Mapping[str, float]) -> Array:
        """Return the weights of all coordinates in one side of a coupling, (count,)."""
        weights = np.zeros(self.count, np.result_type(float, *terms.values()))
        for name, weight in terms.items():
            weights[self.index_of[name]] += weight
        return weights


def spanning_tree(mechanism: Mechanism) -> SpanningTree:
    """Return a tree whose cuts leave few equations: driven and coupled joints stay, then counted ones.

    Where those alone close a loop, some are split, and it is cut beside them.

    Raises:
        AssemblyError: for links that no chain of joints leads to.
    """
    first = {
        *mechanism.drivers,
        *mechanism.locked,
        *(name for law in mechanism.laws for name in law.coordinates),
    }
    # turns of a joint that closes a loop are not counted
    counted = {*mechanism.counted}

    def cost(joint: Joint) -> tuple[bool, bool, int]:
        names = {*joint.coordinates}
        return not first & names, not counted & names, KINDS[joint.kind].freedoms

    ordered = sorted(mechanism.joints, key=cost)
    chosen = _forest(ordered)
    closing = {
        joint.name
        for joint in mechanism.joints
        if joint.name not in chosen and not first.isdisjoint(joint.coordinates)
    }
    if closing:
        return replace(spanning_tree(split(mechanism, closing)), original=mechanism)
    index = {link.name: i for i, link in enumerate(mechanism.links)} | {GROUND: -1}
    cuts = tuple(joint for joint in mechanism.joints if joint.name not in chosen)
    branches: list[TreeJoint] = []
    placed, waiting, count = {GROUND}, [j for j in mechanism.joints if j.name in chosen], 0
    while waiting:
        joint = next((j for j in waiting if (j.a.link in placed) != (j.b.link in placed)), None)
        if joint is None:
            unreached = sorted({end.link for j in waiting for end in (j.a, j.b)} - placed)
            raise AssemblyError(
                f"{mechanism.name}: no chain of joints leads from the frame to "
                f"{', '.join(unreached)}; add one"
            )
        waiting.remove(joint)
        forward = joint.a.link in placed
        parent_end, child_end = (joint.a, joint.b) if forward else (joint.b, joint.a)
        branches.append(TreeJoint(joint, forward, index[parent_end.link], index[child_end.link], count))
        count += KINDS[joint.kind].freedoms
        placed.add(child_end.link)
    return SpanningTree(mechanism, mechanism, tuple(branches), cuts)


def _forest(joints: Sequence[Joint]) -> set[str]:
    """Return the names of the joints that join links not joined yet, taken in order."""
    group: dict[str, str] = {}

    def root(link: str) -> str:
        while group.get(link, link) != link:
            link = group[link]
        return link

    chosen: set[str] = set()
    for joint in joints:
        a, b = root(joint.a.link), root(joint.b.link)
        if a != b:
            group[a] = b
            chosen.add(joint.name)
    return chosen
