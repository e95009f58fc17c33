"""The kinds of joint: along what one side slides and about what it turns; all else follows from that.

A row of `KINDS` says how many freedoms a joint has, how many equations hold the rest, which coordinates
it has, what it transmits and where its friction acts. Axes are named in it by where they are fixed:

- "a": the axis as side a has it, along which that of side b lies;
- "b": the axis as side b has it, where it crosses that of side a (`cross_angle`);
- "x", "y", "z": the reference of side a, axis x reference, and the axis as side a has it.

A joint turns about nothing, about "a", about "a" and "b", or about all of "x", "y" and "z" as a ball.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import turn_of

Axis = Literal["a", "b", "x", "y", "z"]
KindName = Literal[
    "revolute", "prismatic", "cylindrical", "screw", "universal", "spherical", "planar", "fixed", "floating"
]

# what the columns of a joint frame are called that must not be opposed
_OPPOSED = {2: "axes", 0: "marks"}
# axis -> column of the joint frame of the side it is fixed on: b for "b", else a
COLUMN: dict[Axis, int] = {"x": 0, "y": 1, "z": 2, "a": 2, "b": 2}


@dataclass(frozen=True)
class Kind:
    """What a kind of joint leaves free: the axes along which it slides and those about which it turns."""

    slides: tuple[Axis, ...]
    turns: tuple[Axis, ...]
    # whether its displacement goes with its turn, by `Joint.lead`
    helical: bool = False

    @cached_property
    def dof(self) -> int:
        """How many relative motions are free; of a screw, which a coupling holds, both."""
        return len(self.slides) + len(self.turns)

    @cached_property
    def forces(self) -> int:
        """How many components of force it transmits: as many equations between lengths hold it."""
        return 3 - len(self.slides)

    @cached_property
    def moments(self) -> int:
        """How many components of moment it transmits: as many equations between directions hold it."""
        return 3 - len(self.turns)

    @cached_property
    def ball(self) -> bool:
        """Whether it turns about every axis, which no angles count."""
        return len(self.turns) == 3

    @cached_property
    def floating(self) -> bool:
        """Whether it holds nothing."""
        return self.ball and len(self.slides) == 3

    @cached_property
    def crossed(self) -> bool:
        """Whether it turns about two axes that cross."""
        return len(self.turns) == 2

    @cached_property
    def aligned(self) -> bool:
        """Whether the axes of both sides lie along each other."""
        return len(self.turns) < 2

    @cached_property
    def aligned_columns(self) -> tuple[int, ...]:
        """Columns of both sides' frames that point one way, not only along each other, as rows have it."""
        return () if not self.aligned else (2,) if self.turns else (2, 0)

    @cached_property
    def hinge(self) -> bool:
        """Whether it turns about its axis and does nothing else."""
        return self.aligned and not self.slides and bool(self.turns)

    @cached_property
    def pivot(self) -> bool:
        """Whether it turns about a point that stays where it is on both sides."""
        return bool(self.turns) and not self.slides

    @cached_property
    def single(self) -> bool:
        """Whether it has one freedom: a hinge or a slide."""
        return self.dof == 1

    @cached_property
    def drivable(self) -> bool:
        """Whether its coordinates can be prescribed: a hinge, a slide, or both along one axis."""
        return self.slides in ((), ("a",)) and self.turns in ((), ("a",)) and self.dof > 0

    @cached_property
    def mixed(self) -> bool:
        """Whether it both slides and turns, by coordinates of its own."""
        return bool(self.slides and self.turns) and not self.ball

    @cached_property
    def suffixes(self) -> tuple[str, ...]:
        """What follows a joint's name in the name of each of its coordinates; a ball's turns have none."""
        if self.single:
            return ("",)
        slides = (".way",) if len(self.slides) == 1 else tuple(f".{axis}" for axis in self.slides)
        if self.ball:
            return slides
        turns = (".turn",) if len(self.turns) == 1 else tuple(f".{i + 1}" for i in range(len(self.turns)))
        return slides + turns

    @cached_property
    def units(self) -> tuple[Literal["m", "rad"], ...]:
        """Units of its coordinates: displacements, then angles; the turning of a ball has none."""
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
}

