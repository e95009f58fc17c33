"""Poses, twists, their rates and drive efforts of a mechanism, to the working precision.

Poses are first followed in doubles from the guess of the file; each is then improved by Newton's method,
whose residuals are taken in all digits and whose steps are solved for in doubles: a step gains a dozen
digits, and the residuals alone decide the result. Linear equations are solved alike.
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
FLOOR = 4  # last digits, in which steps are rounding
EDGE = 14  # last digits that may stay open


@dataclass(frozen=True)
class Instant:
    """An instant: positions, velocities, accelerations (3,) by point; drive forces by driver."""

    points: dict[str, tuple[Any, Any, Any]]
    drive_forces: dict[str, Any]


def matrix(described: Description, equations: Sequence[Row]) -> Any:
    """Return the derivatives of all rows by all twists, (rows, 6 links)."""
    position = {link: 6 * i for i, link in enumerate(described.links)}
    jacobian = np.zeros((len(equations), 6 * len(position)), dtype=object)
    for i, row in enumerate(equations):
        for link, derivative in row.derivatives.items():
            if link != GROUND:
                jacobian[i, position[link] : position[link] + 6] += derivative
    return jacobian


def inverse(jacobian: Any) -> Any:
    """Return the pseudo-inverse in doubles of a matrix whose rows may repeat one another."""
    return np.linalg.pinv(jacobian.astype(float), rcond=RANK)


def solved(jacobian: Any, right: Any, pseudo_inverse: Any) -> Any:
    """Return the solution of linear equations to the working precision."""
    answer = np.array([mpf(0)] * jacobian.shape[1], dtype=object)
    nonzero = [[(j, item) for j, item in enumerate(row) if item != 0] for row in jacobian]
    before = None
    for _ in range(MOST_STEPS):
        left = np.array(
            [
                right_side - mp.fsum(item * answer[j] for j, item in row)
                for right_side, row in zip(right, nonzero, strict=True)
            ],
            dtype=object,
        )
        largest = max(abs(item) for item in left)
        if largest <= mpf(10) ** (FLOOR - mp.dps) or (before is not None and 2 * largest > before):
            break
        before = largest
        answer = answer + _applied(pseudo_inverse, left, largest)
    terms = (abs(item * answer[j]) for row in nonzero for j, item in row)
    if largest > max(mpf(1), *terms, *(abs(item) for item in right)) * mpf(10) ** (EDGE - mp.dps):
        raise ArithmeticError(f"linear equations are left open by {mp.nstr(largest, 3)}")
    return answer


def _applied(pseudo_inverse: Any, left: Any, largest: Any) -> Any:
    """Return a matrix of doubles times a vector of many digits, which may be far below the least double."""
    step = pseudo_inverse @ np.array([float(item / largest) for item in left])
    return np.array([mpf(float(item)) * largest for item in step], dtype=object)


def rotated(rotation: Any, by: Any) -> Any:
    """Return a rotation matrix turned on by a small rotation vector; Cayley."""
    a = by / 2
    square = a @ a
    wide = np.array([cross(a, column) for column in np.eye(3, dtype=int)]).T
    return ((1 - square) * np.eye(3, dtype=int) + 2 * np.outer(a, a) + 2 * wide) @ rotation / (1 + square)


def moved(described: Description, state: State, step: Any) -> State:
    """Return a state moved on by a twist of every link."""
    position, rotation = {}, {}
    for i, link in enumerate(described.links):
        position[link] = state.position[link] + step[6 * i : 6 * i + 3]
        rotation[link] = rotated(state.rotation[link], step[6 * i + 3 : 6 * i + 6])
    return State(position, rotation, state.twist)


def roughly(
    described: Description, state: State, guess: dict[str, float], prescribed: Mapping[str, float]
) -> State:
    """Return the state in doubles whose loops close with the drivers at given values, near another."""
    for _ in range(60):
        equations = rows(described, state, guess, prescribed)
        values = np.array([float(row.value) for row in equations])
        step = -inverse(matrix(described, equations)) @ values
        state = moved(described, state, step)
        guess.update({name: float(row.value) for name, row in coordinates(described, state, guess).items()})
        if np.abs(step).max() < 1e-13:
            left = max(abs(float(row.value)) for row in rows(described, state, guess, prescribed))
            if left > 1e-11:
                raise ArithmeticError(f"{described.name}: loops stay open by {left:.2g}")
            return state
    raise ArithmeticError(f"{described.name}: no pose near {dict(prescribed)}")


def exactly(
    described: Description, state: State, guess: Mapping[str, float], prescribed: Mapping[str, Any]
) -> State:
    """Return the state whose loops close to the working precision."""
    pseudo_inverse = inverse(matrix(described, rows(described, state, guess, prescribed)))
    before = None
    for _ in range(MOST_STEPS):
        left = np.array([row.value for row in rows(described, state, guess, prescribed)], dtype=object)
        largest = max(abs(item) for item in left)
        if largest <= mpf(10) ** (FLOOR - mp.dps) or (before is not None and 2 * largest > before):
            break
        before = largest
        state = moved(described, state, -_applied(pseudo_inverse, left, largest))
    if largest <= mpf(10) ** (EDGE - mp.dps):
        return state
    raise ArithmeticError(f"{described.name}: loops stay open by {mp.nstr(largest, 3)}")


def in_doubles(described: Description) -> Description:
    """Return a description with doubles in place of many digits."""
    from dataclasses import replace

    def side(item: Side) -> Side:
        return Side(item.link, item.point.astype(float), item.frame.astype(float))

    return replace(
        described,
        pairs=tuple(Pair(item.name, item.kind, side(item.a), side(item.b)) for item in described.pairs),
        mates=tuple(
            replace(item, ratio=float(item.ratio), phase=float(item.phase)) for item in described.mates
        ),
        start={name: float(item) for name, item in described.start.items()},
        guess={name: (p.astype(float), r.astype(float)) for name, (p, r) in described.guess.items()},
    )


def start_state(doubles: Description) -> tuple[State, dict[str, float]]:
    """Return the state at the start in doubles, and the coordinates there."""
    position = {name: pose[0] for name, pose in doubles.guess.items()}
    rotation = {name: _nearest(pose[1]) for name, pose in doubles.guess.items()}
    while missing := [link for link in doubles.links if link not in position]:
        for pair in doubles.pairs:
            _put(pair, doubles.start.get(pair.name, 0.0), position, rotation)
        if missing == [link for link in doubles.links if link not in position]:
            raise ValueError(f"{doubles.name}: nothing says where {missing[0]} is")
    state = State(position, rotation, {link: np.zeros(6) for link in doubles.links})
    guess: dict[str, float] = dict(doubles.start)
    return roughly(doubles, state, guess, doubles.start), guess


def _nearest(rotation: Any) -> Any:
    left, _, right = np.linalg.svd(rotation)
    return left @ right


def _put(pair: Pair, value: float, position: dict[str, Any], rotation: dict[str, Any]) -> None:
    """Place the link of a joint whose other link is placed."""
    available = {GROUND, *position}
    a, b, sign = pair.a, pair.b, 1.0
    if b.link in available and a.link not in available:
        a, b, sign = b, a, -1.0
    if a.link not in available or b.link in available:
        return
    base, origin = rotation.get(a.link, np.eye(3)), position.get(a.link, np.zeros(3))
    angle, slide = (0.0, value) if pair.kind == "prismatic" else (sign * value, 0.0)
    c, s = np.cos(angle), np.sin(angle)
    about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    rotation[b.link] = base @ a.frame @ about @ b.frame.T
    direction = sign * slide * (base @ a.frame[:, 2])
    position[b.link] = origin + base @ a.point + direction - rotation[b.link] @ b.point


def followed(
    doubles: Description, path: Sequence[Mapping[str, float]]
) -> list[tuple[State, dict[str, float]]]:
    """Return states and coordinates along a path of the drivers from their start."""
    state, guess = start_state(doubles)
    current, results = dict(doubles.start), []
    for target in path:
        wide = max(abs(target[name] - current[name]) for name in target)
        count = max(1, int(np.ceil(wide / 0.05)))
        for i in range(1, count + 1):
            derivative = {name: current[name] + (target[name] - current[name]) * i / count for name in target}
            state = roughly(doubles, state, guess, derivative)
        current = dict(target)
        results.append((state, dict(guess)))
    return results


def instant(
    described: Description,
    state: State,
    guess: Mapping[str, float],
    motion: Mapping[str, tuple[Any, Any, Any]],
) -> Instant:
    """Return points and drive forces at an instant.

    Args:
        described: the mechanism.
        state: in doubles, near it.
        near: coordinates there.
        drive: driver -> its value, rate and acceleration in [m] or [rad] and [s].
    """
    exact = to_digits(described, state)
    prescribed = {name: item[0] for name, item in motion.items()}
    exact = exactly(described, exact, guess, prescribed)
    equations = rows(described, exact, guess, prescribed)
    jacobian = matrix(described, equations)
    pseudo_inverse = inverse(jacobian)
    count, drivers = len(equations), len(described.drivers)
    unit = [solved(jacobian, _unit(count, count - drivers + i), pseudo_inverse) for i in range(drivers)]
    twist = sum(
        (item * motion[name][1] for item, name in zip(unit, described.drivers, strict=True)), 0 * unit[0]
    )
    exact.twist = {link: twist[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
    right = np.array([-row.rest for row in rows(described, exact, guess, prescribed)], dtype=object)
    for i, name in enumerate(described.drivers):
        right[count - drivers + i] += motion[name][2]
    rate = solved(jacobian, right, pseudo_inverse)
    rates = {link: rate[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
    drive_forces = {
        name: effort(described, exact, rates, item)
        for name, item in zip(described.drivers, unit, strict=True)
    }
    points = {name: tracked(exact, rates, *position) for name, position in described.points.items()}
    return Instant(points, drive_forces)


def to_digits(described: Description, state: State) -> State:
    """Return a state at rest at the working precision, near one in doubles."""
    return State(
        {link: _many(item) for link, item in state.position.items()},
        {link: _square(_many(item)) for link, item in state.rotation.items()},
        dict.fromkeys(described.links, np.array([mpf(0)] * 6, dtype=object)),
    )


def _many(array: Any) -> Any:
    return np.array([mpf(float(item)) for item in array.ravel()], dtype=object).reshape(array.shape)


def _square(rotation: Any) -> Any:
    """Return a rotation matrix made orthogonal to the working precision."""
    x = rotation[:, 0] / mp.sqrt(rotation[:, 0] @ rotation[:, 0])
    y = rotation[:, 1] - x * (x @ rotation[:, 1])
    y = y / mp.sqrt(y @ y)
    return np.column_stack([x, y, cross(x, y)])


def _unit(count: int, position: int) -> Any:
    return np.array([mpf(int(i == position)) for i in range(count)], dtype=object)


def tracked(state: State, rates: Mapping[str, Any], link: str, local: Any) -> tuple[Any, Any, Any]:
    """Return position, velocity and acceleration of a point of a link."""
    arm = state.rotation[link] @ local
    twist, rate = state.twist[link], rates[link]
    around = cross(twist[3:], arm)
    acceleration = rate[:3] + cross(rate[3:], arm) + cross(twist[3:], around)
    return state.position[link] + arm, twist[:3] + around, acceleration


def effort(described: Description, state: State, rates: Mapping[str, Any], unit: Any) -> Any:
    """Return the torque or force of a driver by virtual power.

    What inertia and weight of all links do on the motion in which it alone moves, by 1 rad/s or 1 m/s.
    """
    total = mpf(0)
    for i, link in enumerate(described.links):
        body: Body = described.bodies[link]
        virtual = unit[6 * i : 6 * i + 6]
        arm = state.rotation[link] @ body.centre
        _, _, acceleration = tracked(state, rates, link, body.centre)
        moments = state.rotation[link] @ body.moments @ state.rotation[link].T
        spin, change = state.twist[link][3:], rates[link][3:]
        force = body.mass * (acceleration - described.gravity)
        couple = moments @ change + cross(spin, moments @ spin)
        total += force @ (virtual[:3] + cross(virtual[3:], arm)) + couple @ virtual[3:]
    return total
