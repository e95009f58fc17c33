"""Motions of many designs over the same poses, and their quantities by name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joint_kinds import FIXED, KINDS
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.subjects.toml_values import suggestion

AXES = "xyz"
RATES = {"": "position", "v": "velocity", "a": "acceleration"}
ORDERS = {"q": "value", "v": "rate", "a": "acceleration"}
PER = {"": "", "q": "", "v": "/s", "a": "/s2"}
# of what a joint transmits
WRENCH = {"force": ("fx", "fy", "fz"), "moment": ("mx", "my", "mz")}
# what needs the transmission angle's own formula
TRANSMISSION = "transmission"


@dataclass(frozen=True, slots=True)
class TurnQuantity:
    """A quantity over a turn.

    Attributes:
        name: as requested.
        kind: "joint", "point", "transmission" or "effort".
        subject: joint coordinate, point, or column of efforts.
        component: of a joint "q", "v" or "a"; of a point "", "v" or "a" and perhaps an axis; of efforts which
            components are put together.
        unit: in SI.
    """

    name: str
    kind: str
    subject: str
    component: str
    unit: str

    @property
    def angle(self) -> bool:
        """Whether it is an angle to unwrap from pose to pose."""
        return self.kind == "joint" and self.component == "q" and self.unit == "rad"

    @property
    def rated(self) -> bool:
        """Whether velocities or accelerations are needed."""
        return self.kind in ("joint", "point") and self.component[:1] in ("v", "a")


@dataclass(frozen=True)
class Turns:
    """Motions of designs over the same row of poses.

    Attributes:
        designs: how many.
        poses: of each.
        motion: at designs x poses instants, one design after another.
        efforts: column -> (designs, poses): torques and reactions, where they were asked for.
        transmission: transmission angles, (designs, poses) in [rad], where they were asked for.
        facts: "crank_range", "dead_centres", "assemblies" -> (designs,), where they were asked for.
    """

    designs: int
    poses: int
    motion: Motion
    efforts: Mapping[str, Array] = field(default_factory=dict[str, Array])
    transmission: Array | None = None
    facts: Mapping[str, Array] = field(default_factory=dict[str, Array])

    def values(self, quantity: TurnQuantity) -> Array:
        """Return a quantity, (designs, poses)."""
        shape = (self.designs, self.poses)
        if quantity.kind == "transmission":
            assert self.transmission is not None
            return self.transmission
        if quantity.kind == "effort":
            if not quantity.component:
                return self.efforts[quantity.subject]
            components = [
                self.efforts[f"{quantity.subject}.{axis_name}"] for axis_name in WRENCH[quantity.component]
            ]
            return np.sqrt(sum(component**2 for component in components))
        if quantity.kind == "joint":
            values = getattr(self.motion.joints[quantity.subject], ORDERS[quantity.component]).reshape(shape)
            return unwrapped(values) if quantity.angle else values
        order, axis = quantity.component.rstrip(AXES), quantity.component.lstrip("va")
        vectors = getattr(self.motion.points[quantity.subject], RATES[order])
        if axis:
            return vectors[:, AXES.index(axis)].reshape(shape)
        return np.sqrt((vectors**2).sum(1)).reshape(shape)


def unwrapped(values: Array) -> Array:
    """Return unwrapped angles (designs, poses)."""
    steps = np.diff(values, axis=1)
    revolutions = np.round(steps / (2.0 * np.pi))
    if not revolutions.any():
        return values
    out = values.copy()
    out[:, 1:] -= 2.0 * np.pi * np.cumsum(revolutions, axis=1)
    return out


def quantity(name: str, mechanism: Mechanism) -> TurnQuantity:
    """Return the quantity of a name.

    Known are a joint's coordinate (rocker, rocker.v, rocker.a), a point's (P3.x, P3.vy, P3.az), its speed
    and acceleration (speed:P3, acceleration:P3, or P3.v, P3.a where no joint is called so), torque of the
    drive, torque:J of one of several, force:J and moment:J that a joint transmits, their components J.fx to
    J.mz, and transmission, the transmission angle.

    Raises:
        InputError: for any other, with the nearest one.
    """
    result = _joint(name, mechanism) or _point(name, mechanism) or _effort(name, mechanism)
    if result is None and name == TRANSMISSION:
        result = TurnQuantity(name, "transmission", "", "", "rad")
    if result is None:
        known = _known(mechanism)
        raise InputError(f"{mechanism.name} has no quantity {name!r}{suggestion(name, known)}")
    return result


def joint_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the unit of each joint coordinate that motions contain."""
    return {
        coordinate: "m" if unit == "m" else "rad"
        for joint in mechanism.joints
        if joint.kind != FIXED and KINDS[joint.kind].single
        for coordinate, unit in zip(joint.coordinates, KINDS[joint.kind].units, strict=False)
    }


def _known(mechanism: Mechanism) -> list[str]:
    points = [f"{name}.{axis}" for name in mechanism.points for axis in AXES]
    speeds = [f"{word}:{name}" for name in mechanism.points for word in ("speed", "acceleration")]
    return [*joint_units(mechanism), *points, *speeds, "torque", TRANSMISSION]


def _joint(name: str, mechanism: Mechanism) -> TurnQuantity | None:
    units = joint_units(mechanism)
    own, dot, component = name.rpartition(".")
    if name in units:
        own, component = name, "q"
    elif not dot or own not in units or component not in ORDERS:
        return None
    return TurnQuantity(name, "joint", own, component, units[own] + PER[component])


def _point(name: str, mechanism: Mechanism) -> TurnQuantity | None:
    word, colon, own = name.partition(":")
    if colon and word in ("speed", "acceleration") and own in mechanism.points:
        component = word[0].replace("s", "v")
        return TurnQuantity(name, "point", own, component, "m" + PER[component])
    own, _, component = name.rpartition(".")
    order = component[:1] if component[:1] in ("v", "a") else ""
    axis = component[len(order) :]
    if own not in mechanism.points or (axis not in AXES if axis else not order) or len(axis) > 1:
        return None
    return TurnQuantity(name, "point", own, component, "m" + PER[order])


def _effort(name: str, mechanism: Mechanism) -> TurnQuantity | None:
    joints = [joint.name for joint in mechanism.joints]
    if name == "torque":
        return TurnQuantity(name, "effort", "torque", "", "N m")
    word, colon, own = name.partition(":")
    if colon and word in WRENCH and own in joints:
        return TurnQuantity(name, "effort", own, word, "N" if word == "force" else "N m")
    if colon and word == "torque" and own in (*mechanism.drivers, *mechanism.locked):
        single = mechanism.has_crank and own == mechanism.crank.name
        unit = "N" if own in mechanism.straight else "N m"
        return TurnQuantity(name, "effort", "torque" if single else f"drive {own}", "", unit)
    own, _, component = name.rpartition(".")
    if own in joints and any(component in components for components in WRENCH.values()):
        return TurnQuantity(name, "effort", name, "", "N" if component in WRENCH["force"] else "N m")
    return None


def names_of(quantities: Sequence[TurnQuantity]) -> list[str]:
    """Return the names of quantities."""
    return [quantity.name for quantity in quantities]
