"""Newton's and Euler's laws of each link, from the accelerations of a motion and its reported forces.

Neither method is used, only the descriptions of mechanism and forces, the motion of the
links, and the reported forces.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.forces import Forces, located
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion, Motion


@dataclass(frozen=True)
class Action:
    """A force at a point and a moment on a link, (n, 3) each in ground axes, and its reverse on another."""

    name: str
    on: str
    by: str | None
    force: np.ndarray | float
    point: np.ndarray | float = 0.0
    moment: np.ndarray | float = 0.0


class Posture:
    """Poses and velocities of links and the ground at n instants."""

    def __init__(self, motion: Motion) -> None:
        self.motion, self.n = motion, len(motion)
        none = np.zeros((self.n, 3))
        ground = LinkMotion(none, np.tile(np.eye(3), (self.n, 1, 1)), none, none, none, none)
        self.links = {**motion.links, GROUND: ground}

    def rotated(self, link: str, vector: object) -> np.ndarray:
        """Return a vector of a link's frame in the ground frame."""
        return self.links[link].rotation @ np.asarray(vector, dtype=np.float64)

    def point(self, link: str, local: object) -> np.ndarray:
        """Return a point of a link."""
        return self.links[link].position + self.rotated(link, local)

    def spin(self, link: str) -> np.ndarray:
        """Return the angular velocity of a link."""
        return self.links[link].angular_velocity

    def velocity(self, link: str, point: np.ndarray) -> np.ndarray:
        """Return the velocity of the point of a link at a position."""
        moved = self.links[link]
        return moved.velocity + np.cross(moved.angular_velocity, point - moved.position)


def largest_imbalance(
    mechanism: Mechanism, forces: Forces, motion: Motion, record: ForceRecord, without: str | None = None
) -> float:
    """Return the largest imbalance of any link relative to the largest force.

    Args:
        mechanism: with an inertia on every link.
        forces: gravity, springs, friction, loads and couples.
        motion: of all links.
        record: reported forces at the same instants.
        without: name of an action to leave out.
    """
    posture, length = Posture(motion), mechanism.characteristic_length
    every = [*actions(mechanism, forces, motion, record)]
    scale = max(
        float(np.linalg.norm(np.atleast_2d(vector), axis=1).max(initial=0.0)) / unit
        for item in every
        for vector, unit in ((item.force, 1.0), (item.moment, length))
    )
    worst = 0.0
    for link in mechanism.links:
        centre = posture.point(link.name, link.inertia.centre)
        force, moment = _inertial(posture, link.name, link.inertia)
        for item in every:
            sign = float(item.by == link.name) - float(item.on == link.name)
            if sign and item.name != without:
                force = force + sign * item.force
                arm = np.broadcast_to(item.point - centre, centre.shape)
                moment = moment + sign * (item.moment + np.cross(arm, np.zeros(3) + item.force))
        worst = max(worst, float(np.abs(force).max()), float(np.abs(moment).max()) / length)
    return worst / scale


def actions(mechanism: Mechanism, forces: Forces, motion: Motion, record: ForceRecord) -> Iterator[Action]:
    """Yield all actions on the links, described and reported."""
    posture, instants = Posture(motion), (motion.angle, motion.time)
    for link in mechanism.links:
        weight = link.inertia.mass * np.asarray(forces.gravity)
        centre = posture.point(link.name, link.inertia.centre)
        yield Action(f"weight of {link.name}", link.name, None, weight, centre)
    for i, load in enumerate(forces.loads):
        link, local = located(mechanism, load.location)
        yield Action(f"load {i}", link, None, load.force.evaluate(*instants), posture.point(link, local))
    for i, couple in enumerate(forces.couples):
        yield Action(f"couple {i}", couple.link, None, 0.0, moment=couple.moment.evaluate(*instants))
    yield from _springs(mechanism, forces, posture)
    yield from _friction(mechanism, forces, posture)
    for name, item in record.reactions.items():
        yield Action(f"reaction of {name}", item.link, item.by, item.force, item.point, item.moment)
    for name, item in record.meshes.items():
        yield Action(f"teeth of {name}", item.link, item.by, item.force, item.point)
    if not record.drives:
        yield along_coordinate(mechanism, posture, mechanism.crank.name, record.torque, "drive")
    for name, effort in {**record.drives, **record.locked}.items():
        yield along_coordinate(mechanism, posture, name, effort, f"drive of {name}")
    yield from _ideal_transmissions(mechanism, posture, record)


def along_coordinate(
    mechanism: Mechanism, posture: Posture, coordinate: str, effort: np.ndarray, name: str
) -> Action:
    """Return an effort on a joint's coordinate: on its link b, by its link a."""
    joint = next(joint for joint in mechanism.joints if coordinate in joint.coordinates)
    kind, index = KINDS[joint.kind], joint.coordinates.index(coordinate)
    axis = {"x": 0, "y": 1}.get(kind.slides[index], 2) if index < len(kind.slides) else 2
    vector = effort[:, None] * posture.rotated(joint.a.link, joint.a.frame[:, axis])
    point = posture.point(joint.b.link, joint.b.point)
    force, moment = (vector, 0.0) if index < len(kind.slides) else (0.0, vector)
    return Action(name, joint.b.link, joint.a.link, force, point, moment)


