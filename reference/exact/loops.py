"""Vector loops of a mechanism in absolute coordinates: every link has a position and a rotation of its own.

Every joint gives scalar equations of two forms: a direction of side a times the gap between the two
points, and a direction of side a times one of side b. Each row has its value, its derivative by the twists
of both links (velocity of the origin, angular velocity), and its velocity-product term. Numbers are doubles
or mpmath's, as those of the state are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mp

from exact.description import GROUND, Description, Pair, Side, cross

SPHERES = 2  # of a link held by two spherical joints only


@dataclass
class State:
    """Positions (3,) and rotation matrices (3, 3) by link, and twists (6,)."""

    position: dict[str, Any]
    rotation: dict[str, Any]
    twist: dict[str, Any]


@dataclass(frozen=True)
class SideState:
    """A side of a joint in space: arm from the link's origin, point, frame, and the link's twist."""

    arm: Any
    point: Any
    frame: Any
    twist: Any

    @property
    def velocity(self) -> Any:
        """Velocity of the point."""
        return self.twist[:3] + cross(self.twist[3:], self.arm)

    @property
    def centripetal(self) -> Any:
        """Centripetal acceleration of the point."""
        return cross(self.twist[3:], cross(self.twist[3:], self.arm))

    def rates(self, column: int) -> tuple[Any, Any, Any]:
        """Return a direction, its rate, and its second derivative at constant angular velocity."""
        direction = self.frame[:, column]
        rate = cross(self.twist[3:], direction)
        return direction, rate, cross(self.twist[3:], rate)


@dataclass(frozen=True)
class Row:
    """A scalar equation: value, derivative by each link's twist, velocity-product term."""

    value: Any
    derivatives: Mapping[str, Any]
    rest: Any


def side_state(state: State, side: Side) -> SideState:
    """Return a side of a joint in space."""
    if side.link == GROUND:
        return SideState(0 * side.point, side.point, side.frame, np.zeros(6, dtype=int))
    rotation = state.rotation[side.link]
    arm = rotation @ side.point
    return SideState(arm, state.position[side.link] + arm, rotation @ side.frame, state.twist[side.link])


def gap_row(pair: Pair, a: SideState, b: SideState, column: int) -> Row:
    """Return a direction of side a times the gap between the points."""
    direction, rate, normal_rate = a.rates(column)
    between = b.point - a.point
    derivative_a = np.concatenate([-direction, cross(direction, between) - cross(a.arm, direction)])
    derivative_b = np.concatenate([direction, cross(b.arm, direction)])
    rest = (
        normal_rate @ between
        + 2 * (rate @ (b.velocity - a.velocity))
        + direction @ (b.centripetal - a.centripetal)
    )
    return Row(direction @ between, {pair.a.link: derivative_a, pair.b.link: derivative_b}, rest)


def product_row(pair: Pair, a: SideState, b: SideState, first: int, second: int) -> Row:
    """Return a direction of side a times one of side b."""
    direction, rate, normal_rate = a.rates(first)
    other, other_rate, other_normal_rate = b.rates(second)
    derivative = np.concatenate([0 * direction, cross(direction, other)])
    rest = normal_rate @ other + 2 * (rate @ other_rate) + direction @ other_normal_rate
    return Row(direction @ other, {pair.a.link: derivative, pair.b.link: -derivative}, rest)


# kind -> columns along which the points must meet, pairs of columns that must be square
CONSTRAINTS: dict[str, tuple[Sequence[int], Sequence[tuple[int, int]]]] = {
    "revolute": ((0, 1, 2), ((0, 2), (1, 2))),
    "prismatic": ((0, 1), ((0, 2), (1, 2), (0, 1))),
    "cylindrical": ((0, 1), ((0, 2), (1, 2))),
    "universal": ((0, 1, 2), ((2, 2),)),
    "spherical": ((0, 1, 2), ()),
}


def coordinate(pair: Pair, a: SideState, b: SideState, guess: float) -> Row:
    """Return the coordinate of a hinge or a slide, its angle the one nearest to a value in [rad]."""
    if pair.kind == "prismatic":
        return gap_row(pair, a, b, 2)
    axis, rate, _ = a.rates(2)
    derivative = np.concatenate([0 * axis, axis])
    derivatives = {pair.a.link: -derivative, pair.b.link: derivative}
    reference = b.frame[:, 0]
    exact = isinstance(reference[0], mp.mpf)
    library = mp if exact else np
    atan2: Callable[..., Any] = mp.atan2 if exact else np.arctan2
    angle = atan2(a.frame[:, 1] @ reference, a.frame[:, 0] @ reference)
    turns = round((guess - float(angle)) / (2 * np.pi))
    return Row(angle + 2 * library.pi * turns, derivatives, rate @ (b.twist[3:] - a.twist[3:]))


def coordinates(described: Description, state: State, guess: Mapping[str, float]) -> dict[str, Row]:
    """Return the coordinates of drivers and couplings."""
    requested = {
        *described.drivers,
        *(name for mate in described.mates for name in (mate.driver, mate.driven)),
    }
    return {
        pair.name: coordinate(
            pair, side_state(state, pair.a), side_state(state, pair.b), guess.get(pair.name, 0.0)
        )
        for pair in described.pairs
        if pair.name in requested
    }


def rows(
    described: Description, state: State, guess: Mapping[str, float], prescribed: Mapping[str, Any]
) -> list[Row]:
    """Return all equations, those of the drivers last, in their order."""
    equations: list[Row] = []
    for pair in described.pairs:
        a, b = side_state(state, pair.a), side_state(state, pair.b)
        meet, right = CONSTRAINTS[pair.kind]
        equations += [gap_row(pair, a, b, column) for column in meet]
        equations += [product_row(pair, a, b, *columns) for columns in right]
    equations += [passive_rotation(described, state, link) for link in spinning(described)]
    available = coordinates(described, state, guess)
    for mate in described.mates:
        driven, driver = available[mate.driven], available[mate.driver]
        derivatives = dict(driven.derivatives)
        for link, derivative in driver.derivatives.items():
            derivatives[link] = derivatives.get(link, 0) - mate.ratio * derivative
        left = driven.value - mate.ratio * driver.value - mate.phase
        equations.append(Row(left, derivatives, driven.rest - mate.ratio * driver.rest))
    for name in described.drivers:
        row = available[name]
        equations.append(Row(row.value - prescribed[name], row.derivatives, row.rest))
    return equations


def spinning(described: Description) -> list[str]:
    """Return links held by two spherical joints alone, which may spin about the line between them."""
    ends: dict[str, list[str]] = {}
    for pair in described.pairs:
        for side in (pair.a, pair.b):
            ends.setdefault(side.link, []).append(pair.kind)
    return [link for link, kinds in ends.items() if kinds == ["spherical"] * SPHERES]


def passive_rotation(described: Description, state: State, link: str) -> Row:
    """Return the equation of a round link without spin, on which no moment acts about its line.

    Its angular velocity and its angular acceleration are square to the line between its joints.
    """
    first, second = (side.point for pair in described.pairs for side in (pair.a, pair.b) if side.link == link)
    line = state.rotation[link] @ (second - first)
    return Row(0 * line[0], {link: np.concatenate([0 * line, line])}, 0 * line[0])
