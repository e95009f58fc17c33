"""A mechanism's motion per radian of the crank: poses, first and second derivatives, stacked by link.

At crank speed w and acceleration e, a velocity is w times the first derivative, and an acceleration is e
times the first plus w2 times the second derivative.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.loops.maximal_coordinates import Rows, equations
from mechsim.kinematics.loops.mobility import dof_count
from mechsim.kinematics.vector_method.rotations import skew
from mechsim.mechanism.forces import Location, located
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Pose, Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import threads_of
from mechsim.mechanism.motion import Motion, select_instants, short_repr
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.jets import stepped_least_norm, stepped_null_space
from mechsim.numerics.rank import RANK_TOLERANCE

# relative deviation of size and inertia of a link with passive rotation from symmetry about its line
SYMMETRY_TOLERANCE = 1e-9


@dataclass(frozen=True)
class UnitMotion:
    """Poses and their derivatives by the crank angle, ground frame, n angles and L links.

    Attributes:
        mechanism: the mechanism; every link has an inertia.
        angle: crank angle, (n,) in [rad].
        position: positions of link origins, (n, L, 3) in [m].
        rotation: rotations of links, (n, L, 3, 3).
        twist: first derivative: of the origin in [m/rad], of the orientation in [1], (n, L, 6).
        bias: second derivative of both, (n, L, 6).
        idle: passive twists, which no joint resists with the crank locked, (n, L, 6, k).
        drivers: driver -> its value, (n,), under motion laws; the angle is then their path parameter.
        driver_rates: driver -> its derivative by the path parameter, (n,).
        driver_seconds: driver -> its second derivative, (n,).
        coordinates: joint coordinate -> its value, (n,), angles not wrapped; of some coordinates.
    """

    mechanism: Mechanism
    angle: Array
    position: Array
    rotation: Array
    twist: Array
    bias: Array
    idle: Array
    drivers: Mapping[str, Array] = field(default_factory=dict[str, Array])
    driver_rates: Mapping[str, Array] = field(default_factory=dict[str, Array])
    driver_seconds: Mapping[str, Array] = field(default_factory=dict[str, Array])
    coordinates: Mapping[str, Array] = field(default_factory=dict[str, Array])

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.angle)

    def select(self, rows: slice) -> UnitMotion:
        """Return the motion at some of the instants."""
        names = [field.name for field in fields(self) if field.name != "mechanism"]
        return replace(self, **{name: select_instants(getattr(self, name), rows) for name in names})

    @cached_property
    def masses(self) -> Array:
        """Mass of each link, (L,) in [kg]."""
        return np.array([link.inertia.mass for link in self.mechanism.links if link.inertia])

    @cached_property
    def centres(self) -> Array:
        """Centre of mass of each link from its origin, (n, L, 3) in [m]."""
        local = np.array([link.inertia.centre for link in self.mechanism.links if link.inertia])
        return (self.rotation @ local[..., None])[..., 0]

    @cached_property
    def moments(self) -> Array:
        """Inertia matrix of each link about its centre in ground axes, (n, L, 3, 3) in [kg m2]."""
        local = np.array([link.inertia.moments for link in self.mechanism.links if link.inertia])
        return self.rotation @ local @ np.swapaxes(self.rotation, -1, -2)

    @cached_property
    def threads(self) -> dict[str, Joint]:
        """Coupling -> screw joint, for the couplings of screws."""
        return threads_of(self.mechanism)

    @cached_property
    def locked_rows(self) -> Rows:
        """Loop equations and driver row, linearised at these poses."""
        return self.rows()

    def rows(self, twists: Mapping[str, Array] | None = None) -> Rows:
        """Return loop and driver equations at these poses, with the bias for twists of links (n, 6)."""
        return equations(self.mechanism, self.poses(), self.drivers or self.angle, twists)

    def poses(self) -> dict[str, Pose]:
        """Return link -> n poses."""
        return {link.name: self.pose(link.name) for link in self.mechanism.links}

    def pose(self, link: str) -> Pose:
        """Return the n poses of a link."""
        slot = self.slot(link)
        return IDENTITY if slot is None else Pose(self.position[:, slot], self.rotation[:, slot])

    def slot(self, link: str) -> int | None:
        """Return the index of a link in the stacked arrays; None for the frame."""
        return None if link == GROUND else self._slots[link]

    @cached_property
    def _slots(self) -> dict[str, int]:
        return {link.name: i for i, link in enumerate(self.mechanism.links)}

    def point(self, link: str, local: Vector) -> tuple[Array, Array]:
        """Return a point of a link and its derivative by the crank angle, (n, 3) each."""
        slot = self.slot(link)
        if slot is None:
            return np.broadcast_to(np.asarray(local), (len(self), 3)), np.zeros((len(self), 3))
        arm = self.rotation[:, slot] @ np.asarray(local)
        swing = cross(self.twist[:, slot, 3:], arm)
        return self.position[:, slot] + arm, self.twist[:, slot, :3] + swing

    def locate(self, location: Location) -> tuple[str, Array, Array]:
        """Return the link of a location, its position and the derivative of its position."""
        link, local = located(self.mechanism, location)
        return link, *self.point(link, local)

    def spin(self, link: str) -> Array:
        """Return the derivative of a link's orientation, (n, 3)."""
        slot = self.slot(link)
        return np.zeros((len(self), 3)) if slot is None else self.twist[:, slot, 3:]

    def axis(self, joint: Joint, which: str = "a") -> Array:
        """Return the axis of a joint as side a or b has it, (n, 3)."""
        return self.direction(joint.a if which == "a" else joint.b, 2)

    def direction(self, end: End, column: int) -> Array:
        """Return a column of a joint end's frame, (n, 3)."""
        slot = self.slot(end.link)
        if slot is None:
            return np.broadcast_to(end.frame[:, column], (len(self), 3))
        return self.rotation[:, slot] @ end.frame[:, column]

    def inertial(self, speed: Array, acceleration: Array) -> Array:
        """Return the wrenches that cause the motion of the links, about link origins, (n, L, 6) in [N, N m].

        m a of the centre, and I alpha + omega x I omega + c x m a for the centre at c.
        """
        w, e = speed[:, None, None], acceleration[:, None, None]
        velocity, rate = w * self.twist, e * self.twist + w**2 * self.bias
        omega, alpha, c = velocity[..., 3:], rate[..., 3:], self.centres
        moved = rate[..., :3] + cross(alpha, c) + cross(omega, cross(omega, c))
        force = self.masses[:, None] * moved
        angular = (self.moments @ alpha[..., None])[..., 0]
        gyro = cross(omega, (self.moments @ omega[..., None])[..., 0])
        return np.concatenate([force, angular + gyro + cross(c, force)], -1)


