"""A mechanism as a spanning tree of links with joint coordinates, and the joints that close its loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.joint_kinds import COLUMN, KINDS, Kind, crossed_at_zero
from mechsim.mechanism.joints import Joint, Sides
from mechsim.mechanism.link_poses import require_placed, split_joints
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.graphs import spanning_edges

# a rotation about the third axis is the sum of these times 1, the cosine and the sine of its angle
ABOUT_Z = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ]
)


class JointSides(NamedTuple):
    """The two sides of a tree joint in their links' frames: joint frames (3, 3) and points (3,) in [m].

    Those of many designs are (3, 3, n) and (3, n).
    """

    parent_frame: Array
    parent_point: Array
    child_frame: Array
    child_point: Array


@dataclass(frozen=True)
class TreeJoint:
    """A joint that places a link relative to a link nearer the frame.

    Attributes:
        joint: the joint.
        forward: whether its side a is on the link nearer the frame (the parent).
        parent: index of the parent; -1 is the ground.
        child: index of the placed link.
        first: index of its first coordinate.
        ends: points and frames of its sides a and b, as `Joint.sides`; of many designs (3, n) and (3, 3, n).
    """

    joint: Joint
    forward: bool
    parent: int
    child: int
    first: int
    ends: Sides

    @cached_property
    def kind(self) -> Kind:
        """Its joint kind."""
        return KINDS[self.joint.kind]

    @cached_property
    def first_angle(self) -> int:
        """Index of its first angle: displacements come first."""
        return self.first + len(self.kind.slides)

    @cached_property
    def direction(self) -> float:
        """+1 if the child moves in the direction of the coordinates, else -1."""
        return 1.0 if self.forward else -1.0

    @cached_property
    def angles(self) -> list[int]:
        """Indices of its angles, from the parent to the child; a spherical joint has none."""
        count = 0 if self.kind.ball else len(self.kind.turns)
        return list(range(self.first_angle, self.first_angle + count))[:: 1 if self.forward else -1]

    @cached_property
    def sides(self) -> JointSides:
        """Its sides on the parent and on the child."""
        point_a, frame_a, point_b, frame_b = self.ends
        sides = (frame_a, point_a, frame_b, point_b) if self.forward else (frame_b, point_b, frame_a, point_a)
        return JointSides(*sides)

    @cached_property
    def axes(self) -> list[tuple[int, Array]]:
        """The link of each axis, and the direction of the child's motion in its frame, (3,)."""
        axes: list[tuple[int, Array]] = []
        for axis in (*self.kind.slides, *self.kind.turns):
            on_child = (axis == "b") == self.forward
            frame = self.sides.child_frame if on_child else self.sides.parent_frame
            axes.append((self.child if on_child else self.parent, self.direction * frame[:, COLUMN[axis]]))
        return axes

    @cached_property
    def rotations(self) -> list[Array]:
        """The successive rotations of the child relative to the parent by the angles of the joint.

        Each is (9, 3): factors of 1, the cosine and the sine of the angle; (9, 3, n) for many designs.
        """
        frames = [self.sides.parent_frame, self.sides.child_frame.swapaxes(0, 1)]
        if self.kind.crossed:
            middle = crossed_at_zero(self.joint.cross_angle)
            frames[1:1] = [middle if self.forward else middle.T, np.eye(3)]
        rotation_terms = ABOUT_Z * np.array([1.0, 1.0, self.direction])[:, None, None]
        rotations = (
            np.einsum("ij...,pjk,kl...->ilp...", first, rotation_terms, second)
            for first, second in zip(frames[::2], frames[1::2], strict=True)
        )
        return [rotation.reshape(9, 3, *rotation.shape[3:]) for rotation in rotations]


# equally spaced indices as a slice, which numpy reads faster; else their array
Indices: TypeAlias = slice | NDArray[np.intp]


def indices(values: Sequence[int]) -> Indices:
    """Return indices as a slice if they are equally spaced, else as an array."""
    if not values:
        return slice(0)
    step = values[1] - values[0] if len(values) > 1 else 1
    regular = step > 0 and [*values] == [*range(values[0], values[0] + len(values) * step, step)]
    return slice(values[0], values[-1] + 1, step) if regular else np.array(values)


