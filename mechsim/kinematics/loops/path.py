"""Paths of a mechanism's assembly along its driver motion: positions, rates and accelerations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver
from mechsim.kinematics.loops.kinematics import Coordinates, axial, matrix_product, twists, velocity_products
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.kinematics.vector_method.vectors import array_cross as cross
from mechsim.mechanism.limits import require_travel
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.mechanism.motion import LinkMotion, join, select_instants
from mechsim.numerics.arrays import EPS, Array
from mechsim.numerics.continuation import ContinuationPath
from mechsim.numerics.loop_solver import Linearised
from mechsim.numerics.newton import NewtonSettings, newton, square_solution


class LoopPath(ContinuationPath[TreeLoops, Coordinates]):
    """A path of one mechanism or of several designs, traced by the loop equations."""

    def require_travel(self, start: float, target: float) -> None:
        """Reject a path that is too long for one motion."""
        names = self.words
        who = f"{self.name}: {names.mover}"
        require_travel(who, names.position(start), names.position(target), abs(target - start))

    def remaining_text(self, current: float, target: float) -> str:
        """Return the remaining distance of prescribed points or links to their target; empty for joints."""
        mechanism = self.loops.tree.mechanism
        before, after = (self.prescribed(np.array([s]))[:, 0] for s in (current, target))
        poses = [joint.b.link.startswith(VIRTUAL_PREFIX) for joint in mechanism.driven_joints]
        slides = [mechanism.unit(name) == "m" for name in mechanism.drivers]
        change = [
            abs(b - a)
            for a, b, pose, slide in zip(before, after, poses, slides, strict=False)
            if pose and slide
        ]
        return f"; the target is {np.linalg.norm(change):.3g} m beyond" if change else ""


# number of poses solved together: their arrays fit in the cache of a core; and memory of their Jacobians
CHUNK = 1024
CHUNK_BYTES = 4e7
# Newton's method from an interpolated pose: a longer displacement could lead to another assembly
FINAL = NewtonSettings(max_iterations=4, tolerance=4.0 * EPS, max_displacement=1e-3)
# deviation of drivers from their path, in [rad] or characteristic lengths, above which they are moved there
# in steps; the largest step; and Newton's method after a step
MAX_DEVIATION, MAX_DRIVER_STEP = 1e-9, 0.02
DRIVER_STEP = NewtonSettings(max_iterations=4, max_displacement=10.0 * MAX_DRIVER_STEP)
# conditioning below which rates have no valid digit: errors are rounding over conditioning, in rates once
# more
SINGULAR = float(np.sqrt(np.finfo(np.float64).eps))


@dataclass(frozen=True, slots=True)
class LoopMotion:
    """Solved poses of a mechanism and their rates at n instants.

    Attributes:
        values: coordinates of the tree in [m] and [rad], (n, count); unused for spherical joints.
        rates: rates of the coordinates, (n, count).
        second: their second derivatives, (n, count).
        position: position of the links' origins, (n, links, 3) in [m].
        rotation: rotation of the links, (n, links, 3, 3).
        velocity: velocity of the origins, then angular velocity, (n, links, 6).
        acceleration: acceleration of the origins, then angular acceleration, (n, links, 6).
        conditioning: distance of each pose from a singular one, (n,): the smallest singular value of the loop
            Jacobian with the drivers fixed, in characteristic lengths.
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
    """Instants on a path, with the motion of the prescribed coordinates.

    Attributes:
        parameter: path parameter, (n,).
        speed: its rate, (n,) per second.
        acceleration: its second derivative, (n,).
        value: prescribed coordinates, (driven, n) in [m] or [rad].
        rate: their rates per second, (driven, n).
        second: their second derivatives, (driven, n).
    """

    parameter: Array
    speed: Array
    acceleration: Array
    value: Array
    rate: Array
    second: Array

    def select(self, index: NDArray[np.intp]) -> "Instants":
        """Return the instants at some indices."""
        return Instants(*(getattr(self, field.name)[..., index] for field in fields(self)))