def from_motion(mechanism: Mechanism, motion: Motion, nominal: Mechanism | None = None) -> UnitMotion:
    """Return a motion at unit crank speed and zero crank acceleration, stacked by link.

    An undetermined rotation of a link about its line is removed: a body with symmetry of revolution that
        starts
    without angular momentum about its line never gains any, so that it behaves as a link without this
    rotation. `nominal` is the unperturbed mechanism if this one has complex steps.

    Raises:
        InputError: for such a link without symmetry of revolution, whose rotation would be a second degree of
            freedom.
    """
    plain = as_moved(mechanism, motion)
    idle = _idle(plain, mechanism if nominal is None else nominal)
    if not idle.shape[-1]:
        return plain
    _require_round(plain, idle)
    twist, bias = _without_spin(plain, idle)
    return replace(plain, twist=twist, bias=bias, idle=idle)


def as_moved(mechanism: Mechanism, motion: Motion) -> UnitMotion:
    """Return a motion stacked by link: at unit crank speed, or over the time instead of the angle."""
    links = [motion.links[link.name] for link in mechanism.links]
    twist = np.stack([np.concatenate([link.velocity, link.angular_velocity], -1) for link in links], 1)
    bias = np.stack([np.concatenate([link.acceleration, link.angular_acceleration], -1) for link in links], 1)
    drivers = {name: motion.joints[name] for name in motion.drivers}
    return UnitMotion(
        mechanism,
        motion.angle,
        np.stack([link.position for link in links], 1),
        np.stack([link.rotation for link in links], 1),
        twist,
        bias,
        np.zeros((*twist.shape, 0)),
        {name: driver.value for name, driver in drivers.items()},
        {name: driver.rate for name, driver in drivers.items()},
        {name: driver.acceleration for name, driver in drivers.items()},
        {name: joint.value for name, joint in motion.joints.items()},
    )


def _idle(unit: UnitMotion, nominal: Mechanism) -> Array:
    """Return a basis of the twists that remain with the crank locked, (n, L, 6, k)."""
    mechanism = unit.mechanism
    real = replace(unit, position=np.real(unit.position), rotation=np.real(unit.rotation))
    passive = dof_count(nominal, real.poses()).passive
    n, count = len(unit), len(mechanism.links)
    if not passive:
        return np.zeros((n, count, 6, 0))
    scale = np.tile([mechanism.characteristic_length] * 3 + [1.0] * 3, count)
    null = stepped_null_space(unit.locked_rows.jacobian * scale, passive, RANK_TOLERANCE)
    return (null * scale[:, None]).reshape(n, count, 6, passive)


