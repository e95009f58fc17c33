"""Motion of a mechanism under its forces, by Taylor series in as many digits as are asked for.

Every link has the twist (velocity of its origin, angular velocity). Its rate and the joint forces solve
one linear system, M a + G' l = f and G a = -c: mass times acceleration with the rows of the joints, and
these rows differentiated twice. A stop gives an impulse that reverses the rate of its joint.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import getcontext
from typing import Any

import numpy as np
from mpmath import mp, mpf

from exact.description import GROUND, Description, Reader, cross, rotation, unit
from exact.loops import Row, State, coordinate, gap_row, rows, side_state
from exact.series import GUARD, Series, integral, solution, values
from exact.solving import exactly, in_doubles, inverse, matrix, solved, start_state, to_digits, tracked

SAMPLES = 64  # of a step, among which a stop is looked for


@dataclass(frozen=True)
class Spring:
    """A spring between two points, each a link and a index in its frame; N/m and m."""

    ends: tuple[tuple[str, Any], ...]
    stiffness: Any
    rest: Any


@dataclass(frozen=True)
class Release:
    """What moves a mechanism from a start: springs, a torque on its driver, initial rates, and a stop.

    Attributes:
        springs: between points.
        torque: on the driver, in [N m].
        rates: driver -> initial rate.
        balls: spherical joint -> initial axis and angle, and angular velocity in the frame of side a.
        stops: slide -> its least value in [m].
        restitution: rate after an impact at a stop over the rate before.
    """

    springs: tuple[Spring, ...]
    torque: Any
    rates: Mapping[str, Any]
    balls: Mapping[str, tuple[Any, Any]]
    stops: Mapping[str, Any]
    restitution: Any


@dataclass
class Expansion:
    """Series of a motion about an instant: state, rates of the twists, joint coordinates, slides."""

    state: State
    rates: Mapping[str, Any]
    hinges: Mapping[str, tuple[Series, Any]]
    slides: Mapping[str, Any]

    def everything(self) -> list[Series]:
        """Return the series that a step advances."""
        stated = (self.state.position, self.state.rotation, self.state.twist)
        items = [item for group in stated for array in group.values() for item in array.ravel()]
        return [item for item in items if isinstance(item, Series)]


def read_release(reader: Reader, described: Description, restitution: Any) -> Release:
    """Return what a file states about forces and the start."""
    raw, stated = reader.raw, reader.raw.get("initial", {})
    springs = tuple(
        Spring(
            tuple(_end(described, reader, item[side]) for side in "ab"),
            reader.number(item["stiffness"]),
            reader.number(item["rest"]) * reader.length,
        )
        for item in raw["forces"].get("springs", {}).values()
    )
    balls = {
        name: (reader.vector(item["q"]), reader.vector(item["w"]))
        for name, item in stated.items()
        if "w" in item
    }
    limits = {name: item["limits"]["lower"] for name, item in raw["joints"].items() if "limits" in item}
    return Release(
        springs,
        reader.number(raw["forces"].get("crank_torque", 0)),
        {name: reader.number(stated.get(name, {}).get("v", 0)) for name in described.drivers},
        balls,
        {name: reader.number(item) * reader.length for name, item in limits.items()},
        restitution,
    )


def _end(described: Description, reader: Reader, entry: Any) -> tuple[str, Any]:
    """Return the link and the place of a spring's end, which is a point or a table."""
    if isinstance(entry, str):
        return described.points[entry]
    return entry["link"], reader.vector(entry.get("at", [0, 0, 0]), reader.length)