def _ideal_transmissions(mechanism: Mechanism, posture: Posture, record: ForceRecord) -> Iterator[Action]:
    """Yield the forces and torques of couplings that have neither teeth nor a thread."""
    screws = [{*joint.coordinates} for joint in mechanism.joints if joint.kind == "screw"]
    for name, law in mechanism.named_laws.items():
        if name in record.meshes or {*law.coordinates} in screws:
            continue
        joints = posture.motion.joints
        right = sum(weight * joints[item].value for item, weight in law.right_terms.items()) - law.zeros[1]
        gradient = np.polynomial.Polynomial(law.coefficients).deriv()(right + np.zeros(posture.n))
        for terms, factor in ((law.left_terms, np.ones(posture.n)), (law.right_terms, -gradient)):
            for coordinate, weight in terms.items():
                effort = weight * factor * record.gears[name]
                acting = f"coupling {name} on {coordinate}"
                yield along_coordinate(mechanism, posture, coordinate, effort, acting)


def _springs(mechanism: Mechanism, forces: Forces, posture: Posture) -> Iterator[Action]:
    for i, spring in enumerate(forces.springs):
        (link_a, a), (link_b, b) = (located(mechanism, position) for position in (spring.a, spring.b))
        first, second = posture.point(link_a, a), posture.point(link_b, b)
        difference = second - first
        length = np.linalg.norm(difference, axis=1, keepdims=True)
        closing = posture.velocity(link_b, second) - posture.velocity(link_a, first)
        rate = (closing * difference).sum(1, keepdims=True) / length
        tension = spring.stiffness * (length - spring.rest) + spring.damping * rate
        yield Action(f"spring {i}", link_a, link_b, tension * difference / length, first)
    for spring in forces.joint_springs:
        stretch = posture.motion.joints[spring.joint].value - spring.rest
        name = f"spring in {spring.joint}"
        yield along_coordinate(mechanism, posture, spring.joint, -spring.stiffness * stretch, name)


def _friction(mechanism: Mechanism, forces: Forces, posture: Posture) -> Iterator[Action]:
    """Yield friction in joints that slide or turn about one axis, or about all."""
    for rubbing in forces.friction:
        joint = mechanism.joint(rubbing.joint)
        spin = posture.spin(joint.b.link) - posture.spin(joint.a.link)
        name, point = f"friction in {joint.name}", posture.point(joint.b.link, joint.b.point)
        if joint.kind == "spherical":
            speed = np.linalg.norm(spin, axis=1, keepdims=True)
            couple = -(rubbing.viscous + rubbing.coulomb / np.where(speed > 0.0, speed, 1.0)) * spin
            yield Action(name, joint.b.link, joint.a.link, 0.0, point, couple)
            continue
        axis = posture.rotated(joint.a.link, joint.a.axis)
        moved = posture.velocity(joint.b.link, point) - posture.velocity(joint.a.link, point)
        rates = {"slide": (moved * axis).sum(1), "turn": (spin * axis).sum(1)}
        mixed, sliding = KINDS[joint.kind].mixed, bool(KINDS[joint.kind].slides)
        own = (rubbing.viscous, rubbing.coulomb)
        sizes = {"slide": own, "turn": (rubbing.viscous_turn, rubbing.coulomb_turn) if mixed else own}
        resisted = {
            kind: -(viscous * rates[kind] + dry * np.sign(rates[kind]))[:, None] * axis
            for kind, (viscous, dry) in sizes.items()
        }
        force = resisted["slide"] if sliding else 0.0
        couple = resisted["turn"] if mixed or not sliding else 0.0
        yield Action(name, joint.b.link, joint.a.link, force, point, couple)


def _inertial(posture: Posture, link: str, inertia: object) -> tuple[np.ndarray, np.ndarray]:
    """Return m a of the centre of mass, and I alpha + omega x I omega about it."""
    moved = posture.motion.links[link]
    spin, arm = moved.angular_velocity, posture.rotated(link, inertia.centre)
    turning = np.cross(moved.angular_acceleration, arm) + np.cross(spin, np.cross(spin, arm))
    matrix = moved.rotation @ np.asarray(inertia.moments) @ np.swapaxes(moved.rotation, 1, 2)
    moment = (matrix @ moved.angular_acceleration[..., None])[..., 0]
    moment = moment + np.cross(spin, (matrix @ spin[..., None])[..., 0])
    return inertia.mass * (moved.acceleration + turning), moment


def largest_work(mechanism: Mechanism, motion: Motion, record: ForceRecord) -> float:
    """Return the largest power of any reaction in its joint, or of teeth at their pitch point.

    It is relative to the largest force times the largest speed. Ideal constraints do no work.
    """
    posture, power, force, speed = Posture(motion), 0.0, 0.0, 0.0
    for item in (*record.reactions.values(), *record.meshes.values()):
        velocities = [posture.velocity(link, item.point) for link in (item.link, item.by)]
        spins = [mechanism.characteristic_length * posture.spin(link) for link in (item.link, item.by)]
        moment = getattr(item, "moment", np.zeros(3)) / mechanism.characteristic_length
        work = item.force * (velocities[0] - velocities[1]) + moment * (spins[0] - spins[1])
        power = max(power, float(np.abs(work.sum(1)).max()))
        force = max(force, *(float(np.abs(vector).max()) for vector in (item.force, moment)))
        speed = max(speed, *(float(np.abs(vector).max()) for vector in (*velocities, *spins)))
    return power / (force * speed)


def largest_slip(mechanism: Mechanism, motion: Motion, record: ForceRecord) -> float:
    """Return the largest slip speed of pitch circles relative to the largest speed of any wheel."""
    posture, slip, speed = Posture(motion), 0.0, 0.0
    for item in record.meshes.values():
        velocities = [posture.velocity(link, item.point) for link in (item.link, item.by)]
        slip = max(slip, float(np.abs(velocities[0] - velocities[1]).max()))
        spins = np.abs([posture.spin(link) for link in (item.link, item.by)])
        speed = max(speed, mechanism.characteristic_length * float(spins.max()))
    return slip / speed if record.meshes else 0.0
