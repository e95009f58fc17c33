"""Joint kinds: the axes along which side b slides and about which it rotates relative to side a.

A row of `KINDS` determines the degrees of freedom, the constraint equations, the coordinates, the components
of the reaction and the friction. Names of axes state the side on which they are fixed:

- "a": the axis of side a, parallel to that of side b;
- "b": the axis of side b, if it crosses that of side a (`cross_angle`);
- "x", "y", "z": the reference of side a, axis x reference, and the axis of side a.

A joint rotates about no axis, about "a", about "a" and "b", or about all of "x", "y" and "z" (spherical).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import angle_of

Axis = Literal["a", "b", "x", "y", "z"]
KindName = Literal[
    "revolute",
    "prismatic",
    "cylindrical",
    "screw",
    "universal",
    "spherical",
    "planar",
    "fixed",
    "floating",
    "point_on_line",
    "point_on_plane",
    "parallel_axes",
    "perpendicular_axes",
    "distance",
    "cartesian",
]

# other name of a kind -> the one that is printed
ALIASES: dict[str, KindName] = {"free": "floating"}
# column of a joint frame -> name, in messages, of the directions that must not be antiparallel
_DIRECTIONS = {2: "axes", 0: "references"}
# axis -> column of the frame of the joint side on which it is fixed: side b for "b", else side a
COLUMN: dict[Axis, int] = {"x": 0, "y": 1, "z": 2, "a": 2, "b": 2}


@dataclass(frozen=True)
class Kind:
    """The free motions of a joint kind: axes along which it slides and about which it rotates."""

    slides: tuple[Axis, ...]
    turns: tuple[Axis, ...]
    # whether displacement and rotation are coupled by `Joint.lead`
    helical: bool = False
    # whether a massless rod of length `Joint.length` connects the points
    rod: bool = False

    @cached_property
    def dof(self) -> int:
        """Number of its coordinates; both of a screw and all of a rod, whose equations are separate."""
        return len(self.slides) + len(self.turns)

    @cached_property
    def forces(self) -> int:
        """Number of force components that it transmits: its constraint equations between positions."""
        return 3 - len(self.slides) + self.rod

    @cached_property
    def moments(self) -> int:
        """Number of moment components that it transmits: its constraint equations between directions."""
        return 3 - len(self.turns)

    @cached_property
    def ball(self) -> bool:
        """Whether it rotates about every axis, without angle coordinates (spherical)."""
        return len(self.turns) == 3

    @cached_property
    def floating(self) -> bool:
        """Whether it has no constraint."""
        return self.forces + self.moments == 0

    @cached_property
    def crossed(self) -> bool:
        """Whether it rotates about two axes that cross."""
        return len(self.turns) == 2

    @cached_property
    def aligned(self) -> bool:
        """Whether the axes of both sides are parallel."""
        return len(self.turns) < 2

    @cached_property
    def aligned_columns(self) -> tuple[int, ...]:
        """Columns of the joint frames of both sides that have the same direction."""
        return () if not self.aligned else (2,) if self.turns else (2, 0)

    @cached_property
    def hinge(self) -> bool:
        """Whether it only rotates about its axis."""
        return self.aligned and not self.slides and bool(self.turns)

    @cached_property
    def pivot(self) -> bool:
        """Whether it rotates about a point that is fixed on both sides."""
        return bool(self.turns) and not self.slides

    @cached_property
    def single(self) -> bool:
        """Whether it has one degree of freedom: a hinge or a slide."""
        return self.dof == 1

    @cached_property
    def drivable(self) -> bool:
        """Whether its coordinates can be prescribed: a hinge, a slide, or both along one axis."""
        return self.slides in ((), ("a",)) and self.turns in ((), ("a",)) and self.dof > 0

    @cached_property
    def mixed(self) -> bool:
        """Whether it slides and rotates with separate coordinates."""
        return bool(self.slides and self.turns) and not self.ball

    @cached_property
    def suffixes(self) -> tuple[str, ...]:
        """Suffixes of the coordinate names after the joint's name; a spherical joint has none."""
        if self.single:
            return ("",)
        slides = (".way",) if len(self.slides) == 1 else tuple(f".{axis}" for axis in self.slides)
        if self.ball:
            return slides
        turns = (".turn",) if len(self.turns) == 1 else tuple(f".{i + 1}" for i in range(len(self.turns)))
        return slides + turns

    @cached_property
    def units(self) -> tuple[Literal["m", "rad"], ...]:
        """Units of its coordinates: displacements, then angles; a spherical joint has none."""
        turns = () if self.ball else self.turns
        return (*("m" for _ in self.slides), *("rad" for _ in turns))


