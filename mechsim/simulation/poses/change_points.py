"""Change points, at which two assemblies of a model coincide: poses, and the motion through them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray

from mechsim.mechanism.motion import Motion, replace_instants, weighted_sums
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import States, evaluate

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
    motion: Motion, closed: ClosedModel, qpos: Array, near_rows: NearRows, rates: tuple[Array, Array]
) -> Motion:
    """Return a motion whose rows close to change points are interpolated from the motion around these.

    Args:
        motion: at states from `moved_away`.
        closed: the model.
        qpos: states of all rows, (n, nq).
        near_rows: rows close to change points.
        rates: the crank's speed and acceleration at all rows, (n,) each.
    """
    if not near_rows:
        return motion
    assert motion.closure is not None
    assert motion.conditioning is not None
    closure, conditioning, time = motion.closure.copy(), motion.conditioning.copy(), motion.time
    loops, track, cranks = closed.loops, closed.track, np.stack(rates, 1)
    for change_point, rows, reduced in near_rows:
        count = len(change_point.states)
        tangent = loop_jacobian.tangent(loops, loops.linearised(change_point.states)[1])
        for speed, acceleration in np.unique(cranks[rows], axis=0):
            same = (cranks[rows] == [speed, acceleration]).all(1)
            accelerations = np.full(count, acceleration)
            around = States(np.zeros(count), change_point.states, speed * tangent, accelerations)
            nodes = evaluate(loops, track, around, "pose")
            interpolated = weighted_sums(nodes, change_point.weights(reduced[same]))
            motion = replace_instants(motion, rows[same], interpolated)
        # a regular pose is added, because singular values that are zero at all states do not count
        residual, jacobian = loops.linearised(np.concatenate([qpos[rows], change_point.states[-1:]]))
        closure[rows] = np.abs(residual[:-1, loops.point_rows]).max(1, initial=0.0)
        conditioning[rows] = loop_jacobian.conditioning(loops, jacobian)[:-1]
    values = {
        track.name(loops.model.joint(i).name)[0]: qpos[:, address]
        for i, address in enumerate(loops.model.jnt_qposadr)
    }
    return replace(
        motion,
        angle=qpos[:, loops.crank_address],
        speed=rates[0],
        acceleration=rates[1],
        time=time,
        joints={name: replace(joint, value=values[name]) for name, joint in motion.joints.items()},
        closure=closure,
        conditioning=conditioning,
    )