def _require_round(unit: UnitMotion, idle: Array) -> None:
    """Raise InputError unless each passive twist leaves centres at rest and inertias unchanged."""
    for k in range(idle.shape[-1]):
        linear, angular = idle[..., :3, k], idle[..., 3:, k]
        drift = linear + cross(angular, unit.centres)
        across = skew(angular)
        change = across @ unit.moments - unit.moments @ across
        fastest = np.abs(angular).max((1, 2), keepdims=True)
        length, most = unit.mechanism.characteristic_length, np.abs(unit.moments).max((-1, -2))
        off = (np.abs(drift).max(-1) > SYMMETRY_TOLERANCE * length * fastest[..., 0]) | (
            np.abs(change).max((-1, -2)) > SYMMETRY_TOLERANCE * most * fastest[..., 0]
        )
        if off.any():
            name = unit.mechanism.links[int(np.argmax(off.any(0)))].name
            raise InputError(
                f"{unit.mechanism.name}: the rotation of link {name!r} about its line is undetermined, and "
                "its inertia has no symmetry of revolution, so that this rotation would be a degree of "
                "freedom; give it a centre on the line and equal moments across it, or a guide"
            )


def _without_spin(unit: UnitMotion, idle: Array) -> tuple[Array, Array]:
    """Return twist and bias without momentum along the passive twists, and without its rate.

    If a link has no moment of inertia about its line, balls at the centres take the place of the inertias.
    """
    n, count, _, k = idle.shape
    mass = mass_matrices(unit.masses, unit.centres, unit.moments)
    weighted = (mass @ idle).reshape(n, 6 * count, k)
    flat = idle.reshape(n, 6 * count, k)
    angular = np.swapaxes(idle[..., 3:, :].reshape(n, 3 * count, k), 1, 2)
    gram, balls = np.swapaxes(flat, 1, 2) @ weighted, angular @ np.swapaxes(angular, 1, 2)
    heaviest = np.abs(unit.moments).max() + np.finfo(np.float64).tiny
    massless = np.linalg.eigvalsh(np.real(gram)).min() <= SYMMETRY_TOLERANCE * heaviest * np.abs(balls).max()

    def off(vector: Array, along: Array) -> Array:
        if massless:
            turning = angular @ vector[..., 3:].reshape(n, 3 * count, 1)
            share = np.linalg.solve(balls, turning)
        else:
            share = np.linalg.solve(gram, along[..., None])
        return vector - (flat @ share).reshape(n, count, 6)

    momentum = (np.swapaxes(weighted, 1, 2) @ unit.twist.reshape(n, -1, 1))[..., 0]
    twist = off(unit.twist, momentum)
    twists = {link.name: twist[:, i] for i, link in enumerate(unit.mechanism.links)}
    rows = unit.rows(twists)
    before = unit.rows({link.name: unit.twist[:, i] for i, link in enumerate(unit.mechanism.links)})
    # second derivatives of the driven motion, with any passive rotation
    driven = (before.jacobian @ unit.bias.reshape(n, -1, 1))[..., 0] + before.bias
    scale = np.tile([unit.mechanism.characteristic_length] * 3 + [1.0] * 3, count)
    least = stepped_least_norm(rows.jacobian * scale, rows.bias - driven, RANK_TOLERANCE)
    bias = -(scale * least).reshape(n, count, 6)
    moved = replace(unit, twist=twist, bias=bias)
    unit_rates, zero = np.ones(n), np.zeros(n)
    torque = (np.swapaxes(flat, 1, 2) @ moved.inertial(unit_rates, zero).reshape(n, -1, 1))[..., 0]
    return twist, off(bias, torque)


def mass_matrices(masses: Array, centres: Array, moments: Array) -> Array:
    """Return each link's 6 x 6 mass matrix about a point, linear before angular, ground axes, (n, L, 6, 6).

    Args:
        masses: (L,) in [kg].
        centres: centres of mass from the point, (n, L, 3) in [m].
        moments: inertia matrices about the centres, (n, L, 3, 3) in [kg m2].
    """
    across, mass = skew(centres), masses[:, None, None]
    out = np.zeros((*centres.shape[:2], 6, 6), np.result_type(masses, centres, moments))
    out[..., :3, :3] = mass * np.eye(3)
    out[..., 3:, :3], out[..., :3, 3:] = mass * across, -mass * across
    out[..., 3:, 3:] = moments - mass * across @ across
    return out
