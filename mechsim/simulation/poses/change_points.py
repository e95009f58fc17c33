"""Change points, at which two assemblies of a model coincide, and the motion through them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import States, Track, evaluate

# half width of the interpolation interval about a change point, in [rad], number of its nodes, and degree of
# the polynomial that is fitted
WINDOW, POINTS, DEGREE = 0.25, 48, 22
# radius of the singular neighbourhood of a change point, in [rad]: the loops hardly constrain the pose there
SINGULAR_RADIUS = 1.5e-2
# singular values below this fraction of the largest belong to unconstrained directions in the neighbourhood
CONSTRAINED_FRACTION = 0.05
# maximum error of the polynomial fit, in [rad] or [m]
MAX_FIT_ERROR = 1e-12
# distances, in [rad], at which the determinant's zero is checked to be simple, in descending order, and
# maximum deviation from a straight line, relative to its derivative
SPREADS, MAX_CURVATURE = (1e-2, 1e-4, 3e-7), 0.2
# multiplicities of a change point: numbers of pairs of assemblies, with a change of sign and without
ODD_MULTIPLICITIES, EVEN_MULTIPLICITIES = (1, 3, 5), (2, 4)
# factor by which the radius of a known path grows where it is too curved to be extrapolated at once
WIDENING_FACTOR = 3.0


@dataclass(frozen=True)
class ChangePoint:
    """A change point and the path through it.

    Attributes:
        angle: of the crank, in [rad].
        nodes: crank angles on both sides, (k,).
        states: closed states at the nodes, (k, nq).
        multiplicity: number of pairs of assemblies that coincide; an odd one changes the determinant's sign.
    """

    angle: float
    nodes: Array
    states: Array
    multiplicity: int = 1

    @property
    def radius(self) -> float:
        """Distance over which the path is known on both sides, in [rad]."""
        return float(np.abs(self.nodes - self.angle).max())

    def contains(self, angles: Array) -> NDArray[np.bool_]:
        """Return which crank angles are in the singular neighbourhood, (n,); poses are interpolated there."""
        return np.abs(angles - self.angle) < SINGULAR_RADIUS

    def states_at(self, angles: Array) -> Array:
        """Return interpolated states at crank angles close to the change point, (n, nq)."""
        return fit_weights(self.nodes, self.angle, angles) @ self.states


def lagrange_weights(nodes: Array, angles: Array) -> Array:
    """Return the Lagrange weights of values at nodes, (k,) or (n, k), for angles in between, (n, k)."""
    weights = np.ones((len(angles), nodes.shape[-1]))
    for k in range(nodes.shape[-1]):
        others = np.delete(nodes, k, axis=-1)
        weights[:, k] = ((angles[:, None] - others) / (nodes[..., [k]] - others)).prod(1)
    return weights


def fit_weights(nodes: Array, about: float, angles: Array) -> Array:
    """Return the weights of values at nodes (k,) in a polynomial fit near a change point, (n, k).

    The nearest nodes count least: rounding errors of rates grow as the inverse cube of the distance.
    """
    reach = float(np.abs(nodes - about).max())
    basis = np.polynomial.chebyshev.chebvander((nodes - about) / reach, DEGREE)
    trust = np.abs((nodes - about) / reach) ** 3
    target_basis = np.polynomial.chebyshev.chebvander((angles - about) / reach, DEGREE)
    return target_basis @ (np.linalg.pinv(trust[:, None] * basis, rcond=1e-12) * trust)


def closed_near(loops: ModelLoops, states: Array) -> Array:
    """Return states close to a change point, closed by Newton steps in the constrained directions."""
    for _ in range(2):
        residual, jacobian = loops.linearise(states)
        step = np.zeros((len(states), loops.model.nv))
        constrained = loop_jacobian.constrained_jacobian(loops, jacobian)
        step[:, loops.free] = -least_norm(constrained, residual, CONSTRAINED_FRACTION, floor=0.0)
        states = loops.displaced(states, step)
    return states


def determinant(loops: ModelLoops, states: Array) -> Array:
    """Return the determinant of the loops with the crank locked, (n,), with a common scale."""
    return loop_jacobian.determinant(loops, loops.linearise(states)[1])


def change_point_between(loops: ModelLoops, before: Array, beyond: Array) -> ChangePoint | None:
    """Return the change point between two closed states (nq,) of a smooth path, possibly a multiple one.

    None where assemblies only come close to each other: the determinant then has a minimum without a zero.
    At a change point of multiplicity m, the m-th root of the determinant passes zero linearly.
    """
    address = loops.crank_address
    low, high = before[address], beyond[address]
    interpolant = _Interpolant(loops, np.stack([before, beyond]))
    states = interpolant.closed(low + (high - low) * np.array([0.0, 0.21, 0.83, 1.0]))
    if states is None:
        return None
    determinants = determinant(loops, states)
    same_sign = bool(determinants[0] * determinants[-1] > 0.0)
    for multiplicity in EVEN_MULTIPLICITIES if same_sign else ODD_MULTIPLICITIES:
        change_point = _change_point(loops, _Interpolant(loops, states), determinants, multiplicity)
        if change_point is not None:
            return change_point
    return None


def _change_point(
    loops: ModelLoops, interpolant: "_Interpolant", determinants: Array, multiplicity: int
) -> ChangePoint | None:
    """Return the change point of a given multiplicity between four closed states, or None."""
    angles = interpolant.states[:, loops.crank_address]
    low, high = angles[[0, -1]]
    ends = np.abs(determinants[[0, -1]]) ** (1.0 / multiplicity)
    zero = (
        float(low + (high - low) * ends[0] / ends.sum()) if multiplicity > 1 else _zero(angles, determinants)
    )
    derivative, wide_interpolant = 0.0, interpolant
    for spread in (*_widening(abs(high - low)), *SPREADS):
        around = zero + spread * np.array([-2.0, -1.0, 1.0, 2.0])
        states = interpolant.closed(around)
        if states is None:
            return None
        roots = _root(determinant(loops, states), multiplicity, around < zero)
        if not (np.sign(roots[[0, 1]]) == -np.sign(roots[[2, 3]])).all():
            return None
        new_derivative = float(roots[3] - roots[0]) / (4.0 * spread)
        if spread == SPREADS[-1]:
            straight = (
                np.abs(roots - derivative * (around - zero)).max() < MAX_CURVATURE * abs(derivative) * spread
            )
            return _path_through(loops, zero, wide_interpolant, multiplicity) if straight else None
        zero, interpolant = _zero(around, roots), _Interpolant(loops, states)
        if spread == SPREADS[0]:
            derivative, wide_interpolant = new_derivative, interpolant
    return None


def _root(determinants: Array, multiplicity: int, before: NDArray[np.bool_]) -> Array:
    """Return the root of the determinant that passes zero linearly for a given multiplicity, (n,)."""
    if multiplicity % 2:
        return np.sign(determinants) * np.abs(determinants) ** (1.0 / multiplicity)
    return np.where(before, 1.0, -1.0) * np.abs(determinants) ** (1.0 / multiplicity)


def _widening(radius: float) -> list[float]:
    """Return successive distances that extend a path known over a short distance to the first of SPREADS."""
    spreads: list[float] = []
    while radius < SPREADS[0]:
        radius *= WIDENING_FACTOR
        spreads.append(radius / 2.0)
    return spreads


@dataclass(frozen=True)
class _Interpolant:
    """Successive closed states between which others are interpolated."""

    loops: ModelLoops
    states: Array

    def closed(self, angles: Array, max_correction: float = 0.2) -> Array | None:
        """Return closed states at crank angles, (n, nq); None where they are not certain."""
        knots = self.states[:, self.loops.crank_address]
        guess = lagrange_weights(knots, angles) @ self.states
        guess[:, self.loops.crank_address] = angles
        states = loop_jacobian.close_if_possible(self.loops, guess)
        if states is None:
            return None
        correction = np.abs(states - guess).max()
        reach = np.abs(self.states - self.states.mean(0)).max()
        return (
            states if correction < max_correction * max(reach, np.abs(angles - knots.mean()).max()) else None
        )


def _zero(angles: Array, determinants: Array) -> float:
    """Return the zero of the polynomial through four determinants that is nearest to the chord's."""
    middle, reach = float(angles.mean()), float(np.ptp(angles))
    line = -determinants[0] * (angles[-1] - angles[0]) / (determinants[-1] - determinants[0]) + angles[0]
    roots = np.polynomial.Polynomial.fit(angles, determinants, 3).roots()
    real = roots[np.abs(roots.imag) < 1e-9 * reach].real
    return float(real[np.argmin(np.abs(real - line))]) if len(real) else middle


