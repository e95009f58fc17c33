"""Places, rates and accelerations of many poses together, along a path that was followed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.followed_path import FollowedPath
from mechsim.analytic.closure.loop_solver import Linearised, LoopSolver
from mechsim.analytic.closure.spanning_tree import SpanningTree
from mechsim.analytic.closure.tree_motion import Coordinates, cross, drifts, product, twists
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.motion import LinkMotion

# poses solved in one go: their arrays stay in a core's own cache
CHUNK = 1024
# Newton steps from a polynomial's pose; the longest that cannot lead into another assembly; and one after
# which rounding is left, which drivers may also be off their path without strides
STEPS, LONG, SHORT = 4, 1e-3, 1e-9
# how far drivers that are not where the path has them go at once, in [rad] or parts of the size
STRIDE = 0.02
# coordinates err by rounding over the conditioning, and rates by that over it once more
SINGULAR = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True, slots=True)
class LoopMotion:
    """Closed poses of a mechanism and their rates at n instants.

    Attributes:
        values: coordinates of the tree in [m] and [rad], (n, count); not read for balls.
        rates: of the coordinates, (n, count).
        second: their second rates, (n, count).
        position: of the links' origins, (n, links, 3) in [m].
        rotation: (n, links, 3, 3).
        velocity: of origins, then angular, (n, links, 6).
        acceleration: likewise.
        conditioning: distance of each pose from a singular one, (n,): the smallest singular value of the
            loop Jacobian, the drivers held, in units of the mechanism's size.
    """

    values: Array
    rates: Array
    second: Array
    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    conditioning: Array

    def link(self, index: int) -> LinkMotion:
        """Return the motion of one link."""
        velocity, acceleration = self.velocity[:, index], self.acceleration[:, index]
        return LinkMotion(
            self.position[:, index],
            self.rotation[:, index],
            velocity[:, :3],
            velocity[:, 3:],
            acceleration[:, :3],
            acceleration[:, 3:],
        )


@dataclass(frozen=True, slots=True)
class Instants:
    """At which parameters of a path, and how what is prescribed moves there.

    Attributes:
        at: parameter of the path, (n,).
        speed: its rate, (n,) per second.
        acceleration: its second rate, (n,).
        value: of the prescribed coordinates, (driven, n) in [m] or [rad].
        rate: per second, (driven, n).
        second: second rates, (driven, n).
    """

    at: Array
    speed: Array
    acceleration: Array
    value: Array
    rate: Array
    second: Array

    def some(self, index: NDArray[np.intp]) -> "Instants":
        """Return some of them."""
        return Instants(*(getattr(self, field.name)[..., index] for field in fields(self)))


class Blind(Protocol):
    """What knows where loops tell nothing, and what its polynomials tell there."""

    def blind(self, s: Array) -> NDArray[np.bool_]:
        """Return which parameters are so, (n,)."""
        ...

    def derivatives(self, s: Array) -> tuple[Array, Array]:
        """Return first and second derivatives of flattened states, (n, w) each."""
        ...

    def rough(self, s: Array) -> Coordinates:
        """Return coordinates at parameters (n,)."""
        ...


def loop_motion(path: FollowedPath, instants: Instants) -> LoopMotion:
    """Return the motion at instants along a path.

    Raises:
        AssemblyError: at the parameter beyond which the loops cannot close in this assembly, or at one so
            near to a singular pose that no digit of the rates is left.
    """
    found = [(part.index, rated(path, part)) for part in closed_parts(path, instants)]
    for index, motion in found:
        at = instants.at[index]
        lost = (motion.conditioning < SINGULAR) & ~path.blind(at)
        if lost.any():
            raise _lost(path, float(at[np.argmax(lost)]))
    return in_order(found)


@dataclass(frozen=True, slots=True)
class ClosedPart:
    """Some instants of a motion, closed together.

    Attributes:
        solver: what closed them.
        index: which instants they are, (k,).
        instants: themselves.
        at: coordinates of the tree there.
        loops: about them.
    """

    solver: LoopSolver
    index: NDArray[np.intp]
    instants: Instants
    at: Coordinates
    loops: Linearised


def closed_parts(path: FollowedPath, instants: Instants) -> Iterator[ClosedPart]:
    """Yield the instants in parts, each closed to rounding.

    Raises:
        AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
    """
    for solver, index, rows in path.parts(instants.at):
        for i in range(0, len(index), CHUNK):
            some = index[i : i + CHUNK]
            here = instants.some(some)
            yield ClosedPart(solver, some, here, *_closed(path, solver, here, rows[i : i + CHUNK]))


def in_order(found: Sequence[tuple[NDArray[np.intp], LoopMotion]]) -> LoopMotion:
    """Return parts of a motion put together by which instants they are."""
    back = np.argsort(np.concatenate([index for index, _ in found]))
    parts = {field.name: [getattr(one, field.name) for _, one in found] for field in fields(LoopMotion)}
    return LoopMotion(**{name: np.concatenate(part)[back] for name, part in parts.items()})


def _closed(
    path: FollowedPath, solver: LoopSolver, instants: Instants, rows: Array
) -> tuple[Coordinates, Linearised]:
    """Return poses closed from those of the polynomials, and the loops there."""
    at = path.unflat(rows, instants.at)
    driven = list(path.loops.driven)
    own = at.values[driven]
    off = instants.value - own
    far = float(np.abs(off / path.loops.units[driven, None]).max(initial=0.0))
    if far > SHORT:
        side = np.sign(solver.linearise(at).side)
        strides = int(np.ceil(far / STRIDE))
        for k in range(1, strides + 1):
            at.values[driven] = own + off * (k / strides)
            at, found = _newton(path, solver, instants.at, at, 10.0 * STRIDE)
            crossed = np.sign(found.side) != side
            if crossed.any():
                raise _lost(path, float(instants.at[np.argmax(crossed)]))
    at.values[driven] = instants.value
    return _newton(path, solver, instants.at, at, LONG)


def _newton(
    path: FollowedPath, solver: LoopSolver, s: Array, at: Coordinates, most: float
) -> tuple[Coordinates, Linearised]:
    """Return poses closed from near ones, by no step that is longer than `most`, and the loops there."""
    found = solver.linearise(at)
    blind = path.blind(s)
    for _ in range(STEPS):
        right = np.where(blind[:, None], 0.0, found.right)
        step = solver.step(regular(found.matrix, blind), right)
        longest = float(np.abs(step).max(initial=0.0))
        if not longest < most:
            raise _lost(path, float(s[np.argmax(np.abs(step).max(0))]))
        at = path.loops.moved(at, step)
        found = solver.linearise(at)
        if longest < SHORT:
            break
    return at, found


def _lost(path: FollowedPath, s: float) -> AssemblyError:
    return AssemblyError(
        f"{path.loops.tree.mechanism.name}: the pose at {path.words.instant(s)} is too near a singular one "
        "to be told from another assembly; keep away from it"
    )


def regular(matrix: Array, blind: NDArray[np.bool_]) -> Array:
    """Return matrices that can be solved also where the loops tell nothing."""
    return np.where(blind[:, None, None], np.eye(matrix.shape[1]), matrix) if blind.any() else matrix


def rated(path: Blind | None, part: ClosedPart, *, conditioned: bool = True) -> LoopMotion:
    """Return places, rates and accelerations of instants that are closed; conditioning 1 unless asked for.

    A path of None is one on which the loops tell everything everywhere.
    """
    solver, at, found, instants = part.solver, part.at, part.loops, part.instants
    loops = solver.loops
    blind = np.zeros(len(at), dtype=np.bool_) if path is None else path.blind(instants.at)
    tree, units, driven = loops.tree, loops.units[:, None], list(loops.driven)
    matrix = regular(found.matrix, blind)
    known = None if path is None or not blind.any() else polynomial_rates(path, tree, instants.at[blind])

    def solved(asked: Array, bias: Array) -> Array:
        """Return the coordinates' rates of one order, in their units."""
        ahead = np.zeros((tree.count, len(at)), at.values.dtype)
        ahead[driven] = asked / units[driven]
        right = np.zeros_like(found.right)
        opened = np.einsum("rkn,kn->rn", found.slope[:, driven], ahead[driven]) + bias
        right[:, : len(solver.rows)] = opened[solver.rows].T
        return ahead + solver.step(matrix, right)

    rates = solved(instants.rate, np.zeros(1))
    if known is not None:
        rates[:, blind] = known[0] * instants.speed[blind]
    twist = twists(tree, found.here, rates * units)
    drift = drifts(tree, found.here, twist, rates * units)
    second = solved(instants.second, loops.bias(at, found.here, rates * units, twist, drift))
    if known is not None:
        speed, acceleration = instants.speed[blind], instants.acceleration[blind]
        second[:, blind] = known[0] * acceleration + known[1] * speed**2
    spatial = drift + twists(tree, found.here, second * units)
    position = found.here.position
    velocity, changed = np.empty_like(twist), np.empty_like(twist)
    for i, place in enumerate(position):
        spin, turning = twist[i, 3:], spatial[i, 3:]
        velocity[i, :3] = twist[i, :3] + cross(spin, place)
        changed[i, :3] = spatial[i, :3] + cross(turning, place) + cross(spin, velocity[i, :3])
        velocity[i, 3:], changed[i, 3:] = spin, turning
    return LoopMotion(
        at.values.T,
        (rates * units).T,
        (second * units).T,
        position.transpose(2, 0, 1),
        found.here.rotation.transpose(3, 0, 1, 2),
        velocity.transpose(2, 0, 1),
        changed.transpose(2, 0, 1),
        _conditioning(found, loops.unknown, len(solver.rows)) if conditioned else np.ones(len(at)),
    )