def loop_motion(path: LoopPath, instants: Instants) -> LoopMotion:
    """Return the motion at instants along a path.

    Raises:
        AssemblyError: at the parameter beyond which the loops cannot close in this assembly mode, or where a
            singular pose is so near that the rates have no valid digit.
    """
    chunks = [(chunk.index, with_rates(path, chunk)) for chunk in closed_chunks(path, instants)]
    for index, motion in chunks:
        parameter = instants.parameter[index]
        singular = (motion.conditioning < SINGULAR) & ~path.near_change_point(parameter)
        if singular.any():
            raise _too_singular(path, float(parameter[np.argmax(singular)]))
    return merged(chunks)


@dataclass(frozen=True, slots=True)
class ClosedChunk:
    """Some instants of a motion, solved together.

    Attributes:
        solver: their solver.
        index: their indices among all instants, (k,).
        instants: the instants; of d designs each repeated d times.
        q: coordinates of the tree.
        linearised: the linearised loops at `q`.
    """

    solver: TreeSolver
    index: NDArray[np.intp]
    instants: Instants
    q: Coordinates
    linearised: Linearised


def closed_chunks(path: LoopPath, instants: Instants) -> Iterator[ClosedChunk]:
    """Yield the instants in chunks, each solved to rounding.

    Raises:
        AssemblyError: at the parameter beyond which the loops cannot close in this assembly mode.
    """
    most = CHUNK_BYTES / (8 * path.first.numbers + 1)
    per_chunk, driven = max(1, int(min(CHUNK, most)) // path.count), list(path.loops.driven)
    for solver, index, rows in path.chunks(instants.parameter):
        for i in range(0, len(index), per_chunk):
            indices, states = index[i : i + per_chunk], rows[i : i + per_chunk]
            q = path.unflat(states, instants.parameter[indices])
            # polynomials without a short pulse of a motion law have other drivers than the prescribed
            q.values[driven] = states.reshape(len(q), -1)[:, driven].T * path.loops.units[driven, None]
            chunk = instants.select(np.repeat(indices, path.count))
            yield ClosedChunk(solver, indices, chunk, *_closed(path, solver, chunk, q))


def merged(chunks: Sequence[tuple[NDArray[np.intp], LoopMotion]]) -> LoopMotion:
    """Return chunks of a motion merged by their indices."""
    order = np.argsort(np.concatenate([index for index, _ in chunks]))
    return select_instants(join([motion for _, motion in chunks]), order)


def _closed(
    path: LoopPath, solver: TreeSolver, instants: Instants, q: Coordinates
) -> tuple[Coordinates, Linearised]:
    """Return poses closed from those of the polynomials, and the linearised loops."""
    driven = list(path.loops.driven)
    start = q.values[driven]
    offset = instants.value - start
    distance = float(np.abs(offset / path.loops.units[driven, None]).max(initial=0.0))
    if distance > MAX_DEVIATION:
        sign = np.sign(solver.linearise(q).signed_distance)
        steps = int(np.ceil(distance / MAX_DRIVER_STEP))
        for k in range(1, steps + 1):
            q.values[driven] = start + offset * (k / steps)
            q, linearised = _newton(path, solver, instants.parameter, q, DRIVER_STEP)
            crossed = np.sign(linearised.signed_distance) != sign
            if crossed.any():
                raise _too_singular(path, float(instants.parameter[np.argmax(crossed)]))
    q.values[driven] = instants.value
    return _newton(path, solver, instants.parameter, q, FINAL)


def _newton(
    path: LoopPath, solver: TreeSolver, s: Array, q: Coordinates, settings: NewtonSettings
) -> tuple[Coordinates, Linearised]:
    """Return configurations corrected from nearby ones, and the linearised loops."""
    singular = path.near_change_point(s)

    def solve(matrix: Array, right: Array) -> Array:
        return square_solution(regularised(matrix, singular), np.where(singular[:, None], 0.0, right))

    result = newton(solver, q, settings, solve if singular.any() else None)
    if np.isinf(result.displacement).any():
        raise _too_singular(path, float(s[np.argmax(result.displacement)]))
    return result.q, result.linearised


def _too_singular(path: LoopPath, s: float) -> AssemblyError:
    return AssemblyError(
        f"{path.loops.tree.mechanism.name}: the pose at {path.words.instant(s)} is too near a singular one "
        "to be distinguished from another assembly; keep away from it"
    )


def regularised(matrix: Array, singular: NDArray[np.bool_]) -> Array:
    """Return matrices that are regular also where the loops are singular."""
    return np.where(singular[:, None, None], np.eye(matrix.shape[1]), matrix) if singular.any() else matrix


def with_rates(path: LoopPath | None, chunk: ClosedChunk, *, conditioned: bool = True) -> LoopMotion:
    """Return positions, rates and accelerations of solved instants; conditioning is 1 unless `conditioned`.

    With a path of None the loops are regular everywhere.
    """
    solver, q, linearised, instants = chunk.solver, chunk.q, chunk.linearised, chunk.instants
    loops = solver.loops.at_instants(len(q))
    singular = (
        np.zeros(len(q), dtype=np.bool_) if path is None else path.near_change_point(instants.parameter)
    )
    tree, units, driven = loops.tree, loops.units[:, None], list(loops.driven)
    polynomial = (
        None
        if path is None or not singular.any()
        else rates_of_polynomial(path, tree, instants.parameter[singular])
    )

    def solved(prescribed: Array, bias: Array) -> Array:
        """Return the derivatives of the coordinates of an order, in their units."""
        step = np.zeros((tree.count, len(q)), q.values.dtype)
        step[driven] = prescribed / units[driven]
        rhs = np.zeros_like(linearised.rhs)
        rhs[:, : len(solver.rows)] = (linearised.times(step) + bias)[solver.rows].T
        if singular.any():
            return step + solver.step(regularised(linearised.matrix, singular), rhs)
        return step + solver.whole_step(-linearised.solution(rhs))

    rates = solved(instants.rate, np.zeros(1))
    if polynomial is not None:
        rates[:, singular] = polynomial[0] * instants.speed[singular]
    twist = twists(tree, linearised.poses, rates * units)
    velocity_product = velocity_products(tree, linearised.poses, twist, rates * units)
    second = solved(
        instants.second, loops.velocity_products(q, linearised.poses, rates * units, twist, velocity_product)
    )
    if polynomial is not None:
        speed, acceleration = instants.speed[singular], instants.acceleration[singular]
        second[:, singular] = polynomial[0] * acceleration + polynomial[1] * speed**2
    spatial = velocity_product + twists(tree, linearised.poses, second * units)
    # velocities and accelerations of the links' origins from twists and spatial accelerations
    twist, spatial = twist.swapaxes(0, 1), spatial.swapaxes(0, 1)
    velocity, acceleration = twist.copy(), spatial.copy()
    origin = linearised.poses.position.swapaxes(0, 1)
    velocity[:3] += cross(twist[3:], origin)
    acceleration[:3] += cross(spatial[3:], origin)
    acceleration[:3] += cross(twist[3:], velocity[:3])
    return LoopMotion(
        q.values.T,
        (rates * units).T,
        (second * units).T,
        linearised.poses.position.transpose(2, 0, 1),
        linearised.poses.rotation.transpose(3, 0, 1, 2),
        velocity.transpose(2, 1, 0),
        acceleration.transpose(2, 1, 0),
        linearised.smallest_of_all(len(solver.rows)) if conditioned else np.ones(len(q)),
    )


def rates_of_polynomial(path: LoopPath, tree: SpanningTree, angle: Array) -> tuple[Array, Array]:
    """Return first and second derivatives of the coordinates by the parameter, of the polynomials."""
    first, second = path.derivatives(angle)
    first_rates, second_rates = first[:, : tree.count].T.copy(), second[:, : tree.count].T.copy()
    coordinates = path.interpolated(angle)
    for i, ball in enumerate(tree.balls):
        columns = slice(tree.count + 9 * i, tree.count + 9 * (i + 1))
        rotation = coordinates.turns[i]
        rotation_rate, rotation_second = (
            np.ascontiguousarray(rows[:, columns].T).reshape(3, 3, -1) for rows in (first, second)
        )
        columns = slice(ball.first_angle, ball.first_angle + 3)
        first_rates[columns] = axial(matrix_product(rotation_rate, rotation.transpose(1, 0, 2)))
        second_rates[columns] = axial(matrix_product(rotation_second, rotation.transpose(1, 0, 2)))
    return first_rates, second_rates