def _path_through(
    loops: ModelLoops, angle: float, interpolant: _Interpolant, multiplicity: int, window: float = WINDOW
) -> ChangePoint | None:
    """Return the path through a change point, closed at increasing distances from it.

    The window is halved until a polynomial fits the path.
    """
    offsets_all = np.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS) * window
    half = np.sort(offsets_all[offsets_all > 0.0])
    current = interpolant
    offsets: list[float] = []
    states: list[Array] = []
    for offset in half:
        pair = current.closed(angle + np.array([-offset, offset]))
        if pair is None:
            return None
        offsets += [-offset, offset]
        states += list(pair)
        if offset > 2.5 * SPREADS[0]:
            # the farthest states extrapolate best
            current = _Interpolant(loops, np.concatenate([current.states, pair])[-6:])
    order = np.argsort(offsets)
    ordered = np.stack(states)[order]
    # the loops constrain poses near the change point less: a last step, to rounding
    ordered = loops.displaced(ordered, loop_jacobian.newton_step(loops, *loops.linearise(ordered))[0])
    nodes = angle + np.array(offsets)[order]
    fit_error = np.abs(fit_weights(nodes, angle, nodes) @ ordered - ordered)[
        np.abs(nodes - angle) > 0.3 * window
    ].max()
    if fit_error > MAX_FIT_ERROR and window > 4.0 * SINGULAR_RADIUS:
        return _path_through(loops, angle, interpolant, multiplicity, 0.5 * window)
    return ChangePoint(angle, nodes, ordered, multiplicity)


