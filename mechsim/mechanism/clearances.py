"""Clearances of revolute joints: a pin that is free in a hole."""

from collections.abc import Callable
from dataclasses import dataclass

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import PLANAR, REVOLUTE
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.nonlinear_springs import SoftStop
from mechsim.numerics.arrays import HUGE, number

# contact law -> hysteresis factor h of `SoftStop` by the coefficient of restitution. Sources: Lankarani and
# Nikravesh 1990; P. Flores, M. Machado, M. T. Silva and J. M. Martins, On the continuous contact force models
# for soft materials in multibody dynamics, Multibody System Dynamics 25 (2011) 357-375
LAWS: dict[str, Callable[[float], float]] = {
    "lankarani-nikravesh": lambda e: 0.75 * (1.0 - e**2),
    "flores": lambda e: 1.6 * (1.0 - e) / e,
}


@dataclass(frozen=True, slots=True)
class Clearance:
    """A pin on side b of a joint, which is free in a hole of side a across the joint's axis.

    The centres move apart by the radius c at most. Without stiffness pin and hole collide with a coefficient
    of restitution; with it they press by a contact law on the penetration, the distance less c (`SoftStop`).
    There is no friction between them. In a prescribed motion and in statics the centres coincide.

    Attributes:
        joint: name of a revolute joint, or of a planar one.
        radius: c in [m], radius of the hole less that of the pin, above 0.
        restitution: coefficient e; None for that of the run, without stiffness.
        stiffness: k in [N/m^n], or 0 for rigid contact; see `hertz_stiffness`.
        exponent: n of the contact law.
        law: "lankarani-nikravesh" or "flores", which give the loss by e.

    Example: `Forces(clearances=(Clearance("pin", 0.5e-3, restitution=0.9),))`
    """

    joint: str
    radius: float
    restitution: float | None = None
    stiffness: float = 0.0
    exponent: float = 1.5
    law: str = "lankarani-nikravesh"

    def __post_init__(self) -> None:
        what, e = f"clearance of joint {self.joint!r}", self.restitution
        if not 0.0 < number(self.radius) < HUGE:
            raise InputError(
                f"{what} has the radius {self.radius} m; give one above 0, the hole's less the pin's"
            )
        if e is not None and not 0.0 <= number(e) <= 1.0:
            raise InputError(f"{what} has the restitution {e}; give 0 to 1")
        if not 0.0 <= number(self.stiffness) < HUGE:
            raise InputError(f"{what} has the stiffness {self.stiffness}; give one above 0, or none")
        if not 1.0 <= number(self.exponent) <= 3.0:
            raise InputError(f"{what} has the exponent {self.exponent}; give 1 to 3, or 1.5 as by Hertz")
        if self.law not in LAWS:
            raise InputError(f"{what} has the law {self.law!r}; choose from {', '.join(LAWS)}")
        if self.stiffness and (e is None or (e == 0.0 and self.law == "flores")):
            raise InputError(f"{what} has a stiffness and the restitution {e}; give one above 0, 1 at most")
        if not self.stiffness and (self.exponent, self.law) != (1.5, "lankarani-nikravesh"):
            raise InputError(f"{what} has a contact law without stiffness; give it, or leave the law out")

    @property
    def contact(self) -> SoftStop:
        """The contact law between the centres of hole and pin."""
        h = LAWS[self.law](self.restitution or 0.0)
        return SoftStop(self.radius, 1.0, self.stiffness, 0.0, self.exponent, h)

    def check(self, mechanism: Mechanism, used: set[str]) -> None:
        """Raise InputError unless the joint can have a clearance; `used` are coordinates that others use."""
        joint = mechanism.joint(self.joint)
        if joint.kind not in (REVOLUTE, PLANAR):
            raise InputError(
                f"clearance of {joint.kind} joint {self.joint!r}: only a pin is free in its hole; give it to "
                "a revolute joint"
            )
        used = {*used, *mechanism.drivers, *mechanism.locked}
        used.update(*(law.coordinates for law in mechanism.laws))
        if joint.kind == REVOLUTE and self.joint in used:
            raise InputError(
                f"revolute joint {self.joint!r} has a clearance, and a driver, lock, coupling, motor, spring "
                "or friction of its own; give these to another joint, or leave the clearance out"
            )


def hertz_stiffness(hole: float, pin: float, young: float, poisson: float) -> float:
    """Return the stiffness in [N/m^1.5] of a pin in a hole of the same material, as of a ball in a socket.

    k = 4 / (3 (s + s)) sqrt(R_h R_p / (R_h - R_p)) with s = (1 - nu^2) / E (Lankarani and Nikravesh 1990).
    That of 10 mm and 9.5 mm in steel, E = 207 GPa and nu = 0.3, is 6.61e10 N/m^1.5.

    Args:
        hole: radius of the hole in [m].
        pin: radius of the pin in [m].
        young: modulus of elasticity E in [N/m2].
        poisson: Poisson's ratio nu.
    """
    if not 0.0 < pin < hole:
        raise InputError(f"a pin of radius {pin:g} m is not free in a hole of {hole:g} m; give a smaller pin")
    if not (0.0 < young < HUGE and 0.0 <= poisson <= 0.5):
        raise InputError(
            f"a pin has E = {young:g} N/m2 and nu = {poisson:g}; give E above 0, nu from 0 to 0.5"
        )
    compliance = (1.0 - poisson**2) / young
    return 4.0 / (6.0 * compliance) * (hole * pin / (hole - pin)) ** 0.5
