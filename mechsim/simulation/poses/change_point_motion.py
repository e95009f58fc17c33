"""The motion close to a meeting of two assemblies, where the loops give no rates: read off around it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import Meeting, fitted
from mechsim.simulation.recorded_motion import States, Track, evaluate

Rows = NDArray[np.intp]
# meetings, which rows are close to each, and their crank angles, counted as the meeting's, (k,) in [rad]
Near = Sequence[tuple[Meeting, Rows, Array]]


def held_off(states: Array, near: Near) -> Array:
    """Return states of which those close to meetings are moved away from them, so that they have rates."""
    away = states.copy()
    for meeting, rows, _ in near:
        away[rows] = meeting.states[-1]
    return away


def mended(
    motion: Motion,
    loops: ModelLoops,
    track: Track,
    qpos: Array,
    near: Near,
    rates: tuple[Array, Array],
) -> Motion:
    """Return a motion whose rows close to meetings are interpolated from the motion around these.

    Args:
        motion: at states that were held off.
        loops: of the model.
        track: what was recorded.
        qpos: states of all rows, (n, nq).
        near: what is close to meetings.
        rates: the crank's speed and acceleration at all rows, (n,) each.
    """
    if near:
        motion = replace(motion, speed=rates[0], acceleration=rates[1])
    for one in near:
        motion = _mended(motion, loops, track, qpos, *one)
    return motion


def _mended(
    motion: Motion, loops: ModelLoops, track: Track, qpos: Array, meeting: Meeting, rows: Rows, turned: Array
) -> Motion:
    count = len(meeting.nodes)
    tangent = loops.tangent(loops.linearise(meeting.states)[1])
    around = States(np.zeros(count), meeting.states, tangent)
    unit = evaluate(loops, track, around, "pose", crank_acceleration=np.zeros(count))
    by = fitted(meeting.nodes, meeting.angle, turned)
    mend = _Mend(rows, by, motion.speed[rows], motion.acceleration[rows])
    model = loops.model
    places = {track.name(model.joint(i).name)[0]: int(model.jnt_qposadr[i]) for i in range(model.njnt)}
    assert motion.closure is not None
    # beside one that is no special pose, for singular values that are nought at all do not count
    residual, jacobian = loops.linearise(np.concatenate([qpos[rows], meeting.states[-1:]]))
    opened = np.abs(residual[:-1, : 3 * len(loops.pairs)]).max(1, initial=0.0)
    assert motion.conditioning is not None
    return replace(
        motion,
        angle=mend.put(motion.angle, qpos[rows, loops.crank_address]),
        points={name: mend.point(one, unit.points[name]) for name, one in motion.points.items()},
        links={name: mend.link(one, unit.links[name]) for name, one in motion.links.items()},
        joints={
            name: mend.joint(one, unit.joints[name], qpos[rows, places[name]])
            for name, one in motion.joints.items()
        },
        closure=mend.put(motion.closure, opened),
        conditioning=mend.put(motion.conditioning, loops.conditioning(jacobian)[:-1]),
    )


@dataclass(frozen=True, slots=True)
class _Mend:
    """Puts values interpolated between nodes around a meeting into rows of a record.

    Attributes:
        rows: which, (k,).
        by: weights of the nodes, (k, nodes); what the nodes hold is per radian of the crank.
        speed: of the crank in these rows, (k,).
        second: its acceleration there, (k,).
    """

    rows: Rows
    by: Array
    speed: Array
    second: Array

    def put(self, into: Array, values: Array) -> Array:
        """Return an array with other values in the rows."""
        out = into.copy()
        out[self.rows] = values
        return out

    def point(self, one: PointMotion, near: PointMotion) -> PointMotion:
        """Return a point's motion, mended from that at the nodes."""
        return PointMotion(
            self._place(one.position, near.position),
            self._rate(one.velocity, near.velocity),
            self._acceleration(one.acceleration, near.velocity, near.acceleration),
        )

    def link(self, one: LinkMotion, near: LinkMotion) -> LinkMotion:
        """Return a link's motion, mended from that at the nodes."""
        spin, bend = near.angular_velocity, near.angular_acceleration
        return LinkMotion(
            self._place(one.position, near.position),
            self._place(one.rotation, near.rotation),
            self._rate(one.velocity, near.velocity),
            self._rate(one.angular_velocity, spin),
            self._acceleration(one.acceleration, near.velocity, near.acceleration),
            self._acceleration(one.angular_acceleration, spin, bend),
        )

    def joint(self, one: JointMotion, near: JointMotion, values: Array) -> JointMotion:
        """Return a joint's motion with values, (k,), its rates mended from those at the nodes."""
        return replace(
            one,
            value=self.put(one.value, values),
            rate=self._rate(one.rate, near.rate),
            acceleration=self._acceleration(one.acceleration, near.rate, near.acceleration),
        )

    def _place(self, into: Array, nodes: Array) -> Array:
        return self.put(into, np.tensordot(self.by, nodes, 1))

    def _rate(self, into: Array, nodes: Array) -> Array:
        return self.put(into, _times(self.speed, np.tensordot(self.by, nodes, 1)))

    def _acceleration(self, into: Array, first: Array, nodes: Array) -> Array:
        curved = _times(self.speed**2, np.tensordot(self.by, nodes, 1))
        return self.put(into, curved + _times(self.second, np.tensordot(self.by, first, 1)))


def _times(rate: Array, values: Array) -> Array:
    return rate.reshape(-1, *[1] * (values.ndim - 1)) * values
