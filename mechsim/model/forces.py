"""What acts on a mechanism: gravity, friction, springs, loads, flywheel, motor. Data only.

Both methods read these descriptions; neither computes anything here. All vectors are in the ground
frame, SI.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.model.controllers import Controller
from mechsim.model.joint_kinds import KINDS, Kind, kinds_that
from mechsim.model.links import GROUND, ORIGIN, Vector
from mechsim.model.load_profile import LoadProfile
from mechsim.model.mechanism import Mechanism
from mechsim.model.motors import Motor
from mechsim.numerics.inputs import HUGE, number, numbers, require

# a tracked point's name, or a link ("ground" too) and a point in its frame in [m]
Location = str | tuple[str, Vector]


@dataclass(frozen=True, slots=True)
class Friction:
    """Friction in a joint; it opposes the joint's own rate.

    In a revolute or prismatic joint the torque or force on link b along the joint's axis is
    -(viscous q' + coulomb sign q'). In a cylindrical joint that is so for the sliding, and with the two
    numbers of the turning for the turning, each by itself. In a universal joint it is so about both its
    axes, each with that axis's own rate. In a spherical joint it is a couple against the relative angular
    velocity w: `-(viscous w + coulomb w / |w|)`.

    Attributes:
        joint: name of the joint.
        viscous: in [N m s] for turning, [N s/m] for sliding; 0 or more.
        coulomb: size of the dry friction in [N m] or [N], whatever the joint carries; 0 or more.
        viscous_turn: of the turning in a cylindrical joint, in [N m s].
        coulomb_turn: of the turning in a cylindrical joint, in [N m].
    """

    joint: str
    viscous: float = 0.0
    coulomb: float = 0.0
    viscous_turn: float = 0.0
    coulomb_turn: float = 0.0

    def __post_init__(self) -> None:
        for name in ("viscous", "viscous_turn"):
            _at_least_zero(f"viscous friction in joint {self.joint!r}", getattr(self, name))
        for name in ("coulomb", "coulomb_turn"):
            _at_least_zero(f"Coulomb friction in joint {self.joint!r}", getattr(self, name))

    @property
    def dry(self) -> bool:
        """Whether there is dry friction."""
        return bool(self.coulomb or self.coulomb_turn)

    def sizes(self, kind: Kind) -> list[tuple[float, float]]:
        """Return (viscous, dry) of each coordinate of a joint in their order; a ball's turning has one."""
        sliding, turning = (self.viscous, self.coulomb), (self.viscous_turn, self.coulomb_turn)
        turns = 1 if kind.ball else len(kind.turns)
        return [sliding] * len(kind.slides) + [turning if kind.mixed else sliding] * turns