@dataclass(frozen=True, slots=True)
class JointGroup:
    """Tree joints of a kind whose links are equally many joints away from the frame, placed together.

    Attributes:
        kind: their kind.
        forward: whether their sides a are on the parents.
        parents: the parents, m; None for the ground.
        children: the placed links.
        columns: first coordinates of all, second coordinates, and so on.
        turns: rotations of spherical joints among those of all.
        sides: sides of the joints, each array with a first axis of length m.
        rotations: angles of the joints, and their rotations as `TreeJoint.rotations`, with the same axis.
        axes: whether each axis is fixed on the child, and its number among the vectors there.
        on_parent: points of the joints and axes on the parents, (m, vectors, 3) or (m, vectors, 3, n).
        on_child: the same on the children.
    """

    kind: Kind
    forward: bool
    parents: Indices | None
    children: Indices
    columns: list[Indices]
    turns: Indices | None
    sides: JointSides
    rotations: list[tuple[Indices, Array]]
    axes: list[tuple[bool, int]]
    on_parent: Array
    on_child: Array


@dataclass(frozen=True)
class SpanningTree:
    """Links in the order of placement, each with its tree joint; the other joints close the loops.

    A coordinate is a displacement in [m], an angle in [rad], or one of the three rotations of a spherical
    joint.

    Attributes:
        mechanism: the mechanism; tree joints that would close loops are split in it.
        original: the mechanism before splitting.
        branches: tree joint of each link, nearest the frame first.
        cuts: the joints that close the loops, and all rods.
    """

    mechanism: Mechanism
    original: Mechanism
    branches: tuple[TreeJoint, ...]
    cuts: tuple[Joint, ...]

    @cached_property
    def links(self) -> dict[str, int]:
        """Moving link of the original mechanism -> index."""
        return {link.name: self.index[link.name] for link in self.original.links}

    @cached_property
    def closed_parameters(self) -> dict[str, float]:
        """Parameter of each closed curve -> its period, after which the pose is the same."""
        return {each.coordinate: each.period for each in self.original.contacts.values() if each.period}

    @cached_property
    def index(self) -> dict[str, int]:
        """Moving link -> index, with the virtual bodies of split joints."""
        return {link.name: i for i, link in enumerate(self.mechanism.links)}

    @cached_property
    def groups(self) -> list[JointGroup]:
        """The tree joints in groups, those nearest the frame first."""
        depth, groups = {-1: 0}, dict[tuple[object, ...], list[TreeJoint]]()
        for branch in self.branches:
            depth[branch.child] = depth[branch.parent] + 1
            many = branch.sides.parent_point.ndim
            key = depth[branch.child], branch.joint.kind, branch.forward, branch.parent < 0, many
            groups.setdefault(key, []).append(branch)
        ordered = sorted(groups.values(), key=lambda branches: depth[branches[0].child])
        return [self._group(branches) for branches in ordered]

    def _group(self, branches: Sequence[TreeJoint]) -> JointGroup:
        like, balls = branches[0], [ball.child for ball in self.balls]
        columns = [indices([branch.first + k for branch in branches]) for k in range(like.kind.dof)]
        rotations = zip(*(branch.rotations for branch in branches), strict=True)
        sides = JointSides(*map(np.stack, zip(*(branch.sides for branch in branches), strict=True)))
        vectors, axes = ([sides.parent_point], [sides.child_point]), list[tuple[bool, int]]()
        for k, (link, _) in enumerate(like.axes):
            own = vectors[link == like.child]
            axes.append((link == like.child, len(own)))
            own.append(np.stack([branch.axes[k][1] for branch in branches]))
        return JointGroup(
            like.kind,
            like.forward,
            None if like.parent < 0 else indices([branch.parent for branch in branches]),
            indices([branch.child for branch in branches]),
            columns,
            indices([balls.index(branch.child) for branch in branches]) if like.kind.ball else None,
            sides,
            [
                (columns[k - like.first], np.stack(each))
                for k, each in zip(like.angles, rotations, strict=False)
            ],
            axes,
            *(np.stack(own, 1) for own in vectors),
        )

    @cached_property
    def length(self) -> float:
        """Characteristic length of the mechanism, in [m]."""
        return self.mechanism.characteristic_length

    @cached_property
    def count(self) -> int:
        """Number of coordinates."""
        return sum(branch.kind.dof for branch in self.branches)

    @cached_property
    def balls(self) -> tuple[TreeJoint, ...]:
        """The spherical tree joints."""
        return tuple(branch for branch in self.branches if branch.kind.ball)

    @cached_property
    def ball_indices(self) -> list[int]:
        """Indices of the rotations of spherical joints, which are no angles."""
        return [ball.first_angle + i for ball in self.balls for i in range(3)]

    @cached_property
    def moved_by(self) -> Array:
        """Whether each coordinate moves each link, (links, count), 1 or 0."""
        moved = np.zeros((len(self.mechanism.links), self.count))
        for branch in self.branches:
            if branch.parent >= 0:
                moved[branch.child] = moved[branch.parent]
            moved[branch.child, branch.first : branch.first + branch.kind.dof] = 1.0
        return moved

    @cached_property
    def slides(self) -> NDArray[np.bool_]:
        """Whether each coordinate is a displacement, (count,)."""
        slides = np.zeros(self.count, dtype=np.bool_)
        for branch in self.branches:
            slides[branch.first : branch.first + len(branch.kind.slides)] = True
        return slides

    @cached_property
    def units(self) -> Array:
        """Unit of each coordinate in the equations: characteristic length for displacements, else 1 rad."""
        return np.where(self.slides, self.length, 1.0)

    @cached_property
    def joint_names(self) -> frozenset[str]:
        """Names of the tree joints; the others close loops."""
        return frozenset(branch.joint.name for branch in self.branches)

    @cached_property
    def index_of(self) -> dict[str, int]:
        """Coordinate of a tree joint -> its index."""
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
    """Return a spanning tree with few loop equations that contains driven, coupled and multi-turn joints.

    If these alone close a loop, some are split, and the loop is cut next to them.

    Raises:
        InputError: if no chain of joints connects a link with the frame.
    """
    first = {
        *mechanism.drivers,
        *mechanism.locked,
        *(name for law in mechanism.laws for name in law.coordinates),
    }
    # cut joints lose their number of revolutions
    multi_turn = {*mechanism.guess_coordinates}

    def cost(joint: Joint) -> tuple[bool, bool, int]:
        names = {*joint.coordinates}
        return not first & names, not multi_turn & names, KINDS[joint.kind].dof

    ordered = sorted(mechanism.joints, key=cost)
    chosen = {*spanning_edges((joint.a.link, joint.b.link, joint.name) for joint in ordered)}
    closing = {
        joint.name
        for joint in mechanism.joints
        if joint.name not in chosen and not first.isdisjoint(joint.coordinates)
    }
    if closing:
        return replace(spanning_tree(split_joints(mechanism, closing)), original=mechanism)
    index = {link.name: i for i, link in enumerate(mechanism.links)} | {GROUND: -1}
    # the equation of a rod remains if its coordinates place a link
    cuts = tuple(joint for joint in mechanism.joints if joint.name not in chosen or KINDS[joint.kind].rod)
    branches: list[TreeJoint] = []
    placed, waiting, count = {GROUND}, [j for j in mechanism.joints if j.name in chosen], 0
    while joint := next((j for j in waiting if (j.a.link in placed) != (j.b.link in placed)), None):
        waiting.remove(joint)
        forward = joint.a.link in placed
        parent, child = joint.links if forward else joint.links[::-1]
        branches.append(TreeJoint(joint, forward, index[parent], index[child], count, joint.sides))
        count += KINDS[joint.kind].dof
        placed.add(child)
    require_placed(mechanism, placed)
    return SpanningTree(mechanism, mechanism, tuple(branches), cuts)
