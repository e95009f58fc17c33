"""States of a mechanism: initial ones from values of joint coordinates, and their packing into vectors."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim.errors import AssemblyError, InputError, first_names
from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.mobility import independent_coordinates
from mechsim.kinematics.loops.start import ASSEMBLY, CLOSED, close_nearest
from mechsim.kinematics.vector_method.rotations import from_quaternion, turned_by
from mechsim.kinetics.contacts import CLOSED_GAP
from mechsim.kinetics.equations_of_motion import (
    Dynamics,
    EquationsOfMotion,
    Kinematics,
    constraint_jacobians,
    with_locked_rows,
)
from mechsim.kinetics.gaps import gap_limits
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import EPS, Array, cross
from mechsim.numerics.rank import RANK_TOLERANCE, null_space, significant

# usual shortest step of a coordinate towards its initial value, in [rad] or characteristic lengths: the
# linear model of the loops is valid for several times that; and fraction of it that steps next to another
# assembly mode may have
STEP, SHORTEST = 0.05, 1e-6
# residual of closed loops between such steps
BETWEEN = 1e-6
# largest ratio of steps to it; longer ones are predicted by polynomials through so many points before, and
# miss at most this fraction of the motion: another assembly mode is farther away
MAX_RATIO, POINTS, PREDICTED = 4.0, 4, 0.1
# relative error of rates above which their requested values contradict the loops
CONSISTENT = 1e-9


@dataclass(frozen=True, slots=True)
class InitialValues:
    """Requested coordinates in [m] or [rad], and rates per second, by coordinate name.

    Attributes:
        coordinates: coordinate -> value in [m] or [rad]; (n,) for n runs.
        rates: coordinate -> rate per second; (n,) for n runs.
        rotations: spherical or floating joint -> rotation of side b's frame in side a's, (3, 3).
        spins: the same -> angular velocity of side b relative to side a, in side a's frame, (3,) in [rad/s].
    """

    coordinates: Mapping[str, float | Array]
    rates: Mapping[str, float | Array]
    rotations: Mapping[str, Array] = field(default_factory=dict[str, Array])
    spins: Mapping[str, Array] = field(default_factory=dict[str, Array])


def initial_state(equations: EquationsOfMotion, values: InitialValues) -> tuple[Coordinates, Array]:
    """Return coordinates and rates in units, (count, n), that satisfy the loops and the requested values.

    The coordinates move to their values in short steps from the assembled configuration, within its assembly
    mode. Independent coordinates without a value keep theirs; those without a rate are at rest.

    Raises:
        AssemblyError: where the loops do not close at the values.
        InputError: for values that contradict one another or the loops.
    """
    for name in equations.prescribed:
        if name in values.coordinates or name in values.rates:
            raise InputError(
                f"{equations.model.mechanism.name}: {name!r} follows its motion law; "
                "leave its initial value out"
            )
    value, rate, _ = equations.prescribed_motion(np.zeros(1))
    units = equations.loops.units[equations.prescribed_indices]
    first, first_rates = (
        dict(zip(equations.prescribed, (column[:, 0] * units).tolist(), strict=True))
        for column in (value, rate)
    )
    q = _moved(equations, {**values.coordinates, **first}, values.rotations)
    return q, _rates(equations, q, replace(values, rates={**values.rates, **first_rates}))


def projected(
    equations: EquationsOfMotion, q: Coordinates, rates: Array, times: Array, resting: Sequence[int] = ()
) -> tuple[Coordinates, Array]:
    """Return the n closed configurations and consistent rates nearest to given ones, at times (n,) in [s].

    `resting` are indices of coordinates with rate zero.

    Raises:
        AssemblyError: if Newton's method does not close the loops.
    """
    value, rate, _ = equations.prescribed_motion(times)
    loops, indices = equations.loops, equations.prescribed_indices
    if len(indices):
        q = Coordinates(q.values.copy(), q.turns)
        q.values[indices] = value * loops.units[indices][:, None]
        loops = replace(loops, driven=(*loops.driven, *indices))
    q, gap = close_nearest(loops, q)
    _require_closed(equations, gap)
    jacobian, rates = constraint_jacobians(equations, q, resting), rates.copy()
    violation = jacobian @ rates[equations.free].T[..., None]
    violation[:, equations.loops.rows : equations.loops.rows + len(rate), 0] -= rate.T
    if violation.any():
        rates[equations.free] -= (np.linalg.pinv(jacobian, rcond=RANK_TOLERANCE) @ violation)[..., 0].T
    return q, rates


def _moved(
    equations: EquationsOfMotion, coordinates: Mapping[str, float | Array], rotations: Mapping[str, Array]
) -> Coordinates:
    """Return configurations with requested values, reached from the start within its assembly mode.

    All values change in proportion to a parameter from 0 to 1. A short step starts from the configuration
    before, which the linear model of the loops permits; a longer one must arrive where the polynomial through
    those before predicts.
    """
    requested, loops = _columns(coordinates.values()), equations.loops
    named, q = [_index(equations, name) for name in coordinates], equations.start.repeated(requested.shape[1])
    begin, units = q.values[named], loops.units[named][:, None]
    change = requested - begin
    balls = [_ball_index(equations, name) for name in rotations]
    turning = [index for first, _ in balls for index in range(first, first + 3)]
    first_rotations = [q.turns[number, ..., 0] for _, number in balls]
    vectors = _rotation_vectors(first_rotations, [*rotations.values()])
    widest = np.abs(np.append(change / units, vectors)).max(initial=0.0)
    if not widest:
        return q
    kept = _independent(equations, q, [*named, *turning])
    fixed = [*kept.values()]
    loops = replace(loops, driven=(*loops.driven, *named, *fixed, *turning))
    least = min(1.0, STEP / widest)
    reached, step, path = 0.0, least, [(0.0, q)]
    matrix, values = _jacobian_and_values(loops, q)
    while reached < 1.0:
        goal = min(1.0, reached + step)
        short, last = goal - reached <= 1.01 * least, goal == 1.0
        before = path[-1:] if short else path[-POINTS:]
        guess = _extrapolated(before, goal)
        guess.values[named], guess.values[fixed] = begin + change * goal, q.values[fixed]
        for (_, number), start, vector in zip(balls, first_rotations, vectors, strict=True):
            guess.turns[number] = turned_by(start[None], vector[None] * goal)[0][..., None]
        new, gap = close_nearest(loops, guess, ASSEMBLY if last else replace(ASSEMBLY, tolerance=BETWEEN))
        residual = CLOSED if last else BETWEEN
        moved, deviation = (_distances(loops.units, new, other) for other in (path[-1][1], guess))
        predicted = (gap <= residual) & (deviation <= PREDICTED * moved + 10.0 * BETWEEN)
        after, smallest = _jacobian_and_values(loops, new)
        # the determinant changes its sign between two assembly modes that meet
        same = bool((np.linalg.slogdet(matrix.transpose(0, 2, 1) @ after)[0] >= 0.0).all())
        shortest = short and goal - reached < SHORTEST * least
        if not (shortest or (same and (short or predicted.all()))):
            step = max(0.5 * (goal - reached), 0.0 if short else least)
            continue
        _require_closed(equations, gap, residual, kept)
        # modes meet where a singular value is zero: halfway there at most
        ahead = 0.5 * (smallest / np.maximum(values - smallest, EPS)).min()
        step = min(max(least, min(2.0, ahead) * (goal - reached)), MAX_RATIO * least)
        # a curve may bend within a short step
        reached, path = goal, [*(path[-1:] if short else path), (goal, new)]
        matrix, values = after, smallest
    return path[-1][1]


def _jacobian_and_values(loops: TreeLoops, q: Coordinates) -> tuple[Array, Array]:
    """Return the loops' Jacobian by unknown coordinates, (n, rows, u), and its least nonzero values, (n,).

    The Jacobian of an undetermined motion is left out as zeros.
    """
    matrix = loops.linearise(q)[1][:, loops.unknown].transpose(2, 0, 1)
    values: Array = np.linalg.svd(matrix, compute_uv=False).astype(np.float64)
    nonzero = significant(values)
    matrix = np.where(np.all(nonzero, 1)[:, None, None], matrix, 0.0)
    return matrix, np.where(nonzero, values, 10.0).min(1, initial=10.0)


def _rotation_vectors(starts: Sequence[Array], ends: Sequence[Array]) -> list[Array]:
    """Return the rotation vectors from matrices (3, 3) to others, (3,) each."""
    if not ends:
        return []
    from scipy.spatial.transform import Rotation

    return [Rotation.from_matrix(end @ start.T).as_rotvec() for start, end in zip(starts, ends, strict=True)]


def _extrapolated(path: Sequence[tuple[float, Coordinates]], parameter: float) -> Coordinates:
    """Return coordinates at a parameter by the polynomial through those at others."""
    weights = np.array(
        [np.prod([(parameter - b) / (a - b) for b, _ in path if b != a]) for a, _ in path], dtype=np.float64
    )
    values = np.tensordot(weights, np.array([q.values for _, q in path]), 1)
    turns = np.tensordot(weights, np.array([q.turns for _, q in path]), 1)
    for i in range(len(turns) if len(path) > 1 else 0):
        turns[i] = rotation_matrices(rotation_quaternions(turns[i]))
    return Coordinates(values, turns)


def _distances(units: Array, q: Coordinates, other: Coordinates) -> Array:
    """Return the largest difference of coordinates in units, and of entries of rotations, (n,)."""
    values = np.abs((q.values - other.values) / units[:, None]).max(0, initial=0.0)
    return np.maximum(values, np.abs(q.turns - other.turns).max((0, 1, 2), initial=0.0))


def _columns(values: Collection[float | Array]) -> Array:
    """Return values as rows of equal length, (values, n)."""
    rows = [np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in values]
    return np.stack(np.broadcast_arrays(*rows)) if rows else np.empty((0, 1))


def _independent(equations: EquationsOfMotion, q: Coordinates, named: Sequence[int]) -> dict[str, int]:
    """Return independent coordinates besides named ones, with their indices: drivers first, then near ground.

    The gap of a slack rope or an open contact comes last: it follows from the motion of its links. Rows of
    the null space of [G; E] move only these, with G = dPhi/dq of the loops and E the unit rows of named and
    locked coordinates (Nikravesh, ch. 3).
    """
    loops, mechanism = equations.loops, equations.model.mechanism
    index_of = loops.tree.index_of
    ordered = sorted(mechanism.joints, key=lambda joint: GROUND not in (joint.a.link, joint.b.link))
    names = dict.fromkeys([*mechanism.drivers, *(name for joint in ordered for name in joint.coordinates)])
    one_sided = [name for name, (_, high) in gap_limits(mechanism).items() if high == np.inf]
    names |= {
        name: names.pop(name)
        for name in one_sided
        if q.values[index_of[name], 0] > CLOSED_GAP * loops.tree.length
    }
    fixed = np.eye(loops.tree.count)[[*loops.driven, *named]]
    motions = null_space(np.concatenate([loops.linearise(q)[1][:, :, 0], fixed]))
    independent, _ = independent_coordinates(loops, [name for name in names if name in index_of], motions)
    return {name: index_of[name] for name in independent}


def _require_closed(
    equations: EquationsOfMotion, gap: Array, residual: float = CLOSED, kept: Iterable[str] = ()
) -> None:
    """Raise AssemblyError if a gap exceeds a residual; `kept` names coordinates that keep their start."""
    if not (gap <= residual).all():
        start = ", ".join(kept)
        condition, remedy = (f" with {start} at the start", f", or one of {start} too") if start else ("", "")
        raise AssemblyError(
            f"{equations.model.mechanism.name}: the loops do not close at the initial values{condition} (a "
            f"gap of {gap.max():.3g} of the longest link is left); give values within the range of motion, "
            f"of independent coordinates only{remedy}"
        )


def _rates(equations: EquationsOfMotion, q: Coordinates, values: InitialValues) -> Array:
    """Return rates in units, (count, n), with requested ones; independent coordinates without one rest."""
    loops, free, rates, spins = equations.loops, equations.free, values.rates, values.spins
    indices = [_index(equations, name) for name in rates]
    balls = [_ball_index(equations, name)[0] for name in spins]
    indices += [index for first in balls for index in range(first, first + 3)]
    requested = _columns([*rates.values(), *(rate for spin in spins.values() for rate in spin)])
    count = max(requested.shape[1], len(q))
    result = np.zeros((loops.tree.count, count))
    if not requested.any():
        return result
    requested = np.broadcast_to(requested, (len(indices), count)) / loops.units[indices][:, None]
    kept = [*_independent(equations, q, indices).values()]
    if len(q) < count:
        q = q.repeated(count)
    jacobian = loops.linearise(q)[1][:, free].transpose(2, 0, 1)
    rows = with_locked_rows(equations, jacobian, [*indices, *kept])
    closed, still = np.zeros((loops.rows, count)), np.zeros((len(kept), count))
    right = np.concatenate([closed, requested, still]).T[..., None]
    solution = np.linalg.pinv(rows, rcond=RANK_TOLERANCE) @ right
    result[free] = solution[..., 0].T
    violation = np.abs(rows @ solution - right).max(initial=0.0)
    if violation > CONSISTENT * max(np.abs(requested).max(initial=0.0), np.finfo(float).tiny):
        raise InputError(
            f"{equations.model.mechanism.name}: initial rates of {', '.join([*rates, *spins])} contradict "
            "the loops; give those of independent coordinates only"
        )
    return result


def _index(equations: EquationsOfMotion, name: str) -> int:
    index_of = equations.loops.tree.index_of
    mechanism = equations.model.mechanism
    if name in mechanism.locked:
        raise InputError(f"{mechanism.name}: joint {name!r} is locked; leave its initial value out")
    if name in index_of:
        return index_of[name]
    names = [coordinate for joint in mechanism.joints for coordinate in joint.coordinates]
    if name in names:
        raise InputError(
            f"{mechanism.name}: {name!r} and the other coordinates with initial values close a loop among "
            "themselves; leave one of them out"
        )
    raise InputError(f"{mechanism.name} has no joint coordinate {name!r}; it has {first_names(names)}")


def _ball_index(equations: EquationsOfMotion, name: str) -> tuple[int, int]:
    """Return the index of a spherical joint's first rotation, and the number of the joint in the tree."""
    for number, ball in enumerate(equations.loops.tree.balls):
        if ball.joint.name == name:
            return ball.first_angle, number
    others = ", ".join(ball.joint.name for ball in equations.loops.tree.balls)
    raise InputError(
        f"{equations.model.mechanism.name}: a loop is cut at spherical joint {name!r}, so that it has no "
        f"initial rotation of its own; give those of other joints{f', such as {others}' if others else ''}"
    )


