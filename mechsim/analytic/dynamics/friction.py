"""Friction in joints of every kind: the rates it opposes, and the wrenches it puts on the links."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics.unit_motion import UnitMotion, cross, dot
from mechsim.model.forces import Friction
from mechsim.model.mechanism import Joint

Array = NDArray[np.float64]

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
    def way(self) -> Array:
        """Sign of the rate, 0 where the joint turns round, (n,)."""
        return np.where(self.still, 0.0, np.sign(self.rate))


def dry_sizes(joint: Joint, friction: Friction) -> list[float]:
    """Return the sizes of a joint's dry frictions, those above zero, in the order of `dry`."""
    sizes = {"cylindrical": (friction.coulomb, friction.coulomb_turn), "universal": (friction.coulomb,) * 2}
    return [size for size in sizes.get(joint.kind, (friction.coulomb,)) if size]


def dry(unit: UnitMotion, friction: Friction) -> list[Dry]:
    """Return each dry friction of a joint; a spherical joint's rate is the size of its relative spin."""
    joint = unit.mechanism.joint(friction.joint)
    spin = unit.spin(joint.b.link) - unit.spin(joint.a.link)
    if joint.kind == "spherical":
        rates = [np.sqrt(dot(spin, spin))]
    elif joint.kind == "universal":
        rates = list(_axis_rates(unit.axis(joint, "a"), unit.axis(joint, "b"), spin))
    elif joint.kind == "cylindrical":
        sizes = friction.coulomb, friction.coulomb_turn
        both = slide_rate(unit, joint), turn_rate(unit, joint)
        rates = [rate for size, rate in zip(sizes, both, strict=True) if size]
    else:
        rates = [joint_rate(unit, joint)]
    slides = joint.kind == "prismatic" or (joint.kind == "cylindrical" and friction.coulomb > 0.0)
    lengths = [unit.mechanism.size if slides and i == 0 else 1.0 for i in range(len(rates))]
    return [
        Dry(size, rate, np.abs(rate) <= STILL * length)
        for size, rate, length in zip(dry_sizes(joint, friction), rates, lengths, strict=False)
    ]


def joint_rate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the derivative of a revolute or prismatic joint's coordinate by the crank angle, (n,)."""
    return turn_rate(unit, joint) if joint.kind == "revolute" else slide_rate(unit, joint)


def turn_rate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the rate at which link b turns about the joint's axis, (n,)."""
    return dot(unit.axis(joint), unit.spin(joint.b.link) - unit.spin(joint.a.link))


def slide_rate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the rate at which b's point slides along the joint's axis, (n,) in [m/rad]."""
    place_a, rate_a = unit.point(joint.a.link, joint.a.point)
    place_b, rate_b = unit.point(joint.b.link, joint.b.point)
    return dot(unit.axis(joint), rate_b - rate_a - cross(unit.spin(joint.a.link), place_b - place_a))


def add_friction(unit: UnitMotion, damping: Array, coulomb: Array, friction: Friction) -> None:
    """Add a joint's friction to wrenches: viscous at unit crank speed, dry while the crank turns forwards."""
    joint = unit.mechanism.joint(friction.joint)
    kind, axis = joint.kind, unit.axis(joint)
    ways = [part.size * part.way for part in dry(unit, friction)]
    if kind in ("revolute", "prismatic"):
        add_joint_effort(unit, damping, joint, -friction.viscous * joint_rate(unit, joint))
        for way in ways:
            add_joint_effort(unit, coulomb, joint, -way)
        return
    if kind == "cylindrical":
        add_slide_effort(unit, damping, joint, -friction.viscous * slide_rate(unit, joint))
        turn = -friction.viscous_turn * turn_rate(unit, joint)
        add_couple(unit, damping, joint, turn[:, None] * axis)
        if friction.coulomb:
            add_slide_effort(unit, coulomb, joint, -ways[0])
        if friction.coulomb_turn:
            add_couple(unit, coulomb, joint, -ways[-1][:, None] * axis)
        return
    spin = unit.spin(joint.b.link) - unit.spin(joint.a.link)
    if kind == "universal":
        axes = unit.axis(joint, "a"), unit.axis(joint, "b")
        add_couple(unit, damping, joint, -friction.viscous * _about(*axes, *_axis_rates(*axes, spin)))
        if ways:
            add_couple(unit, coulomb, joint, -_about(*axes, *ways))
        return
    add_couple(unit, damping, joint, -friction.viscous * spin)
    for way in ways:
        fast = np.sqrt(dot(spin, spin))
        add_couple(unit, coulomb, joint, -way[:, None] * spin / np.where(fast > 0.0, fast, 1.0)[:, None])


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


def add_joint_effort(unit: UnitMotion, stack: Array, joint: Joint, effort: Array) -> None:
    """Add a torque or force on link b along the axis of a revolute or prismatic joint."""
    if joint.kind == "revolute":
        add_couple(unit, stack, joint, effort[:, None] * unit.axis(joint))
    else:
        add_slide_effort(unit, stack, joint, effort)


def add_slide_effort(unit: UnitMotion, stack: Array, joint: Joint, effort: Array) -> None:
    """Add a force on link b along a joint's axis at b's point, and its reverse on link a there."""
    along = effort[:, None] * unit.axis(joint)
    place, _ = unit.point(joint.b.link, joint.b.point)
    add_force(unit, stack, joint.b.link, place, along)
    add_force(unit, stack, joint.a.link, place, -along)


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
