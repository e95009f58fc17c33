"""Change points, at which two assemblies of a model coincide: poses, and the motion through them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import States, Track, evaluate

# singular values below this fraction of the largest belong to unconstrained directions in the neighbourhood
CONSTRAINED_FRACTION = 0.05
# degree of the polynomial that is fitted to values at the nodes
DEGREE = 18


@dataclass(frozen=True)
class ChangePoint:
    """A change point, and the path of an assembly through it.

    Attributes:
        angle: of the crank, in [rad].
        states: closed, at nodes on both sides, (k, nq).
        nodes: crank angles of the states, (k,).
    """

    angle: float
    states: Array
    nodes: Array

    def weights(self, angles: Array) -> Array:
        """Return the weights of values at the nodes in a polynomial fit at angles close to it, (n, k).

        The nearest nodes count least: rounding errors of rates grow as the inverse cube of the distance.
        """
        reach = float(np.abs(self.nodes - self.angle).max())
        at_nodes, at_angles = ((values - self.angle) / reach for values in (self.nodes, angles))
        trust = np.abs(at_nodes) ** 3
        fit = np.linalg.pinv(trust[:, None] * chebvander(at_nodes, DEGREE), rcond=1e-12) * trust
        return chebvander(at_angles, DEGREE) @ fit


def closed_near(loops: ModelLoops, states: Array) -> Array:
    """Return states close to a change point, closed by Newton steps in the constrained directions."""
    for _ in range(2):
        residual, jacobian = loops.linearise(states)
        step = np.zeros((len(states), loops.model.nv))
        constrained = loop_jacobian.constrained_jacobian(loops, jacobian)
        step[:, loops.free] = -least_norm(constrained, residual, CONSTRAINED_FRACTION, floor=0.0)
        states = loops.displaced(states, step)
    return states


Rows = NDArray[np.intp]
# change points, the rows close to each, and their crank angles reduced to its range, (k,) in [rad]
NearRows = Sequence[tuple[ChangePoint, Rows, Array]]


def moved_away(states: Array, near_rows: NearRows) -> Array:
    """Return states in which those close to change points are moved away, so that they have rates."""
    away = states.copy()
    for change_point, rows, _ in near_rows:
        away[rows] = change_point.states[-1]
    return away


def interpolated_motion(
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
        track: recorded points, links and coordinates.
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
    count = len(change_point.states)
    tangent = loop_jacobian.tangent(loops, loops.linearise(change_point.states)[1])
    around = States(np.zeros(count), change_point.states, tangent)
    unit = evaluate(loops, track, around, "pose", crank_acceleration=np.zeros(count))
    weights = change_point.weights(reduced)
    interpolation = _Interpolation(rows, weights, motion.speed[rows], motion.acceleration[rows])
    model = loops.model
    addresses = {track.name(model.joint(i).name)[0]: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    assert motion.closure is not None
    # a regular pose is added, because singular values that are zero at all states do not count
    residual, jacobian = loops.linearise(np.concatenate([qpos[rows], change_point.states[-1:]]))
    closure = np.abs(residual[:-1, loops.point_rows]).max(1, initial=0.0)
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