KINDS: dict[KindName, Kind] = {
    "revolute": Kind(slides=(), turns=("a",)),
    "prismatic": Kind(slides=("a",), turns=()),
    "cylindrical": Kind(slides=("a",), turns=("a",)),
    "screw": Kind(slides=("a",), turns=("a",), helical=True),
    "universal": Kind(slides=(), turns=("a", "b")),
    "spherical": Kind(slides=(), turns=("x", "y", "z")),
    "planar": Kind(slides=("x", "y"), turns=("a",)),
    "fixed": Kind(slides=(), turns=()),
    "floating": Kind(slides=("x", "y", "z"), turns=("x", "y", "z")),
    # the basic constraints of Nikravesh, 1988, ch. 7, and Haug, 1989, ch. 9
    "point_on_line": Kind(slides=("a",), turns=("x", "y", "z")),
    "point_on_plane": Kind(slides=("x", "y"), turns=("x", "y", "z")),
    "parallel_axes": Kind(slides=("x", "y", "z"), turns=("a",)),
    "perpendicular_axes": Kind(slides=("x", "y", "z"), turns=("a", "b")),
    "distance": Kind(slides=("x", "y", "z"), turns=("x", "y", "z"), rod=True),
    "cartesian": Kind(slides=("x", "y", "z"), turns=()),
}

# the kinds with no degree of freedom, with one displacement, with one rotation, and with no constraint
FIXED: KindName = "fixed"
PLANAR: KindName = "planar"
PRISMATIC: KindName = "prismatic"
REVOLUTE: KindName = "revolute"


def kinds_that(rule: Callable[[Kind], bool]) -> str:
    """Return the names of the kinds that satisfy a rule, such as "revolute or prismatic"."""
    return " or ".join(name for name, kind in KINDS.items() if rule(kind))


def coordinates(kind: Kind, gap: Array, frame_a: Array, frame_b: Array, cross_angle: float) -> Array:
    """Return the coordinates of a joint, (..., k) in [m] and (-pi, pi] rad, in the order of `Kind.units`.

    Args:
        kind: kind of the joint.
        gap: vector from a's point to b's point in any frame, (..., 3) in [m].
        frame_a: joint frame of side a in that frame, (..., 3, 3).
        frame_b: joint frame of side b in that frame, (..., 3, 3).
        cross_angle: angle between crossed axes, in [rad].
    """
    columns = [(gap * frame_a[..., COLUMN[axis]]).sum(-1) for axis in kind.slides]
    if kind.crossed:
        relative = np.swapaxes(frame_a, -1, -2) @ frame_b
        first = angle_of(relative[..., 1, 2], relative[..., 0, 2])
        # after the inverse of the rotation about a's axis
        rest = crossed_at_zero(cross_angle).T @ _about_z(-first) @ relative
        columns += (first, angle_of(rest[..., 1, 0], rest[..., 0, 0]))
    elif not kind.ball and kind.turns:
        x_of_b = (np.swapaxes(frame_a, -1, -2) @ frame_b[..., :1])[..., 0]  # b's reference seen from a
        columns.append(angle_of(x_of_b[..., 1], x_of_b[..., 0]))
    return np.stack(columns, -1) if columns else np.empty((*gap.shape[:-1], 0))


def displaced(kind: Kind, values: Sequence[float | Array], cross_angle: float) -> tuple[Array, Array]:
    """Return b's joint frame in a's: position (..., 3) in [m] and rotation (..., 3, 3), identity for a ball.

    Args:
        kind: kind of the joint.
        values: its coordinates in the order of `coordinates`, each a number or (...).
        cross_angle: angle between crossed axes, in [rad].
    """
    shift = np.zeros((*np.shape(values[0] if len(values) else 0.0), 3))
    for axis, value in zip(kind.slides, values, strict=False):
        shift[..., COLUMN[axis]] = value
    angles = values[len(kind.slides) :]
    if kind.crossed:
        return shift, _about_z(angles[0]) @ crossed_at_zero(cross_angle) @ _about_z(angles[1])
    return shift, _about_z(angles[0]) if len(angles) else np.eye(3)


def crossed_at_zero(cross_angle: float) -> Array:
    """Return b's joint frame in a's for a joint with crossed axes at zero angles, (3, 3)."""
    c, s = np.cos(cross_angle), np.sin(cross_angle)
    axis, x = np.array([s, 0.0, c]), np.array([-c, 0.0, s])
    return np.column_stack([x, np.cross(axis, x), axis])


def _about_z(angle: float | Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*np.shape(angle), 3, 3), np.result_type(c))
    matrix[..., 0, 0] = matrix[..., 1, 1] = c
    matrix[..., 0, 1], matrix[..., 1, 0] = -s, s
    matrix[..., 2, 2] = 1.0
    return matrix


def antiparallel_message(joint: str, column: int) -> str:
    """Return the message for a joint that is assembled with antiparallel columns of its joint frames."""
    return (
        f"joint {joint!r} is assembled with antiparallel {_DIRECTIONS[column]}; reverse one of them, or give "
        "a guess closer to the intended assembly"
    )
