"""Forces on a mechanism: gravity, friction, springs, loads, flywheel, motor. Data only.

Both methods read these descriptions. Vectors are in the ground frame, in SI.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError, first_names
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS, kinds_that
from mechsim.mechanism.links import GROUND, ORIGIN, Vector
from mechsim.mechanism.load_profile import LoadProfile
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import HUGE, at_least_zero, number, numbers, require

if TYPE_CHECKING:
    from mechsim.mechanism.actuators import Actuator
    from mechsim.mechanism.clearances import Clearance
    from mechsim.mechanism.motors import Controller, Motor
    from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring

# name of a tracked point, or a link ("ground" too) and a point in its frame in [m]
LinkPoint = tuple[str, Vector]
Location = str | LinkPoint


@dataclass(frozen=True, slots=True)
class Spring:
    """A spring and damper on the line between two points: tension k (l - l0) + c l'.

    Attributes:
        a: first end.
        b: second end.
        stiffness: k in [N/m], 0 or more.
        rest: length l0 without tension from the spring in [m], 0 or more.
        damping: c in [N s/m], 0 or more.
    """

    a: Location
    b: Location
    stiffness: float
    rest: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        name = f"of the spring between {self.a} and {self.b}"
        for what, value in (
            ("stiffness", self.stiffness),
            ("rest length", self.rest),
            ("damping", self.damping),
        ):
            at_least_zero(f"{what} {name}", value)
        if self.a == self.b:
            raise InputError(f"a spring joins {self.a} to itself; name two different points")


@dataclass(frozen=True, slots=True)
class JointSpring:
    """A spring in a revolute or prismatic joint: -k (q - q0) on link b along the joint's axis.

    The coordinate q counts revolutions.

    Attributes:
        joint: name of the joint.
        stiffness: k in [N m/rad] or [N/m], 0 or more.
        rest: q0, the unloaded coordinate, in [rad] or [m].
    """

    joint: str
    stiffness: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        at_least_zero(f"stiffness of the spring in joint {self.joint!r}", self.stiffness)
        if not abs(number(self.rest)) < HUGE:
            raise InputError(
                f"rest of the spring in joint {self.joint!r} is {self.rest}; "
                f"give a finite number, below {HUGE:g}"
            )


@dataclass(frozen=True, slots=True)
class Load:
    """A force on a point.

    Attributes:
        location: point on which it acts.
        force: load profile with three components in the ground frame in [N].
    """

    location: Location
    force: LoadProfile

    def __post_init__(self) -> None:
        require(f"the load on {self.location}", self.force, LoadProfile)
        if self.force.width != 3:
            raise InputError(
                f"the load on {self.location} has one component; give three, in the ground frame"
            )


@dataclass(frozen=True, slots=True)
class Couple:
    """A moment on a link.

    Attributes:
        link: name of the link.
        moment: load profile with three components in the ground frame in [N m].
    """

    link: str
    moment: LoadProfile

    def __post_init__(self) -> None:
        require(f"the couple on {self.link}", self.moment, LoadProfile)
        if self.moment.width != 3:
            raise InputError(f"the couple on {self.link} has one component; give three, in the ground frame")


@dataclass(frozen=True, slots=True, kw_only=True)
class Forces:
    """All forces on a mechanism.

    Attributes:
        gravity: in [m/s2].
        friction: friction in joints.
        springs: springs between points.
        joint_springs: springs in joints.
        nonlinear_springs: springs with a law of their own, such as stops.
        bushings: elastic mounts between frames on two links.
        clearances: joints whose pins are free in their holes in runs from an initial state.
        loads: forces on points.
        couples: moments on links.
        crank_torque: load on the crank in [N m], positive for increasing crank angle, exerted on the driven
            joint's link b by its link a; None for no load. A motor belongs in `motor`.
        flywheel: moment of inertia that rotates with the crank, in addition to the links', in [kg m2].
        motor: motor of the crank; its torque acts on the driven joint's link b, the opposite on link a. A
            prescribed motion ignores it: the drive torque is the torque that a motor would have to supply.
        controllers: forces that depend on the state; they act in runs from an initial state.
        actuators: actuators with controls. A prescribed motion ignores those in `replaced_by`.
        armature: coordinate -> moment of inertia or mass that moves with it, such as a rotor's.
    """

    gravity: Vector = (0.0, 0.0, 0.0)
    friction: tuple[Friction, ...] = ()
    springs: tuple[Spring, ...] = ()
    joint_springs: tuple[JointSpring, ...] = ()
    nonlinear_springs: tuple[NonlinearSpring, ...] = ()
    bushings: tuple[Bushing, ...] = ()
    clearances: tuple[Clearance, ...] = ()
    loads: tuple[Load, ...] = ()
    couples: tuple[Couple, ...] = ()
    crank_torque: LoadProfile | None = None
    flywheel: float = 0.0
    motor: Motor | None = None
    controllers: tuple[Controller, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    armature: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        gravity = numbers(self.gravity)
        if gravity.shape != (3,) or not (np.abs(gravity) < HUGE).all():
            raise InputError(f"gravity is {self.gravity} m/s2; give three finite numbers, below {HUGE:g}")
        object.__setattr__(self, "gravity", tuple(gravity.tolist()))
        at_least_zero("moment of inertia of the flywheel", self.flywheel)
        if self.crank_torque is not None and self.crank_torque.width != 1:
            raise InputError("the load on the crank has three components; give its torque alone")

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError unless all joints, points and links exist and their kinds fit."""
        for friction in self.friction:
            friction.check(mechanism.joint(friction.joint))
        for spring in self.joint_springs:
            name = mechanism.joint(spring.joint).kind
            if not KINDS[name].single:
                raise InputError(
                    f"a spring in {name} joint {spring.joint!r} is not supported; "
                    f"give it in a {kinds_that(lambda kind: kind.single)} joint"
                )
        self._check_ends(mechanism)
        used = {item.joint for item in self.friction}
        for clearance in self.clearances:
            clearance.check(mechanism, {*used, *self.controlled, *self.sprung})
        for controller in (*self.controllers, *self.actuators):
            controller.check(mechanism)
        acting: dict[str, Location] = {f"load on {load.location}": load.location for load in self.loads}
        acting |= {f"couple on {couple.link}": (couple.link, ORIGIN) for couple in self.couples}
        for what, location in acting.items():
            if located(mechanism, location)[0] == GROUND:
                raise InputError(f"the {what} acts on the frame, which cannot move; name a moving link")

    def _check_ends(self, mechanism: Mechanism) -> None:
        """Raise InputError unless the ends of forces between points and frames lie on links."""
        lines = [("a spring", (spring.a, spring.b)) for spring in self.springs]
        lines += [(f"actuator {acting.name!r}", acting.ends) for acting in self.actuators if acting.ends]
        for what, ends in lines:
            links = [located(mechanism, location)[0] for location in ends]
            if links[0] == links[1]:
                raise InputError(f"both ends of {what} are on link {links[0]!r}; put them on two links")
        for bushing in self.bushings:
            for end in (bushing.a, bushing.b):
                located(mechanism, (end.link, end.point))

    @property
    def load_profiles(self) -> list[LoadProfile]:
        """The load profiles of all loads."""
        acts = [load.force for load in self.loads] + [couple.moment for couple in self.couples]
        return acts if self.crank_torque is None else [*acts, self.crank_torque]

    def motor_torque(self, speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the motor torque on the crank at crank speeds (n,) in [rad/s]; zeros without a motor."""
        return np.zeros(len(speed)) if self.motor is None else self.motor.torque(speed)

    def require_no_controllers(self, name: str) -> None:
        """Raise InputError if there are controllers, which a prescribed motion cannot use."""
        if self.controllers:
            raise InputError(
                f"{name}: controllers act in runs from an initial state; give one (--initial J.q=VALUE), or "
                "leave the controllers out"
            )

    def under_drivers(self, driven: Collection[str]) -> Forces:
        """Return the same forces without those in `replaced_by`, which a prescribed motion ignores."""
        acting = (each for each in self.actuators if each.by_motion and not each.replaced(driven))
        acting = tuple(replace(each, inertia=0.0) for each in acting)
        return replace(self, motor=None, actuators=acting, armature={})

    def replaced_by(self, driven: Collection[str]) -> list[str]:
        """What drivers replace, or their motion does not determine, in a few words each."""
        others = [each for each in self.actuators if not each.replaced(driven)]
        present = {
            "the motor": ["motor"] if self.motor else [],
            "the actuators {}": [each.name for each in self.actuators if each.replaced(driven)],
            "the undetermined force of {}": [each.name for each in others if not each.by_motion],
            "the rotors of {}": [each.name for each in others if each.inertia and each.by_motion],
            "the armature of {}": [*self.armature],
        }
        return [text.format(", ".join(names)) for text, names in present.items() if names]

    @property
    def controlled(self) -> set[str]:
        """Coordinates that controllers and actuators read or act on, and those with an armature."""
        names = {name for controller in self.controllers for name in controller.coordinates}
        return names | {name for actuator in self.actuators for name in actuator.gear} | {*self.armature}

    @property
    def uncut(self) -> set[str]:
        """Coordinates at which no loop is cut: the controlled, and of springs, which count revolutions."""
        return self.controlled | {*self.sprung}

    @property
    def stop_ranges(self) -> dict[str, tuple[float, float]]:
        """Coordinate -> its range between soft stops, infinite where there is none."""
        if not self.nonlinear_springs:
            return {}
        from mechsim.mechanism.nonlinear_springs import SoftStop

        ranges: dict[str, tuple[float, float]] = {}
        for spring in self.nonlinear_springs:
            if isinstance(spring.ends, str) and isinstance(spring.law, SoftStop):
                low, high = ranges.get(spring.ends, (-np.inf, np.inf))
                upper = spring.law.side > 0.0
                ranges[spring.ends] = (low, spring.law.limit) if upper else (spring.law.limit, high)
        return ranges

    @property
    def sprung(self) -> list[str]:
        """Coordinates along which springs act."""
        nonlinear = [spring.ends for spring in self.nonlinear_springs if isinstance(spring.ends, str)]
        return [*nonlinear, *(spring.joint for spring in self.joint_springs)]


def forces_of(source: object, forces: Forces | None = None) -> Forces:
    """Return `forces`; if None, those of the source, such as the `[forces]` of a file, or else weight."""
    own = getattr(source, "forces", None) if forces is None else forces
    return WEIGHT if own is None else require("forces", own, Forces)


def located(mechanism: Mechanism, location: Location) -> tuple[str, Vector]:
    """Return the link of a location and the point in that link's frame in [m].

    Raises:
        InputError: for a point or link the mechanism does not have.
    """
    if isinstance(location, str):
        if location not in mechanism.points:
            raise InputError(
                f"{mechanism.name} has no point {location!r} (it has {first_names(mechanism.points)}); "
                "name one, or give a link and a point in its frame"
            )
        return mechanism.points[location]
    link, point = location
    if link not in mechanism.link_names:
        names = first_names(mechanism.link_names)
        raise InputError(f"{mechanism.name} has no link {link!r}, only {names}; name one of them")
    if len(point) != 3 or not (np.abs(point) < HUGE).all():
        raise InputError(
            f"position {point} on link {link!r} is not three finite numbers in [m]; give x, y, z"
        )
    return link, point


# forces on a mechanism for which none are stated: MuJoCo's default gravity, along -y
WEIGHT = Forces(gravity=(0.0, -9.81, 0.0))
