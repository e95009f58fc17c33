"""Poses, twists, their rates and drive efforts of a mechanism, to the working precision.

Poses are first followed in doubles from the guess of the file; each is then improved by Newton's method,
whose residuals are taken in all digits and whose steps are solved for in doubles: a step gains a dozen
digits, and what it ends at is what makes the residuals vanish. Linear equations are solved so too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mp, mpf

from exact.description import GROUND, Body, Description, Pair, Side, cross
from exact.loops import Row, State, coordinates, rows

MOST_STEPS = 80
RANK = 1e-9  # of the largest singular value
FLOOR = 4  # last digits in which steps tell nothing
EDGE = 14  # last digits that may stay open


@dataclass(frozen=True)
class Instant:
    """What is wanted at an instant: by point places, velocities, accelerations (3,); efforts by driver."""

    points: dict[str, tuple[Any, Any, Any]]
    efforts: dict[str, Any]


def matrix(described: Description, found: Sequence[Row]) -> Any:
    """Return the derivatives of all rows by all twists, (rows, 6 links)."""
    place = {link: 6 * i for i, link in enumerate(described.links)}
    whole = np.zeros((len(found), 6 * len(place)), dtype=object)
    for i, row in enumerate(found):
        for link, part in row.parts.items():
            if link != GROUND:
                whole[i, place[link] : place[link] + 6] += part
    return whole


def inverse(whole: Any) -> Any:
    """Return the pseudo-inverse in doubles of a matrix whose rows may repeat one another."""
    return np.linalg.pinv(whole.astype(float), rcond=RANK)


def solved(whole: Any, right: Any, back: Any) -> Any:
    """Return what makes a matrix times it a right side, to the working precision."""
    answer = np.array([mpf(0)] * whole.shape[1], dtype=object)
    nonzero = [[(j, one) for j, one in enumerate(row) if one != 0] for row in whole]
    before = None
    for _ in range(MOST_STEPS):
        left = np.array(
            [
                want - mp.fsum(one * answer[j] for j, one in row)
                for want, row in zip(right, nonzero, strict=True)
            ],
            dtype=object,
        )
        most = max(abs(one) for one in left)
        if most <= mpf(10) ** (FLOOR - mp.dps) or (before is not None and 2 * most > before):
            break
        before = most
        answer = answer + _applied(back, left, most)
    terms = (abs(one * answer[j]) for row in nonzero for j, one in row)
    if most > max(mpf(1), *terms, *(abs(one) for one in right)) * mpf(10) ** (EDGE - mp.dps):
        raise ArithmeticError(f"linear equations are left open by {mp.nstr(most, 3)}")
    return answer


def _applied(back: Any, left: Any, most: Any) -> Any:
    """Return a matrix of doubles times a vector of many digits, which may be far below the least double."""
    step = back @ np.array([float(one / most) for one in left])
    return np.array([mpf(float(one)) * most for one in step], dtype=object)


def turned(turn: Any, by: Any) -> Any:
    """Return a rotation matrix turned on by a small rotation vector; Cayley."""
    a = by / 2
    square = a @ a
    wide = np.array([cross(a, column) for column in np.eye(3, dtype=int)]).T
    return ((1 - square) * np.eye(3, dtype=int) + 2 * np.outer(a, a) + 2 * wide) @ turn / (1 + square)


def moved(described: Description, state: State, step: Any) -> State:
    """Return a state moved on by a twist of every link."""
    place, turn = {}, {}
    for i, link in enumerate(described.links):
        place[link] = state.place[link] + step[6 * i : 6 * i + 3]
        turn[link] = turned(state.turn[link], step[6 * i + 3 : 6 * i + 6])
    return State(place, turn, state.twist)


def roughly(described: Description, state: State, near: dict[str, float], at: Mapping[str, float]) -> State:
    """Return the state in doubles whose loops close with the drivers at given values, near another."""
    for _ in range(60):
        found = rows(described, state, near, at)
        values = np.array([float(row.value) for row in found])
        step = -inverse(matrix(described, found)) @ values
        state = moved(described, state, step)
        near.update({name: float(row.value) for name, row in coordinates(described, state, near).items()})
        if np.abs(step).max() < 1e-13:
            left = max(abs(float(row.value)) for row in rows(described, state, near, at))
            if left > 1e-11:
                raise ArithmeticError(f"{described.name}: loops stay open by {left:.2g}")
            return state
    raise ArithmeticError(f"{described.name}: no pose near {dict(at)}")


def exactly(described: Description, state: State, near: Mapping[str, float], at: Mapping[str, Any]) -> State:
    """Return the state whose loops close to the working precision."""
    back = inverse(matrix(described, rows(described, state, near, at)))
    before = None
    for _ in range(MOST_STEPS):
        left = np.array([row.value for row in rows(described, state, near, at)], dtype=object)
        most = max(abs(one) for one in left)
        if most <= mpf(10) ** (FLOOR - mp.dps) or (before is not None and 2 * most > before):
            break
        before = most
        state = moved(described, state, -_applied(back, left, most))
    if most <= mpf(10) ** (EDGE - mp.dps):
        return state
    raise ArithmeticError(f"{described.name}: loops stay open by {mp.nstr(most, 3)}")


def in_doubles(described: Description) -> Description:
    """Return a description with doubles in place of many digits."""
    from dataclasses import replace

    def side(one: Side) -> Side:
        return Side(one.link, one.point.astype(float), one.frame.astype(float))

    return replace(
        described,
        pairs=tuple(Pair(one.name, one.kind, side(one.a), side(one.b)) for one in described.pairs),
        mates=tuple(replace(one, ratio=float(one.ratio), phase=float(one.phase)) for one in described.mates),
        start={name: float(one) for name, one in described.start.items()},
        guess={name: (p.astype(float), r.astype(float)) for name, (p, r) in described.guess.items()},
    )


def begun(rough: Description) -> tuple[State, dict[str, float]]:
    """Return the state at the start in doubles, and the coordinates there."""
    place = {name: pose[0] for name, pose in rough.guess.items()}
    turn = {name: _nearest(pose[1]) for name, pose in rough.guess.items()}
    while missing := [link for link in rough.links if link not in place]:
        for pair in rough.pairs:
            _put(pair, rough.start.get(pair.name, 0.0), place, turn)
        if missing == [link for link in rough.links if link not in place]:
            raise ValueError(f"{rough.name}: nothing says where {missing[0]} is")
    state = State(place, turn, {link: np.zeros(6) for link in rough.links})
    near: dict[str, float] = dict(rough.start)
    return roughly(rough, state, near, rough.start), near


def _nearest(turn: Any) -> Any:
    left, _, right = np.linalg.svd(turn)
    return left @ right


def _put(pair: Pair, value: float, place: dict[str, Any], turn: dict[str, Any]) -> None:
    """Place the link of a joint whose other link is placed."""
    known = {GROUND, *place}
    a, b, sign = pair.a, pair.b, 1.0
    if b.link in known and a.link not in known:
        a, b, sign = b, a, -1.0
    if a.link not in known or b.link in known:
        return
    base, origin = turn.get(a.link, np.eye(3)), place.get(a.link, np.zeros(3))
    angle, slide = (0.0, value) if pair.kind == "prismatic" else (sign * value, 0.0)
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turn[b.link] = base @ a.frame @ about @ b.frame.T
    way = sign * slide * (base @ a.frame[:, 2])
    place[b.link] = origin + base @ a.point + way - turn[b.link] @ b.point


def followed(rough: Description, path: Sequence[Mapping[str, float]]) -> list[tuple[State, dict[str, float]]]:
    """Return states and coordinates along a path of the drivers, begun at their start."""
    state, near = begun(rough)
    here, kept = dict(rough.start), []
    for there in path:
        wide = max(abs(there[name] - here[name]) for name in there)
        count = max(1, int(np.ceil(wide / 0.05)))
        for i in range(1, count + 1):
            part = {name: here[name] + (there[name] - here[name]) * i / count for name in there}
            state = roughly(rough, state, near, part)
        here = dict(there)
        kept.append((state, dict(near)))
    return kept


def instant(
    described: Description, state: State, near: Mapping[str, float], drive: Mapping[str, tuple[Any, Any, Any]]
) -> Instant:
    """Return all that is wanted at an instant.

    Args:
        described: the mechanism.
        state: in doubles, near it.
        near: coordinates there.
        drive: driver -> its value, rate and acceleration in [m] or [rad] and [s].
    """
    zero = np.array([mpf(0)] * 6, dtype=object)
    many = State(
        {link: _many(one) for link, one in state.place.items()},
        {link: _square(_many(one)) for link, one in state.turn.items()},
        dict.fromkeys(described.links, zero),
    )
    at = {name: one[0] for name, one in drive.items()}
    many = exactly(described, many, near, at)
    found = rows(described, many, near, at)
    whole = matrix(described, found)
    back = inverse(whole)
    count, drivers = len(found), len(described.drivers)
    unit = [solved(whole, _unit(count, count - drivers + i), back) for i in range(drivers)]
    twist = sum(
        (one * drive[name][1] for one, name in zip(unit, described.drivers, strict=True)), 0 * unit[0]
    )
    many.twist = {link: twist[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
    right = np.array([-row.rest for row in rows(described, many, near, at)], dtype=object)
    for i, name in enumerate(described.drivers):
        right[count - drivers + i] += drive[name][2]
    rate = solved(whole, right, back)
    rates = {link: rate[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
    efforts = {
        name: effort(described, many, rates, one) for name, one in zip(described.drivers, unit, strict=True)
    }
    points = {name: tracked(many, rates, *place) for name, place in described.points.items()}
    return Instant(points, efforts)


def _many(array: Any) -> Any:
    return np.array([mpf(float(one)) for one in array.ravel()], dtype=object).reshape(array.shape)


def _square(turn: Any) -> Any:
    """Return a rotation matrix made orthogonal to the working precision."""
    x = turn[:, 0] / mp.sqrt(turn[:, 0] @ turn[:, 0])
    y = turn[:, 1] - x * (x @ turn[:, 1])
    y = y / mp.sqrt(y @ y)
    return np.column_stack([x, y, cross(x, y)])


def _unit(count: int, place: int) -> Any:
    return np.array([mpf(int(i == place)) for i in range(count)], dtype=object)


def tracked(state: State, rates: Mapping[str, Any], link: str, local: Any) -> tuple[Any, Any, Any]:
    """Return place, velocity and acceleration of a point of a link."""
    arm = state.turn[link] @ local
    twist, rate = state.twist[link], rates[link]
    around = cross(twist[3:], arm)
    acceleration = rate[:3] + cross(rate[3:], arm) + cross(twist[3:], around)
    return state.place[link] + arm, twist[:3] + around, acceleration


def effort(described: Description, state: State, rates: Mapping[str, Any], unit: Any) -> Any:
    """Return the torque or force of a driver by virtual power.

    What inertia and weight of all links do on the motion in which it alone moves, by 1 rad/s or 1 m/s.
    """
    total = mpf(0)
    for i, link in enumerate(described.links):
        body: Body = described.bodies[link]
        virtual = unit[6 * i : 6 * i + 6]
        arm = state.turn[link] @ body.centre
        _, _, acceleration = tracked(state, rates, link, body.centre)
        moments = state.turn[link] @ body.moments @ state.turn[link].T
        spin, change = state.twist[link][3:], rates[link][3:]
        force = body.mass * (acceleration - described.gravity)
        couple = moments @ change + cross(spin, moments @ spin)
        total += force @ (virtual[:3] + cross(virtual[3:], arm)) + couple @ virtual[3:]
    return total
