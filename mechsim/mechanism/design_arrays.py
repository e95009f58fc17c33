"""Arrays of many designs that differ only in the positions of joints and points."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.joints import Sides
from mechsim.mechanism.link_poses import complete_guess, initial_coordinates
from mechsim.mechanism.links import Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# of one joint: points (3, d) and frames (3, 3, d) of its sides a and b
Ends = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class DesignArrays:
    """Dimensions of d designs of the same structure.

    Attributes:
        mechanism: one of the designs; it gives links, joints and drivers.
        ends: joint -> its points and frames, in the links' frames.
        points: tracked point -> (3, d) in its link's frame.
    """

    mechanism: Mechanism
    ends: Mapping[str, Ends]
    points: Mapping[str, Array]

    @property
    def count(self) -> int:
        """Number of designs."""
        return next(iter(self.ends.values()))[0].shape[-1]

    def subset(self, which: NDArray[np.intp]) -> "DesignArrays":
        """Return the designs at some indices."""
        ends = {name: tuple(array[..., which] for array in arrays) for name, arrays in self.ends.items()}
        points = {name: local[..., which] for name, local in self.points.items()}
        return DesignArrays(self.mechanism, ends, points)  # pyright: ignore[reportArgumentType]

    def sides(self) -> dict[str, Sides]:
        """Return the joint ends with the designs along the first axis: points (d, 3), frames (d, 3, 3)."""
        return {
            name: (point_a.T, np.moveaxis(frame_a, -1, 0), point_b.T, np.moveaxis(frame_b, -1, 0))
            for name, (point_a, frame_a, point_b, frame_b) in self.ends.items()
        }

    def on(self, link: str) -> Array:
        """Return the points of all joint ends on a link, (k, 3, d)."""
        points: list[Array] = []
        for joint in self.mechanism.joints:
            point_a, _, point_b, _ = self.ends[joint.name]
            points += [point for end, point in ((joint.a, point_a), (joint.b, point_b)) if end.link == link]
        return np.array(points).reshape(-1, 3, self.count)

    @property
    def characteristic_length(self) -> Array:
        """Longest distance between two joints of a link, (d,) in [m], as in `Mechanism`."""
        longest = np.zeros(self.count)
        for link in self.mechanism.link_names:
            points = self.on(link)
            gaps = points[:, None] - points[None]
            np.maximum(longest, np.sqrt((gaps**2).sum(2)).max((0, 1), initial=0.0), out=longest)
        return longest


@dataclass(frozen=True)
class StartedDesigns:
    """Designs and the configurations from which their assembly starts.

    Attributes:
        arrays: their dimensions.
        guess: link -> guessed poses, (d, 3) and (d, 3, 3), which select the assembly mode.
        coordinates: coordinate -> value in the guess where poses do not determine it, (d,) in [m] or [rad].
    """

    arrays: DesignArrays
    guess: Mapping[str, Pose]
    coordinates: Mapping[str, Array]


def design_arrays(like: Mechanism, designs: Sequence[Mechanism]) -> DesignArrays:
    """Return the dimensions of designs that have the structure of `like`."""
    ends: dict[str, Ends] = {}
    for i, joint in enumerate(like.joints):
        sides = zip(*(design.joints[i].sides for design in designs), strict=True)
        point_a, frame_a, point_b, frame_b = (np.stack(arrays, -1) for arrays in sides)
        ends[joint.name] = point_a, frame_a, point_b, frame_b
    points = {name: np.array([design.points[name][1] for design in designs]).T for name in like.points}
    return DesignArrays(like, ends, points)


def similar_designs(
    like: Mechanism, designs: Iterable[Mechanism | None]
) -> tuple[StartedDesigns | None, NDArray[np.intp]]:
    """Return the designs that have the structure of `like`, and their indices; None if there are none.

    Raises:
        InputError: if no chain of joints connects a link with the frame.
    """
    similar = [
        (i, design) for i, design in enumerate(designs) if design is not None and same_structure(like, design)
    ]
    # a batch needs guesses of the same links
    similar = [(i, design) for i, design in similar if design.guess.keys() == similar[0][1].guess.keys()]
    which, alike = np.array([i for i, _ in similar], dtype=np.intp), [design for _, design in similar]
    if not alike:
        return None, which
    arrays, starts_of = design_arrays(like, alike), [initial_coordinates(design) for design in alike]
    coordinates = {name: np.array([design[name] for design in starts_of]) for name in starts_of[0]}
    guesses = {link: [design.guess[link] for design in alike] for link in alike[0].guess}
    guess = {
        link: Pose(np.array([pose.position for pose in poses]), np.array([pose.rotation for pose in poses]))
        for link, poses in guesses.items()
    }
    placed = complete_guess(like, arrays.sides(), guess, coordinates)
    return StartedDesigns(arrays, placed, coordinates), which


def same_structure(first: Mechanism, other: Mechanism) -> bool:
    """Whether two mechanisms differ only in the positions of joints and points and in the guess."""
    return (
        first.link_names == other.link_names
        and structure(first) == structure(other)
        and {name: link for name, (link, _) in first.points.items()}
        == {name: link for name, (link, _) in other.points.items()}
    )


def side_numbers(mechanism: Mechanism) -> dict[str, Array]:
    """Return JOINT.a and JOINT.b -> point in [m], axis and reference of the side, (3, 3)."""
    return {
        f"{joint.name}.{side}": np.array([end.point, end.axis, end.reference])
        for joint in mechanism.joints
        for side, end in (("a", joint.a), ("b", joint.b))
    }


def structure(mechanism: Mechanism) -> object:
    """Return the properties of a mechanism apart from links, points and joint sides, for comparison."""
    joints = [
        (joint.name, joint.kind, joint.cross_angle, joint.lead, joint.length) for joint in mechanism.joints
    ]
    return joints, mechanism.laws, dict(mechanism.locked), mechanism.drivers