def _conditioning(found: Linearised, unknown: NDArray[np.intp], rank: int) -> Array:
    """Return the smallest singular value that counts of each pose's loops, (n,); 1 where there are none."""
    if not rank:
        return np.ones(found.slope.shape[2])
    values = np.linalg.svd(found.slope[:, unknown].transpose(2, 0, 1), compute_uv=False)
    return np.asarray(values[:, rank - 1], dtype=np.float64)


def polynomial_rates(path: Blind, tree: SpanningTree, angle: Array) -> tuple[Array, Array]:
    """Return first and second derivatives of the coordinates by the parameter, off the polynomials."""
    first, second = path.derivatives(angle)
    once, twice = first[:, : tree.count].T.copy(), second[:, : tree.count].T.copy()
    here = path.rough(angle)
    for i, ball in enumerate(tree.balls):
        part = slice(tree.count + 9 * i, tree.count + 9 * (i + 1))
        turn = here.turns[i]
        spin, bend = (np.ascontiguousarray(rows[:, part].T).reshape(3, 3, -1) for rows in (first, second))
        turning = product(spin, turn.transpose(1, 0, 2))
        changing = product(bend, turn.transpose(1, 0, 2))
        for rows, matrix in ((once, turning), (twice, changing)):
            rows[ball.turning : ball.turning + 3] = (
                0.5 * (matrix - matrix.transpose(1, 0, 2))[[2, 0, 1], [1, 2, 0]]
            )
    return once, twice
