"""Vector loops of a mechanism in absolute coordinates: every link has a place and an attitude of its own.

Every joint gives scalar equations of two forms: a direction of side a times the gap between the two
points, and a direction of side a times one of side b. Each equation is told with its value, its derivative
by the twists of both links (velocity of the origin, angular velocity), and what is left of its second
derivative where no twist changes. Numbers are doubles or mpmath's, as those of the state are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mp

from exact.description import GROUND, Description, Pair, Side, cross

SPHERES = 2  # spherical joints of a link that nothing else holds


@dataclass
class State:
    """Places (3,) and rotation matrices (3, 3) by link, and twists (6,)."""

    place: dict[str, Any]
    turn: dict[str, Any]
    twist: dict[str, Any]


@dataclass(frozen=True)
class Seen:
    """A side of a joint in space: arm from the link's origin, point, frame, and the link's twist."""

    arm: Any
    point: Any
    frame: Any
    twist: Any

    @property
    def drift(self) -> Any:
        """Velocity of the point."""
        return self.twist[:3] + cross(self.twist[3:], self.arm)

    @property
    def bend(self) -> Any:
        """Acceleration of the point that it has from turning alone."""
        return cross(self.twist[3:], cross(self.twist[3:], self.arm))

    def rates(self, column: int) -> tuple[Any, Any, Any]:
        """Return a direction, its rate, and its second derivative that it has from turning alone."""
        way = self.frame[:, column]
        rate = cross(self.twist[3:], way)
        return way, rate, cross(self.twist[3:], rate)


@dataclass(frozen=True)
class Row:
    """A scalar equation: value, derivative by each link's twist, what is left of the second derivative."""

    value: Any
    parts: Mapping[str, Any]
    rest: Any


def seen(state: State, side: Side) -> Seen:
    """Return a side of a joint in space."""
    if side.link == GROUND:
        return Seen(0 * side.point, side.point, side.frame, np.zeros(6, dtype=int))
    turn = state.turn[side.link]
    arm = turn @ side.point
    return Seen(arm, state.place[side.link] + arm, turn @ side.frame, state.twist[side.link])


def gap(pair: Pair, a: Seen, b: Seen, column: int) -> Row:
    """Return a direction of side a times the gap between the points."""
    way, rate, turning = a.rates(column)
    between = b.point - a.point
    part_a = np.concatenate([-way, cross(way, between) - cross(a.arm, way)])
    part_b = np.concatenate([way, cross(b.arm, way)])
    rest = turning @ between + 2 * (rate @ (b.drift - a.drift)) + way @ (b.bend - a.bend)
    return Row(way @ between, {pair.a.link: part_a, pair.b.link: part_b}, rest)


def square(pair: Pair, a: Seen, b: Seen, first: int, second: int) -> Row:
    """Return a direction of side a times one of side b."""
    way, rate, turning = a.rates(first)
    other, other_rate, other_turning = b.rates(second)
    part = np.concatenate([0 * way, cross(way, other)])
    rest = turning @ other + 2 * (rate @ other_rate) + way @ other_turning
    return Row(way @ other, {pair.a.link: part, pair.b.link: -part}, rest)


# kind -> columns along which the points must meet, pairs of columns that must be square
HELD: dict[str, tuple[Sequence[int], Sequence[tuple[int, int]]]] = {
    "revolute": ((0, 1, 2), ((0, 2), (1, 2))),
    "prismatic": ((0, 1), ((0, 2), (1, 2), (0, 1))),
    "cylindrical": ((0, 1), ((0, 2), (1, 2))),
    "universal": ((0, 1, 2), ((2, 2),)),
    "spherical": ((0, 1, 2), ()),
}


def coordinate(pair: Pair, a: Seen, b: Seen, near: float) -> Row:
    """Return the coordinate of a hinge or a slide, its angle the one nearest to a value in [rad]."""
    if pair.kind == "prismatic":
        return gap(pair, a, b, 2)
    axis, rate, _ = a.rates(2)
    part = np.concatenate([0 * axis, axis])
    parts = {pair.a.link: -part, pair.b.link: part}
    mark = b.frame[:, 0]
    exact = isinstance(mark[0], mp.mpf)
    lead = mp if exact else np
    atan2: Callable[..., Any] = mp.atan2 if exact else np.arctan2
    angle = atan2(a.frame[:, 1] @ mark, a.frame[:, 0] @ mark)
    turns = round((near - float(angle)) / (2 * np.pi))
    return Row(angle + 2 * lead.pi * turns, parts, rate @ (b.twist[3:] - a.twist[3:]))


def coordinates(described: Description, state: State, near: Mapping[str, float]) -> dict[str, Row]:
    """Return the coordinates that drivers and couplings speak of."""
    wanted = {*described.drivers, *(name for mate in described.mates for name in (mate.driver, mate.driven))}
    return {
        pair.name: coordinate(pair, seen(state, pair.a), seen(state, pair.b), near.get(pair.name, 0.0))
        for pair in described.pairs
        if pair.name in wanted
    }


def rows(described: Description, state: State, near: Mapping[str, float], at: Mapping[str, Any]) -> list[Row]:
    """Return all equations, those of the drivers last, in their order."""
    found: list[Row] = []
    for pair in described.pairs:
        a, b = seen(state, pair.a), seen(state, pair.b)
        meet, right = HELD[pair.kind]
        found += [gap(pair, a, b, column) for column in meet]
        found += [square(pair, a, b, *columns) for columns in right]
    found += [_unspun(described, state, link) for link in spinning(described)]
    known = coordinates(described, state, near)
    for mate in described.mates:
        driven, driver = known[mate.driven], known[mate.driver]
        parts = dict(driven.parts)
        for link, part in driver.parts.items():
            parts[link] = parts.get(link, 0) - mate.ratio * part
        left = driven.value - mate.ratio * driver.value - mate.phase
        found.append(Row(left, parts, driven.rest - mate.ratio * driver.rest))
    for name in described.drivers:
        row = known[name]
        found.append(Row(row.value - at[name], row.parts, row.rest))
    return found


def spinning(described: Description) -> list[str]:
    """Return links held by two spherical joints alone, which may spin about the line between them."""
    ends: dict[str, list[str]] = {}
    for pair in described.pairs:
        for side in (pair.a, pair.b):
            ends.setdefault(side.link, []).append(pair.kind)
    return [link for link, kinds in ends.items() if kinds == ["spherical"] * SPHERES]


def _unspun(described: Description, state: State, link: str) -> Row:
    """Return the equation that a round link does not spin, which nothing makes it do.

    Its angular velocity and its angular acceleration are square to the line between its joints.
    """
    first, second = (side.point for pair in described.pairs for side in (pair.a, pair.b) if side.link == link)
    line = state.turn[link] @ (second - first)
    return Row(0 * line[0], {link: np.concatenate([0 * line, line])}, 0 * line[0])
