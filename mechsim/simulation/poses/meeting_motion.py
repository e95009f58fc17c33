"""The motion close to a meeting of two assemblies, where the loops give no rates: read off around it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mechsim.maths.arrays import Array
from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.meetings import Meeting, fitted
from mechsim.simulation.recorded_motion import States, Track, evaluate

Rows = NDArray[np.intp]


def held_off(states: Array, meeting: Meeting, rows: Rows) -> Array:
    """Return states of which those at some rows are moved away from a meeting, so that they have rates."""
    away = states.copy()
    away[rows] = meeting.states[-1]
    return away


def mended(
    motion: Motion, loops: ModelLoops, track: Track, qpos: Array, meeting: Meeting, rows: Rows, turned: Array
) -> Motion:
    """Return a motion whose rows close to a meeting are interpolated from the motion around it.

    Args:
        motion: with rows that are wrong.
        loops: of the model.
        track: what was recorded.
        qpos: states of all rows, (n, nq).
        meeting: that they are close to.
        rows: which they are, (k,).
        turned: crank angles of these rows, counted as the meeting's, (k,) in [rad].
    """
    count = len(meeting.nodes)
    tangent = loops.tangent(loops.linearise(meeting.states)[1])
    around = States(np.zeros(count), meeting.states, tangent)
    unit = evaluate(loops, track, around, "pose", crank_acceleration=np.zeros(count))
    by = fitted(meeting.nodes, meeting.angle, turned)
    speed, second = motion.speed.copy(), motion.acceleration.copy()

    def put(into: Array, values: Array) -> Array:
        out = into.copy()
        out[rows] = values
        return out

    def place(into: Array, nodes: Array) -> Array:
        return put(into, np.tensordot(by, nodes, 1))

    def rate(into: Array, nodes: Array) -> Array:
        return put(into, _times(speed[rows], np.tensordot(by, nodes, 1)))

    def acceleration(into: Array, first: Array, nodes: Array) -> Array:
        curved = _times(speed[rows] ** 2, np.tensordot(by, nodes, 1))
        return put(into, curved + _times(second[rows], np.tensordot(by, first, 1)))

    points = {
        name: PointMotion(
            place(one.position, near.position),
            rate(one.velocity, near.velocity),
            acceleration(one.acceleration, near.velocity, near.acceleration),
        )
        for name, one, near in ((name, one, unit.points[name]) for name, one in motion.points.items())
    }
    links = {
        name: LinkMotion(
            place(one.position, near.position),
            place(one.rotation, near.rotation),
            rate(one.velocity, near.velocity),
            rate(one.angular_velocity, near.angular_velocity),
            acceleration(one.acceleration, near.velocity, near.acceleration),
            acceleration(one.angular_acceleration, near.angular_velocity, near.angular_acceleration),
        )
        for name, one, near in ((name, one, unit.links[name]) for name, one in motion.links.items())
    }
    model = loops.model
    place_of = {track.name(model.joint(i).name)[0]: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    joints = {
        name: JointMotion(
            put(one.value, qpos[rows, place_of[name]]),
            rate(one.rate, near.rate),
            acceleration(one.acceleration, near.rate, near.acceleration),
            one.unit,
            one.part,
        )
        for name, one, near in ((name, one, unit.joints[name]) for name, one in motion.joints.items())
    }
    assert motion.closure is not None
    opened = np.abs(loops.residual(qpos[rows])[:, : 3 * len(loops.pairs)]).max(1, initial=0.0)
    return replace(
        motion,
        angle=put(motion.angle, qpos[rows, loops.crank_place]),
        points=points,
        links=links,
        joints=joints,
        closure=put(motion.closure, opened),
    )


def _times(rate: Array, values: Array) -> Array:
    return rate.reshape(-1, *[1] * (values.ndim - 1)) * values