@dataclass(frozen=True, slots=True)
class Spring:
    """A spring and damper on the line between two points: tension k (l - l0) + c l'.

    Attributes:
        a: one place.
        b: the other.
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
        _at_least_zero(f"stiffness {name}", self.stiffness)
        _at_least_zero(f"rest length {name}", self.rest)
        _at_least_zero(f"damping {name}", self.damping)
        if self.a == self.b:
            raise InputError(f"a spring joins {self.a} to itself; name two places")


@dataclass(frozen=True, slots=True)
class JointSpring:
    """A spring in a revolute or prismatic joint: -k (q - q0) on link b along the joint's axis.

    In a revolute joint q - q0 is taken in (-pi, pi].

    Attributes:
        joint: name of the joint.
        stiffness: k in [N m/rad] or [N/m], 0 or more.
        rest: q0, the joint's coordinate without force, in [rad] or [m].
    """

    joint: str
    stiffness: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        _at_least_zero(f"stiffness of the spring in joint {self.joint!r}", self.stiffness)
        if not abs(number(self.rest)) < HUGE:
            raise InputError(
                f"rest of the spring in joint {self.joint!r} is {self.rest}; "
                f"give a finite number, below {HUGE:g}"
            )


@dataclass(frozen=True, slots=True)
class Load:
    """A force on a point.

    Attributes:
        location: where it acts.
        force: its course, three components in the ground frame in [N].
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
        link: its name.
        moment: its course, three components in the ground frame in [N m].
    """

    link: str
    moment: LoadProfile

    def __post_init__(self) -> None:
        require(f"the couple on {self.link}", self.moment, LoadProfile)
        if self.moment.width != 3:
            raise InputError(f"the couple on {self.link} has one component; give three, in the ground frame")


@dataclass(frozen=True, slots=True, kw_only=True)
class Forces:
    """All that acts on a mechanism.

    Attributes:
        gravity: in [m/s2].
        friction: in joints.
        springs: between points.
        joint_springs: in joints.
        loads: forces on points.
        couples: moments on links.
        crank_torque: a load on the crank in [N m], positive in the direction of rising crank angle, on
            the driven joint's link b by its link a; None is none. A motor is given as `motor`.
        flywheel: moment of inertia that turns with the crank, besides the links', in [kg m2].
        motor: on the crank; its torque on the driven joint's link b, the reverse on its link a. Under
            prescribed motion it is left out: the drive torque is what a motor would have to give.
        controllers: efforts that depend on the state; they act in runs from an initial state.
    """

    gravity: Vector = (0.0, 0.0, 0.0)
    friction: tuple[Friction, ...] = ()
    springs: tuple[Spring, ...] = ()
    joint_springs: tuple[JointSpring, ...] = ()
    loads: tuple[Load, ...] = ()
    couples: tuple[Couple, ...] = ()
    crank_torque: LoadProfile | None = None
    flywheel: float = 0.0
    motor: Motor | None = None
    controllers: tuple[Controller, ...] = ()

    def __post_init__(self) -> None:
        gravity = numbers(self.gravity)
        if gravity.shape != (3,) or not (np.abs(gravity) < HUGE).all():
            raise InputError(f"gravity is {self.gravity} m/s2; give three finite numbers, below {HUGE:g}")
        object.__setattr__(self, "gravity", tuple(gravity.tolist()))
        _at_least_zero("moment of inertia of the flywheel", self.flywheel)
        if self.crank_torque is not None and self.crank_torque.width != 1:
            raise InputError("the load on the crank has three components; give its torque alone")

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError unless every joint and place named is the mechanism's, and of a kind that fits."""
        for friction in self.friction:
            name = mechanism.joint(friction.joint).kind
            if KINDS[name].dof in (0, 6):
                raise InputError(
                    f"friction is given in {name} joint {friction.joint!r}, where nothing rubs; leave it out"
                )
            if not KINDS[name].mixed and (friction.viscous_turn or friction.coulomb_turn):
                raise InputError(
                    f"friction of turning besides that of sliding is given in {name} joint "
                    f"{friction.joint!r}; only a {kinds_that(lambda kind: kind.mixed)} joint has both"
                )
        for spring in self.joint_springs:
            name = mechanism.joint(spring.joint).kind
            if not KINDS[name].single:
                raise InputError(
                    f"a spring in {name} joint {spring.joint!r} is not known; "
                    f"give it in a {kinds_that(lambda kind: kind.single)} joint"
                )
        for spring in self.springs:
            link_a, link_b = (located(mechanism, location)[0] for location in (spring.a, spring.b))
            if link_a == link_b:
                raise InputError(f"both ends of a spring are on link {link_a!r}; put them on two links")
        for load in self.loads:
            if located(mechanism, load.location)[0] == GROUND:
                raise InputError(f"the load on {load.location} acts on the frame, which it cannot move")

        for controller in self.controllers:
            controller.check(mechanism)
        for couple in self.couples:
            if located(mechanism, (couple.link, ORIGIN))[0] == GROUND:
                raise InputError("a couple acts on the frame, which it cannot turn; name a moving link")

    @property
    def courses(self) -> list[LoadProfile]:
        """The courses of all loads."""
        pushes = [load.force for load in self.loads] + [couple.moment for couple in self.couples]
        return pushes if self.crank_torque is None else [*pushes, self.crank_torque]

    def motor_torque(self, speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the motor's torque on the crank at crank speeds (n,) in [rad/s]; zeros without a motor."""
        return np.zeros(len(speed)) if self.motor is None else self.motor.torque(speed)

    def require_no_controllers(self, name: str) -> None:
        """Raise InputError where controllers are given, which have no part in a prescribed motion."""
        if self.controllers:
            raise InputError(
                f"{name}: controllers act in runs from an initial state; give one (--initial J.q=VALUE), or "
                "leave the controllers out"
            )

    def without_motor(self) -> "Forces":
        """Return the same without the motor."""
        return replace(self, motor=None)


def acting_on(source: object, forces: Forces | None) -> Forces:
    """Return the forces given; where none are, those of the source, as a file's `[forces]`, or none."""
    own = getattr(source, "forces", None) if forces is None else forces
    return Forces() if own is None else require("forces", own, Forces)


def located(mechanism: Mechanism, location: Location) -> tuple[str, Vector]:
    """Return the link of a place and the point in that link's frame in [m].

    Raises:
        InputError: for a point or link the mechanism does not have.
    """
    if isinstance(location, str):
        if location not in mechanism.points:
            raise InputError(
                f"{mechanism.name} has no point {location!r} (it has {', '.join(mechanism.points)}); "
                "name one, or give a link and a point in its frame"
            )
        return mechanism.points[location]
    link, point = location
    names = [GROUND, *(moving.name for moving in mechanism.links)]
    if link not in names:
        raise InputError(f"{mechanism.name} has no link {link!r}, only {', '.join(names)}; name one of them")
    if len(point) != 3 or not (np.abs(point) < HUGE).all():
        raise InputError(f"place {point} on link {link!r} is not three finite numbers in [m]; give x, y, z")
    return link, point


def _at_least_zero(what: str, value: float) -> None:
    if not 0.0 <= number(value) < HUGE:
        raise InputError(f"{what} is {value}; give a finite number, 0 or more, below {HUGE:g}")
