"""Friction by the load of joints, iterated with MuJoCo's own reactions.

The reactions of a state, or the forces of couplings, give the friction of each joint, which changes them. The
iteration stops when the frictions no longer change; their changes shrink by a constant ratio.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import FrictionError
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.applied_forces import Fields, add_force
from mechsim.simulation.dynamics.loaded_model import AppliedForces, LoadedModel
from mechsim.simulation.recording import link_motions, point_rates, resting

# relative change of the frictions at which the iteration ends, and its largest number: with a ratio of 0.9 it
# needs 290
CONVERGED, MAX_ITERATIONS = 1e-13, 400
# rate relative to the largest one of a joint's coordinate at which it stands still: rounding
STILL = 1e-7


@dataclass(frozen=True, slots=True)
class RubbingCoordinate:
    """A coordinate of a joint with friction by its load, at n states.

    Attributes:
        friction: of the joint.
        joint: the joint.
        number: of this friction among those of the joint.
        axis: axis of the joint on side a, (n, 3).
        along: direction of the friction of a unit magnitude on link b, against the motion, (n, 3).
        speed: rate of the coordinate, (n,), 0 or more.
        turns: whether it is a rotation.
        point: the joint's point on link b, (n, 3).
    """

    friction: Friction
    joint: Joint
    number: int
    axis: Array
    along: Array
    speed: Array
    turns: bool
    point: Array = field(repr=False)

    def magnitude(self, forces: ForceRecord, present: Array) -> Array:
        """Return the friction by reactions, (n,); the present friction loads the thread of a screw."""
        if self.friction.coupling:
            return self.friction.coefficient * np.abs(forces.gears[self.friction.coupling])
        reaction = forces.reactions[self.joint.name]
        moment = reaction.moment
        if KINDS[self.joint.kind].helical and not self.number:
            moment = moment + present[:, None] * self.along
        wrench = np.concatenate([reaction.force, moment], 1)
        _, maps = self.friction.loads(self.joint, self.axis)[self.number]
        terms = (maps @ wrench[:, None, :, None])[..., 0]
        kind, ratio = KINDS[self.joint.kind], self.friction.ratio(self.speed)
        constant = 0.0 if kind.mixed else self.friction.sizes(kind)[0][1]
        return ratio * np.sqrt((terms**2).sum(2)).sum(1) + (ratio - 1.0) * constant

    def apply(self, loaded: LoadedModel, fields: Fields, forces: AppliedForces, magnitude: Array) -> None:
        """Add the friction, (n,) in [N] or [N m], to applied forces."""
        effort = magnitude[:, None] * self.along
        for link, sign in ((self.joint.b.link, 1.0), (self.joint.a.link, -1.0)):
            if self.turns:
                forces.wrenches[:, loaded.body(link), 3:] += sign * effort
            else:
                add_force(forces.wrenches, fields, loaded.body(link), self.point, sign * effort)


def rubbing_coordinates(loaded: LoadedModel, fields: Fields) -> list[RubbingCoordinate]:
    """Return the coordinates with friction by their load at the states of MuJoCo's fields."""
    result: list[RubbingCoordinate] = []
    for friction in loaded.forces.friction:
        if friction.varies:
            joint = loaded.mechanism.joint(friction.joint)
            for number, (index, maps) in enumerate(friction.loads(joint, np.eye(3)[2:])):
                if friction.static or maps.any():
                    result.append(_coordinate(loaded, fields, friction, joint, number, index))
    return result


def _coordinate(
    loaded: LoadedModel, fields: Fields, friction: Friction, joint: Joint, number: int, index: int
) -> RubbingCoordinate:
    kind = KINDS[joint.kind]
    links = {GROUND: resting(len(fields["qacc"])), **link_motions(loaded.model, loaded.track, fields)}
    a, b = links[joint.a.link], links[joint.b.link]
    frame = a.rotation @ joint.a.frame
    start, first, _ = point_rates(a, np.asarray(joint.a.point))
    point, second, _ = point_rates(b, np.asarray(joint.b.point))
    spin = b.angular_velocity - a.angular_velocity
    turns = index >= len(kind.slides)
    if kind.ball:
        rate = spin
    else:
        axis = frame[..., 2 if turns else COLUMN[kind.slides[index]]]
        moved = spin if turns else second - first - np.cross(a.angular_velocity, point - start)
        rate = axis * (axis * moved).sum(1)[:, None]
    speed = np.sqrt((rate**2).sum(1))
    slow = speed <= STILL * speed.max(initial=0.0)
    along = -rate / np.where(slow, np.inf, speed)[:, None]
    return RubbingCoordinate(friction, joint, number, frame[..., 2], along, speed, turns, point)


def friction_of_state(
    coordinates: Sequence[RubbingCoordinate],
    forces_under: Callable[[Array], ForceRecord],
    name: str,
) -> Array:
    """Return the frictions, (n, k), that the reactions under them cause.

    Args:
        coordinates: the k coordinates.
        forces_under: frictions (n, k) -> the forces that joints and couplings transmit.
        name: of the mechanism.

    Raises:
        FrictionError: if the iteration does not converge.
    """
    magnitudes = np.zeros((len(coordinates[0].speed), len(coordinates)))
    for _ in range(MAX_ITERATIONS):
        forces = forces_under(magnitudes)
        columns = zip(coordinates, magnitudes.T, strict=True)
        after = np.stack([item.magnitude(forces, magnitude) for item, magnitude in columns], 1)
        change = np.abs(after - magnitudes).max(1, initial=0.0)
        magnitudes = after
        if (change <= CONVERGED * np.abs(magnitudes).max(1, initial=0.0)).all():
            return magnitudes
    raise FrictionError(
        f"{name}: the frictions by MuJoCo's reactions do not converge within {MAX_ITERATIONS} iterations; "
        "reduce a coefficient of friction",
        "jammed",
    )
