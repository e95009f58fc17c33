"""The joints by which links hang on others, and their sides as numbers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mechsim.model.joint_kinds import COLUMN, KINDS, Axis, Kind, crossed_at_zero
from mechsim.model.joints import Joint
from mechsim.numerics.arrays import Array

# a turn about the third axis is the sum of these times 1, the cosine and the sine of its angle
ABOUT_Z = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ]
)


@dataclass(frozen=True)
class TreeJoint:
    """A joint by which a link hangs on one nearer the frame.

    Attributes:
        joint: of the mechanism.
        forward: whether its side a is on the link nearer the frame.
        parent: index of that link; -1 is the ground.
        child: index of the link that hangs on it.
        first: index of its first coordinate.
    """

    joint: Joint
    forward: bool
    parent: int
    child: int
    first: int

    @cached_property
    def kind(self) -> Kind:
        """Its row in the table of kinds."""
        return KINDS[self.joint.kind]

    @cached_property
    def first_angle(self) -> int:
        """Index of its first turn: displacements come first."""
        return self.first + len(self.kind.slides)

    @cached_property
    def direction(self) -> float:
        """+1 where the far link moves as its coordinates count, else -1."""
        return 1.0 if self.forward else -1.0

    @cached_property
    def angles(self) -> list[int]:
        """Indices of its angles, from the near link to the far one; a ball has none."""
        count = 0 if self.kind.ball else len(self.kind.turns)
        return list(range(self.first_angle, self.first_angle + count))[:: 1 if self.forward else -1]


@dataclass(frozen=True, slots=True)
class JointSides:
    """The two sides of a branch, each in its own link's frame: joint frame (3, 3) and point (3,) in [m]."""

    parent_frame: Array
    parent_point: Array
    child_frame: Array
    child_point: Array

    def axis(self, branch: TreeJoint, axis: Axis) -> tuple[int, Array]:
        """Return which link an axis of the branch's joint is fixed on, and the axis in its frame."""
        on_far = (axis == "b") == branch.forward
        frame, link = (self.child_frame, branch.child) if on_far else (self.parent_frame, branch.parent)
        return link, frame[:, COLUMN[axis]]

    def rotations(self, branch: TreeJoint) -> list[Array]:
        """Return what a branch's angles turn the far link's axes by, in the near link's, one after the other.

        Each as what 1, the cosine and the sine of the angle are multiplied by, (3, 3, 3).
        """
        ends = [self.parent_frame, self.child_frame.swapaxes(0, 1)]
        if branch.kind.crossed:
            middle = crossed_at_zero(branch.joint.cross_angle)
            ends[1:1] = [middle if branch.forward else middle.T, np.eye(3)]
        rotation_terms = ABOUT_Z * np.array([1.0, 1.0, branch.direction])[:, None, None]
        pairs = zip(ends[::2], ends[1::2], strict=True)
        return [
            np.einsum("ij...,pjk,kl...->ilp...", first, rotation_terms, second) for first, second in pairs
        ]