class StateLayout:
    """Packing of coordinates, quaternions, rates, actuators' states, work and loss into one vector.

    Args:
        equations: equations of motion.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.tree = equations.loops.tree
        self.units = equations.loops.units
        self.count, self.balls = self.tree.count, len(self.tree.balls)
        self.positions = self.count + 4 * self.balls
        self.start = np.array([a.start for a in equations.model.forces.actuators if a.inflow is not None])

    def pack(self, q: Coordinates, rates: Array, work: float, lost: float) -> Array:
        """Return the vector of one state, with actuators in their initial states."""
        turns = [rotation_quaternions(rotation)[0] for rotation in q.turns]
        return np.concatenate([q.values[:, 0] / self.units, *turns, rates[:, 0], self.start, [work, lost]])

    def activation(self, states: Array) -> Array:
        """Return the states of actuators, (states, n), of n vectors."""
        first = self.positions + self.count
        return states[:, first : first + len(self.start)].T

    def unpack(self, state: Array) -> tuple[Coordinates, Array, float, float]:
        """Return coordinates, rates (count, 1), work done and energy lost of a vector."""
        q, rates = self.unpack_states(state[None])
        return q, rates, float(state[-2]), float(state[-1])

    def unpack_states(self, states: Array) -> tuple[Coordinates, Array]:
        """Return coordinates and rates (count, n) of n vectors."""
        n, positions = self.count, self.positions
        rotations = np.zeros((self.balls, 3, 3, len(states)))
        for i, rotation in enumerate(rotations):
            rotation[:] = rotation_matrices(states[:, n + 4 * i : n + 4 * i + 4])
        q = Coordinates(states[:, :n].T * self.units[:, None], rotations)
        return q, states[:, positions : positions + n].T.copy()

    def replaced(self, states: Array, q: Coordinates, rates: Array) -> Array:
        """Return n vectors with other coordinates and rates (count, n), and unchanged work and loss."""
        n, positions, result = self.count, self.positions, states.copy()
        result[:, :n] = (q.values / self.units[:, None]).T
        result[:, positions : positions + n] = rates.T
        for i, rotation in enumerate(q.turns):
            columns = slice(n + 4 * i, n + 4 * i + 4)
            new = rotation_quaternions(rotation)
            # a quaternion and its negative are the same rotation
            result[:, columns] = np.where((new * states[:, columns]).sum(1)[:, None] < 0.0, -new, new)
        return result

    def derivatives(self, states: Array, kinematics: Kinematics, dynamics: Dynamics) -> Array:
        """Return the derivatives of n vectors by time, (n, size)."""
        values = kinematics.rates.copy()
        values[self.tree.ball_indices] = 0.0
        turning: list[Array] = []
        for first, ball in zip(range(self.count, self.positions, 4), self.tree.balls, strict=True):
            rate = kinematics.rates[ball.first_angle : ball.first_angle + 3]
            turning.append(quaternion_rates(states[:, first : first + 4], rate.T).T)
        powers = dynamics.power_in[None], dynamics.power_lost[None]
        return np.concatenate([values, *turning, dynamics.acceleration, dynamics.activation, *powers]).T

    def accelerations(self, derivatives: Array) -> Array:
        """Return the accelerations in the derivatives of n vectors, (n, count) in units."""
        return derivatives[:, self.positions : self.positions + self.count]

    def origin(self, state: Array) -> Array:
        """Return the vector from which displacements count: the coordinates of a start, and zeros."""
        return np.where(np.arange(len(state)) < self.positions, state, 0.0)

    def fastest(self, rate: float, acceleration: float, duration: float, displacement: float) -> float:
        """Return the largest rate, so far or by the acceleration or duration of a displacement."""
        return max(rate, float(np.sqrt(acceleration * displacement)), displacement / duration)

    def scale(self, rate: float, displacement: float = 1.0) -> Array:
        """Return characteristic magnitudes of the vector at a rate, of displacements from its origin."""
        lengths = self.positions, self.count, len(self.start), 2
        return np.repeat([displacement, rate, 1.0, 1e300], lengths)


def rotation_quaternions(rotations: Array) -> Array:
    """Return the unit quaternions (w, x, y, z), (n, 4), of rotation matrices (3, 3, n)."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotations.transpose(2, 0, 1)).as_quat(), 1, axis=1)


def rotation_matrices(quaternions: Array) -> Array:
    """Return the rotation matrices (3, 3, n) of quaternions (w, x, y, z), (n, 4), of any length."""
    w, x, y, z = (quaternions / np.sqrt((quaternions**2).sum(1))[:, None]).T
    return from_quaternion(w, x, y, z)


def quaternion_rates(quaternions: Array, angular_velocities: Array) -> Array:
    """Return the rates of quaternions (n, 4) at angular velocities (n, 3) in the fixed frame, (n, 4)."""
    w, vector = quaternions[:, :1], quaternions[:, 1:]
    scalar = -(angular_velocities * vector).sum(1)[:, None]
    return 0.5 * np.concatenate([scalar, w * angular_velocities + cross(angular_velocities, vector)], 1)
