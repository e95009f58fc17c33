"""Friction in joints of every kind: the rates it opposes, and the wrenches it puts on the links."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import cross, dot
from mechsim.model.forces import Friction
from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import Joint
from mechsim.numerics.arrays import Array

# a joint that moves less than this a radian of the crank, in [rad] or sizes of the mechanism, is where it
# turns round: the sign of its rate is rounding there, and dry friction has no direction
STILL = 1e-7


@dataclass(frozen=True, slots=True)
class Dry:
    """One dry friction: a size in [N m] or [N], and the rate (n,) per radian of the crank it opposes."""

    size: float
    rate: Array
    still: NDArray[np.bool_]

    @property
    def direction(self) -> Array:
        """Sign of the rate, 0 where the joint turns round, (n,)."""
        return np.where(self.still, 0.0, np.sign(np.real(self.rate)))


def dry_sizes(joint: Joint, friction: Friction) -> list[float]:
    """Return the sizes of a joint's dry frictions, those above zero, in the order of `add_friction`."""
    return [size for _, size in friction.sizes(KINDS[joint.kind]) if size]


def rates(unit: UnitMotion, joint: Joint) -> list[Array]:
    """Return the derivatives of a joint's coordinates by the crank angle; of a ball the size of its spin."""
    kind, spin = KINDS[joint.kind], _spin(unit, joint)
    place_a, rate_a = unit.point(joint.a.link, joint.a.point)
    place_b, rate_b = unit.point(joint.b.link, joint.b.point)
    gap_rate = rate_b - rate_a - cross(unit.spin(joint.a.link), place_b - place_a)
    found = [dot(axis, gap_rate) for axis in _slides(unit, joint)]
    if kind.ball:
        return [*found, np.sqrt(dot(spin, spin))]
    if kind.crossed:
        return [*found, *_axis_rates(unit.axis(joint, "a"), unit.axis(joint, "b"), spin)]
    return [*found, dot(unit.axis(joint), spin)] if kind.turns else found


def add_friction(unit: UnitMotion, damping: Array, coulomb: Array, friction: Friction) -> list[Dry]:
    """Add a joint's friction to wrenches: viscous at unit crank speed, dry while the crank turns forwards.

    Returns:
        Each dry friction; a spherical joint's rate is the size of its relative spin.
    """
    joint = unit.mechanism.joint(friction.joint)
    kind = KINDS[joint.kind]
    lengths = [unit.mechanism.size] * len(kind.slides) + [1.0] * len(kind.turns)
    viscous: list[Array] = []
    parts: list[Dry] = []
    for (damper, size), rate, length in zip(friction.sizes(kind), rates(unit, joint), lengths, strict=False):
        viscous.append(-damper * rate)
        parts.append(Dry(size, rate, np.abs(rate) <= STILL * length))
    add_efforts(unit, damping, joint, viscous)
    add_efforts(unit, coulomb, joint, [-part.size * part.direction for part in parts])
    return [part for part in parts if part.size]


def add_efforts(unit: UnitMotion, stack: Array, joint: Joint, efforts: Sequence[Array]) -> None:
    """Add forces and torques (n,) on link b along a joint's coordinates, each doing work on its own alone.

    A ball's one torque is about its relative spin.
    """
    kind = KINDS[joint.kind]
    for axis, effort in zip(_slides(unit, joint), efforts, strict=False):
        force = effort[:, None] * axis
        place, _ = unit.point(joint.b.link, joint.b.point)
        add_force(unit, stack, joint.b.link, place, force)
        add_force(unit, stack, joint.a.link, place, -force)
    torques = efforts[len(kind.slides) :]
    if kind.ball:
        spin = _spin(unit, joint)
        speed = np.sqrt(dot(spin, spin))
        add_couple(
            unit, stack, joint, torques[0][:, None] * spin / np.where(speed > 0.0, speed, 1.0)[:, None]
        )
    elif kind.crossed:
        axes = unit.axis(joint, "a"), unit.axis(joint, "b")
        add_couple(unit, stack, joint, _about(*axes, *torques))
    elif kind.turns:
        add_couple(unit, stack, joint, torques[0][:, None] * unit.axis(joint))


def add_force(unit: UnitMotion, stack: Array, link: str, place: Array, force: Array) -> None:
    """Add a force on a link at a place in the ground frame to a stack of wrenches."""
    slot = unit.slot(link)
    if slot is not None:
        stack[:, slot, :3] += force
        stack[:, slot, 3:] += cross(place - unit.position[:, slot], force)


def add_couple(unit: UnitMotion, stack: Array, joint: Joint, couple: Array) -> None:
    """Add a couple on a joint's link b, and its reverse on link a."""
    for link, sign in ((joint.b.link, 1.0), (joint.a.link, -1.0)):
        slot = unit.slot(link)
        if slot is not None:
            stack[:, slot, 3:] += sign * couple


def _slides(unit: UnitMotion, joint: Joint) -> list[Array]:
    """Return the directions in which a joint slides, (n, 3) each."""
    return [unit.direction(joint.a, COLUMN[axis]) for axis in KINDS[joint.kind].slides]


def _spin(unit: UnitMotion, joint: Joint) -> Array:
    """Return the spin of a joint's link b against its link a, (n, 3)."""
    return unit.spin(joint.b.link) - unit.spin(joint.a.link)


def _axis_rates(first: Array, second: Array, spin: Array) -> tuple[Array, Array]:
    """Return p and q of spin = p first + q second, (n,) each."""
    c, p, q = dot(first, second), dot(first, spin), dot(second, spin)
    s2 = 1.0 - c**2
    return (p - c * q) / s2, (q - c * p) / s2


def _about(first: Array, second: Array, p: Array, q: Array) -> Array:
    """Return the couple in the plane of two axes that does the work of p about one and q about the other."""
    c = dot(first, second)
    s2 = 1.0 - c**2
    x, y = (p - c * q) / s2, (q - c * p) / s2
    return x[:, None] * first + y[:, None] * second
