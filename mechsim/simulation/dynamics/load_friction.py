"""Friction by the load of joints, by MuJoCo's own reactions.

The reactions of a state, or the forces of couplings, give the friction of each joint, which changes them.
They are linear in the frictions, so that MuJoCo's reactions under a unit of each give the equations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import FrictionError
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.joint_friction import TERMS, Friction
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import TINY, Array
from mechsim.numerics.complementarity import balanced_friction
from mechsim.simulation.dynamics.applied_forces import Fields, add_force
from mechsim.simulation.dynamics.loaded_model import AppliedForces, LoadedModel
from mechsim.simulation.recording import link_motions, point_rates, resting

# largest difference of frictions from those by MuJoCo's reactions under them, relative to the largest, which
# counts as this fraction of the reactions at least
BALANCED = 1e-9
# rate relative to the largest one of a joint's coordinate at which it stands still: rounding
STILL = 1e-7


@dataclass(frozen=True, slots=True)
class RubbingCoordinate:
    """A coordinate of a joint with friction by its load, at n states.

    Attributes:
        friction: of the joint.
        joint: the joint.
        number: of this friction among those of the joint.
        coulomb: friction without a load.
        axis: axis of the joint on side a, (n, 3).
        along: direction of the friction of a unit magnitude on link b, against the motion, (n, 3).
        speed: rate of the coordinate, (n,), 0 or more.
        turns: whether it is a rotation.
        point: the joint's point on link b, (n, 3).
    """

    friction: Friction
    joint: Joint
    number: int
    coulomb: float
    axis: Array
    along: Array
    speed: Array
    turns: bool
    point: Array = field(repr=False)

    def terms(self, forces: ForceRecord, present: Array) -> Array:
        """Return terms of the load, (n, TERMS, 3); the present friction loads the thread of a screw."""
        if self.friction.coupling:
            force = self.friction.coefficient * forces.gears[self.friction.coupling]
            return force[:, None, None] * np.eye(TERMS)[:, :1] * np.eye(3)[0]
        reaction = forces.reactions[self.joint.name]
        moment = reaction.moment
        if KINDS[self.joint.kind].helical and not self.number:
            moment = moment + present[:, None] * self.along
        wrench = np.concatenate([reaction.force, moment], 1)
        _, maps = self.friction.loads(self.joint, self.axis)[self.number]
        return self.friction.ratio(self.speed)[:, None, None] * (maps @ wrench[:, None, :, None])[..., 0]

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
    rows = [
        (friction, *row) for friction in loaded.forces.friction for row in friction.loaded(loaded.mechanism)
    ]
    links = {GROUND: resting(len(fields["qacc"])), **link_motions(loaded.model, loaded.track, fields)}
    coordinates: list[RubbingCoordinate] = []
    for friction, joint, number, index, coulomb in rows:
        kind, a, b = KINDS[joint.kind], links[joint.a.link], links[joint.b.link]
        frame = a.rotation @ joint.a.frame
        start, first, _ = point_rates(a, np.asarray(joint.a.point))
        point, second, _ = point_rates(b, np.asarray(joint.b.point))
        turns, rate = index >= len(kind.slides), b.angular_velocity - a.angular_velocity
        if not kind.ball:
            axis = frame[..., 2 if turns else COLUMN[kind.slides[index]]]
            moved = rate if turns else second - first - np.cross(a.angular_velocity, point - start)
            rate = axis * (axis * moved).sum(1)[:, None]
        speed = np.sqrt((rate**2).sum(1))
        slow = speed <= STILL * speed.max(initial=0.0)
        along = -rate / np.where(slow, np.inf, speed)[:, None]
        coordinates.append(
            RubbingCoordinate(friction, joint, number, coulomb, frame[..., 2], along, speed, turns, point)
        )
    return coordinates


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
        FrictionError: unless there is one stable solution.
    """

    def terms_under(frictions: Array) -> Array:
        forces = forces_under(frictions)
        columns = zip(coordinates, frictions.T, strict=True)
        return np.stack([item.terms(forces, friction) for item, friction in columns], 1)

    count, n = len(coordinates), len(coordinates[0].speed)
    constant = np.stack([(item.friction.ratio(item.speed) - 1.0) * item.coulomb for item in coordinates], 1)
    base = terms_under(np.zeros((n, count)))
    reactions = forces_under(np.zeros((n, count))).reactions.values()
    unit = np.max([np.linalg.norm(reaction.force, axis=1) for reaction in reactions], axis=0)[:, None] + TINY
    changes = [terms_under(unit * row) - base for row in np.eye(count)]
    response = np.stack(changes, -1) / unit[..., None, None, None]
    magnitudes, _, solutions = balanced_friction(constant, base, response)
    after = constant + np.sqrt((terms_under(magnitudes) ** 2).sum(3)).sum(2)
    right = np.abs(after - magnitudes).max(1) <= BALANCED * (
        np.abs(magnitudes).max(1) + BALANCED * unit[:, 0]
    )
    if not (right & (solutions == 1)).all():
        reason = "no friction, or several, balance MuJoCo's reactions; reduce a coefficient of friction"
        raise FrictionError(f"{name}: {reason}", "undetermined" if solutions.all() else "jammed")
    return magnitudes