def start(described: Description, release: Release) -> State:
    """Return the state in which a mechanism is released."""
    zero = np.array([mpf(0)] * 6, dtype=object)
    if described.drivers:
        doubles, guess = start_state(in_doubles(described))
        state = exactly(described, to_digits(described, doubles), guess, described.start)
        equations = rows(described, state, guess, described.start)
        jacobian = matrix(described, equations)
        rates = [mpf(0)] * (len(equations) - len(described.drivers))
        rates += [release.rates[name] for name in described.drivers]
        twist = solved(jacobian, np.array(rates, dtype=object), inverse(jacobian))
        state.twist = {link: twist[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
        return state
    state = State({}, {}, dict.fromkeys(described.links, zero))
    for pair in described.pairs:  # each link on a ball joint of its own
        axis_angle, spin = release.balls[pair.name]
        frame = pair.a.frame @ rotation(unit(axis_angle[:3]), axis_angle[3]) @ pair.b.frame.T
        arm, around = frame @ pair.b.point, pair.a.frame @ spin
        state.rotation[pair.b.link] = frame
        state.position[pair.b.link] = pair.a.point - arm
        state.twist[pair.b.link] = np.concatenate([-cross(around, arm), around])
    return state


def is_planar(described: Description) -> bool:
    """Return whether all links move in the plane of x and y."""
    hinges = all(abs(pair.a.frame[2, 2]) == 1 for pair in described.pairs if pair.kind == "revolute")
    slides = all(pair.a.frame[2, 2] == 0 for pair in described.pairs if pair.kind == "prismatic")
    return hinges and slides and {pair.kind for pair in described.pairs} <= {"revolute", "prismatic"}


def expanded(described: Description, release: Release, begin: State, angles: Mapping[str, Any]) -> Expansion:
    """Return the series of the motion from a state."""
    plane = is_planar(described)
    state = State({}, {}, {})
    rates: dict[str, Any] = {}
    for link in described.links:
        _grow(state, rates, link, begin, plane)
    free = replace(described, drivers=())
    equations = [row for row in rows(free, state, {}, {}) if not plane or _in_plane(row)]
    columns = [6 * i + k for i in range(len(described.links)) for k in ((0, 1, 5) if plane else range(6))]
    inertia, force = inertias(described, release, state)
    right = [force[k] for k in columns] + [-row.rest for row in equations]
    jacobian = matrix(described, equations)[:, columns]
    unknown = solution(system(inertia[np.ix_(columns, columns)], jacobian), right)
    for index, column in enumerate(columns):
        rates[described.links[column // 6]][column % 6] = unknown[index]
    sides = {pair.name: (side_state(state, pair.a), side_state(state, pair.b)) for pair in described.pairs}
    hinges, slides = {}, {}
    for pair in described.pairs:
        a, b = sides[pair.name]
        if pair.kind == "revolute":
            speed = a.frame[:, 2] @ (b.twist[3:] - a.twist[3:])
            hinges[pair.name] = integral(angles[pair.name], lambda speed=speed: speed), speed
        elif pair.kind == "prismatic":
            slides[pair.name] = gap_row(pair, a, b, 2).value
    return Expansion(state, rates, hinges, slides)


def _grow(state: State, rates: dict[str, Any], link: str, begin: State, plane: bool) -> None:
    """Add the states of a link: what its rates are is known only when all states are."""
    rates[link] = rate = np.zeros(6, dtype=object)
    moving = (0, 1, 5) if plane else range(6)
    twist = np.zeros(6, dtype=object)
    for k in moving:
        twist[k] = integral(begin.twist[link][k], lambda k=k: rate[k])
    position = np.zeros(3, dtype=object)
    for k in moving:
        if k in range(3):
            position[k] = integral(begin.position[link][k], lambda k=k: twist[k])
    attitude = np.eye(3, dtype=int).astype(object)
    count = 2 if plane else 3
    change = np.zeros((3, 3), dtype=object)
    for i in range(count):
        for j in range(count):
            attitude[i, j] = integral(begin.rotation[link][i, j], lambda i=i, j=j: change[i, j])
    for j in range(count):
        change[:, j] = cross(twist[3:], attitude[:, j])
    state.position[link], state.rotation[link], state.twist[link] = position, attitude, twist


def _in_plane(row: Row) -> bool:
    """Return whether an equation restricts motion in the plane."""
    return any(
        isinstance(derivative[k], Series) or derivative[k] != 0
        for link, derivative in row.derivatives.items()
        if link != GROUND
        for k in (0, 1, 5)
    )


def inertias(described: Description, release: Release, state: State) -> tuple[Any, Any]:
    """Return the matrix of inertia, and forces less the terms of velocity, for all twists."""
    count = 6 * len(described.links)
    inertia, force = np.zeros((count, count), dtype=object), np.zeros(count, dtype=object)
    for i, link in enumerate(described.links):
        body, rotation_ = described.bodies[link], state.rotation[link]
        first = slice(6 * i, 6 * i + 3)
        last = slice(6 * i + 3, 6 * i + 6)
        arm, spin = rotation_ @ body.centre, state.twist[link][3:]
        across = np.array([cross(arm, axis) for axis in np.eye(3, dtype=int)], dtype=object).T
        moments = rotation_ @ body.moments @ rotation_.T
        inertia[first, first] = body.mass * np.eye(3, dtype=int)
        inertia[first, last] = -body.mass * across
        inertia[last, first] = body.mass * across
        inertia[last, last] = moments - body.mass * (across @ across)
        pull = body.mass * (described.gravity - cross(spin, cross(spin, arm)))
        force[first] = force[first] + pull
        force[last] = force[last] + cross(arm, pull) - cross(spin, moments @ spin)
    for spring in release.springs:
        (at_a, arm_a), (at_b, arm_b) = (_stand(state, *end) for end in spring.ends)
        between = at_b - at_a
        length = (between @ between) ** "0.5"
        pull = between * (spring.stiffness * (length - spring.rest) * length**-1)
        for (link, _), arm, sign in zip(spring.ends, (arm_a, arm_b), (1, -1), strict=True):
            if link != GROUND:
                i = 6 * described.links.index(link)
                force[i : i + 3] = force[i : i + 3] + pull * sign
                force[i + 3 : i + 6] = force[i + 3 : i + 6] + cross(arm, pull * sign)
    for pair in described.pairs:  # a driver with a torque turns about z against the ground
        if release.torque != 0 and pair.name == described.drivers[0]:
            force[6 * described.links.index(pair.b.link) + 5] += (
                release.torque
            )  # its axis is z, side a the ground
    return inertia, force


def _stand(state: State, link: str, local: Any) -> tuple[Any, Any]:
    """Return a place of a link in space, and its arm from the link's origin."""
    if link == GROUND:
        return local, 0 * local
    arm = state.rotation[link] @ local
    return state.position[link] + arm, arm


def system(inertia: Any, jacobian: Any) -> Any:
    """Return the matrix of accelerations and joint forces."""
    corner = np.zeros((len(jacobian), len(jacobian)), dtype=object)
    return np.block([[inertia, jacobian.T], [jacobian, corner]])


def step_length(expansion: Expansion, order: int) -> Any:
    """Return a step at which the last term of every series is below all digits of the largest state."""
    small = mpf(10) ** -mp.dps
    sizes = []
    for k in (order - 1, order):
        largest = mpf(str(max(abs(item.coefficient(k)) for item in expansion.everything())))
        sizes.append((small / largest) ** (mpf(1) / k) if largest else mpf(1))
    return min(sizes)


def moved(expansion: Expansion, t: Any, order: int) -> State:
    """Return the state at a time after the start of the series."""
    stated = expansion.state
    groups = (stated.position, stated.rotation, stated.twist)
    return State(*({link: values(item, t, order) for link, item in group.items()} for group in groups))


def struck(described: Description, state: State, release: Release, name: str) -> State:
    """Return a state after an impact: the slide's rate is reversed and scaled, no other joint gives way."""
    free = replace(described, drivers=())
    inertia, _ = inertias(described, release, state)
    joints = matrix(described, rows(free, state, {}, {}))
    pair = next(pair for pair in described.pairs if pair.name == name)
    slide = gap_row(pair, side_state(state, pair.a), side_state(state, pair.b), 2)
    normal = matrix(described, [slide])
    twist = np.concatenate([state.twist[link] for link in described.links])
    right = np.array([mpf(0)] * (len(twist) + len(joints) + 1), dtype=object)
    right[-1] = -(1 + release.restitution) * (normal @ twist)[0]
    both = system(inertia, np.vstack([joints, normal]))
    change = solved(_numbers(both), right, inverse(both))
    after = twist + change[: len(twist)]
    twists = {link: after[6 * i : 6 * i + 6] for i, link in enumerate(described.links)}
    return State(state.position, state.rotation, twists)


def _numbers(array: Any) -> Any:
    return np.array([mpf(item) for item in array.ravel()], dtype=object).reshape(array.shape)


def impact(release: Release, expansion: Expansion, until: Any, order: int) -> tuple[Any, str]:
    """Return the time of the first impact within a step and its joint; the step's end and no name if none."""
    for name, lower in release.stops.items():
        gap = expansion.slides[name]
        terms = [mpf(str(gap.coefficient(k))) - (lower if k == 0 else 0) for k in range(order + 1)]
        if abs(terms[0]) < mpf(10) ** (-mp.dps // 2):  # it stands at the stop: other roots
            terms = terms[1:]
        for i in range(1, SAMPLES + 1):
            t = until * i / SAMPLES
            if mp.polyval(terms[::-1], t) < 0:
                root = t
                for _ in range(12):
                    value, derivative = mp.polyval(terms[::-1], root, derivative=1)
                    root -= value / derivative
                return root, name
    return until, ""


def motion(
    described: Description, release: Release, times: Sequence[Any], order: int, impacts: list[Any]
) -> Iterator[dict[str, Any]]:
    """Yield numbers by column at times, and add the times of impacts to a list."""
    getcontext().prec = mp.dps + GUARD
    state, now, index = start(described, release), mpf(0), 0
    angles = {
        pair.name: coordinate(pair, side_state(state, pair.a), side_state(state, pair.b), 0.0).value
        for pair in described.pairs
        if pair.kind == "revolute"
    }
    while index < len(times):
        expansion = expanded(described, release, state, angles)
        length, name = impact(release, expansion, step_length(expansion, order), order)
        while index < len(times) and times[index] <= now + length:
            yield columns(described, expansion, times[index] - now, order)
            index += 1
        state = moved(expansion, length, order)
        angles = {hinge: angle.value(length, order) for hinge, (angle, _) in expansion.hinges.items()}
        now += length
        if name:
            impacts.append(now)
            state = struck(described, state, release, name)


def columns(described: Description, expansion: Expansion, t: Any, order: int) -> dict[str, Any]:
    """Return the numbers of an instant by column: hinges, then points."""
    state = moved(expansion, t, order)
    rates = {link: values(item, t, order) for link, item in expansion.rates.items()}
    row: dict[str, Any] = {}
    for name, (angle, speed) in expansion.hinges.items():
        row |= {f"{name}.q": angle.value(t, order), f"{name}.v": speed.value(t, order)}
    for name, (link, local) in described.points.items():
        for rate, vector in zip(("", "v", "a"), tracked(state, rates, link, local), strict=True):
            row |= {f"{name}.{rate}{axis}": item for axis, item in zip("xyz", vector, strict=True)}
    return row