Rows = NDArray[np.intp]
# change points, the rows close to each, and their crank angles reduced to its range, (k,) in [rad]
NearRows = Sequence[tuple[ChangePoint, Rows, Array]]


def moved_away(states: Array, near_rows: NearRows) -> Array:
    """Return states of which those close to change points are moved away, so that they have rates."""
    away = states.copy()
    for change_point, rows, _ in near_rows:
        away[rows] = change_point.states[-1]
    return away


def interpolated(
    motion: Motion,
    loops: ModelLoops,
    track: Track,
    qpos: Array,
    near_rows: NearRows,
    rates: tuple[Array, Array],
) -> Motion:
    """Return a motion whose rows close to change points are interpolated from the motion around these.

    Args:
        motion: at states from `moved_away`.
        loops: of the model.
        track: what was recorded.
        qpos: states of all rows, (n, nq).
        near_rows: rows close to change points.
        rates: the crank's speed and acceleration at all rows, (n,) each.
    """
    if near_rows:
        motion = replace(motion, speed=rates[0], acceleration=rates[1])
    for entry in near_rows:
        motion = _interpolated(motion, loops, track, qpos, *entry)
    return motion


def _interpolated(
    motion: Motion,
    loops: ModelLoops,
    track: Track,
    qpos: Array,
    change_point: ChangePoint,
    rows: Rows,
    reduced: Array,
) -> Motion:
    count = len(change_point.nodes)
    tangent = loop_jacobian.tangent(loops, loops.linearise(change_point.states)[1])
    around = States(np.zeros(count), change_point.states, tangent)
    unit = evaluate(loops, track, around, "pose", crank_acceleration=np.zeros(count))
    weights = fit_weights(change_point.nodes, change_point.angle, reduced)
    interpolation = _Interpolation(rows, weights, motion.speed[rows], motion.acceleration[rows])
    model = loops.model
    addresses = {track.name(model.joint(i).name)[0]: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    assert motion.closure is not None
    # with a regular pose, because singular values that are zero at all states do not count
    residual, jacobian = loops.linearise(np.concatenate([qpos[rows], change_point.states[-1:]]))
    closure = np.abs(residual[:-1, : 3 * len(loops.pairs)]).max(1, initial=0.0)
    assert motion.conditioning is not None
    return replace(
        motion,
        angle=interpolation.put(motion.angle, qpos[rows, loops.crank_address]),
        points={name: interpolation.point(entry, unit.points[name]) for name, entry in motion.points.items()},
        links={name: interpolation.link(entry, unit.links[name]) for name, entry in motion.links.items()},
        joints={
            name: interpolation.joint(entry, unit.joints[name], qpos[rows, addresses[name]])
            for name, entry in motion.joints.items()
        },
        closure=interpolation.put(motion.closure, closure),
        conditioning=interpolation.put(motion.conditioning, loop_jacobian.conditioning(loops, jacobian)[:-1]),
    )


@dataclass(frozen=True, slots=True)
class _Interpolation:
    """Writes values interpolated between nodes around a change point into rows of a record.

    Attributes:
        rows: indices, (k,).
        weights: of the nodes, (k, nodes); rates at the nodes are per radian of the crank.
        speed: of the crank in these rows, (k,).
        acceleration: of the crank in these rows, (k,).
    """

    rows: Rows
    weights: Array
    speed: Array
    acceleration: Array

    def put(self, recorded: Array, values: Array) -> Array:
        """Return an array with other values in the rows."""
        out = recorded.copy()
        out[self.rows] = values
        return out

    def point(self, recorded: PointMotion, nodes: PointMotion) -> PointMotion:
        """Return a point's motion, with rows interpolated from the nodes."""
        return PointMotion(
            self._position(recorded.position, nodes.position),
            self._rate(recorded.velocity, nodes.velocity),
            self._second_rate(recorded.acceleration, nodes.velocity, nodes.acceleration),
        )

    def link(self, recorded: LinkMotion, nodes: LinkMotion) -> LinkMotion:
        """Return a link's motion, with rows interpolated from the nodes."""
        spin, angular_acceleration = nodes.angular_velocity, nodes.angular_acceleration
        return LinkMotion(
            self._position(recorded.position, nodes.position),
            self._position(recorded.rotation, nodes.rotation),
            self._rate(recorded.velocity, nodes.velocity),
            self._rate(recorded.angular_velocity, spin),
            self._second_rate(recorded.acceleration, nodes.velocity, nodes.acceleration),
            self._second_rate(recorded.angular_acceleration, spin, angular_acceleration),
        )

    def joint(self, recorded: JointMotion, nodes: JointMotion, values: Array) -> JointMotion:
        """Return a joint's motion with values, (k,), and rates interpolated from the nodes."""
        return replace(
            recorded,
            value=self.put(recorded.value, values),
            rate=self._rate(recorded.rate, nodes.rate),
            acceleration=self._second_rate(recorded.acceleration, nodes.rate, nodes.acceleration),
        )

    def _position(self, recorded: Array, nodes: Array) -> Array:
        return self.put(recorded, np.tensordot(self.weights, nodes, 1))

    def _rate(self, recorded: Array, nodes: Array) -> Array:
        return self.put(recorded, _times(self.speed, np.tensordot(self.weights, nodes, 1)))

    def _second_rate(self, recorded: Array, first: Array, nodes: Array) -> Array:
        curved = _times(self.speed**2, np.tensordot(self.weights, nodes, 1))
        return self.put(recorded, curved + _times(self.acceleration, np.tensordot(self.weights, first, 1)))


def _times(rate: Array, values: Array) -> Array:
    return rate.reshape(-1, *[1] * (values.ndim - 1)) * values