# the kinds that leave nothing and everything free
FIXED: KindName = "fixed"
FLOATING: KindName = "floating"


def kinds_that(rule: Callable[[Kind], bool]) -> str:
    """Return the names of the kinds for which a rule holds, as "revolute or prismatic"."""
    return " or ".join(name for name, kind in KINDS.items() if rule(kind))


def coordinates(kind: Kind, gap: Array, frame_a: Array, frame_b: Array, cross_angle: float) -> Array:
    """Return the coordinates of a joint, (..., k) in [m] and (-pi, pi] rad, in the order of `Kind.units`.

    Args:
        kind: of the joint.
        gap: from a's point to b's in any frame, (..., 3) in [m].
        frame_a: a's joint frame in that frame, (..., 3, 3).
        frame_b: b's.
        cross_angle: between crossed axes, in [rad].
    """
    columns = [(gap * frame_a[..., COLUMN[axis]]).sum(-1) for axis in kind.slides]
    if kind.crossed:
        columns += _crossed_angles(cross_angle, frame_a, frame_b)
    elif not kind.ball and kind.turns:
        x_of_b = (np.swapaxes(frame_a, -1, -2) @ frame_b[..., :1])[..., 0]  # b's reference seen from a
        columns.append(turn_of(x_of_b[..., 1], x_of_b[..., 0]))
    return np.stack(columns, -1) if columns else np.empty((*gap.shape[:-1], 0))


def displaced(kind: Kind, values: Sequence[float | Array], cross_angle: float) -> tuple[Array, Array]:
    """Return where b's joint frame stands in a's: (..., 3) in [m] and (..., 3, 3); a ball's is not turned.

    Args:
        kind: of the joint.
        values: its coordinates, as `coordinates` gives them, each a number or (...).
        cross_angle: between crossed axes, in [rad].
    """
    shift = np.zeros((*np.shape(values[0] if len(values) else 0.0), 3))
    for axis, value in zip(kind.slides, values, strict=False):
        shift[..., COLUMN[axis]] = value
    angles = values[len(kind.slides) :]
    if kind.crossed:
        return shift, _about_z(angles[0]) @ crossed_at_zero(cross_angle) @ _about_z(angles[1])
    return shift, _about_z(angles[0]) if len(angles) else np.eye(3)


def crossed_at_zero(cross_angle: float) -> Array:
    """Return b's joint frame seen from a's at both angles zero of a joint with crossed axes, (3, 3)."""
    c, s = np.cos(cross_angle), np.sin(cross_angle)
    axis, x = np.array([s, 0.0, c]), np.array([-c, 0.0, s])
    return np.column_stack([x, np.cross(axis, x), axis])


def _crossed_angles(cross_angle: float, frame_a: Array, frame_b: Array) -> tuple[Array, Array]:
    relative = np.swapaxes(frame_a, -1, -2) @ frame_b
    first = turn_of(relative[..., 1, 2], relative[..., 0, 2])
    c, s = np.cos(first), np.sin(first)
    back = np.zeros_like(relative)  # undo the turn about a's axis
    back[..., 0, 0], back[..., 0, 1] = c, s
    back[..., 1, 0], back[..., 1, 1] = -s, c
    back[..., 2, 2] = 1.0
    rest = crossed_at_zero(cross_angle).T @ back @ relative
    return first, turn_of(rest[..., 1, 0], rest[..., 0, 0])


def _about_z(angle: float | Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.zeros((*np.shape(angle), 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = c
    matrix[..., 0, 1], matrix[..., 1, 0] = -s, s
    matrix[..., 2, 2] = 1.0
    return matrix


def antiparallel_message(joint: str, column: int) -> str:
    """Return in one sentence that a joint came together with columns of its sides' frames opposed."""
    return (
        f"joint {joint!r} came together with its {_OPPOSED[column]} opposed; turn one round, or give a guess "
        "nearer the assembly meant"
    )
