"""Motors: the torque on the crank at a crank speed."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE

# a gear ratio beyond this, or below its inverse, is a slip too: its square goes with a torque
STEEPEST = 1e9


@dataclass(frozen=True, slots=True)
class ConstantTorque:
    """The same torque at every speed.

    Attributes:
        value: in [N m], positive in the direction of rising crank angle.
    """

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return np.full_like(np.asarray(speed, dtype=np.float64), self.value)

    @property
    def derivative(self) -> float:
        """How the torque changes with speed, in [N m s]."""
        return 0.0

    @property
    def no_load(self) -> float:
        """The speed at which the torque vanishes, in [rad/s]: none."""
        return np.inf


@dataclass(frozen=True, slots=True)
class TorqueSpeedLine:
    """A straight line T = T0 (1 - w / w0) from stall to no load; beyond them it brakes.

    Attributes:
        stall: torque T0 at rest in [N m].
        no_load: speed w0 at which the torque vanishes in [rad/s]; of the same sign as the torque.
    """

    stall: float
    no_load: float

    def __post_init__(self) -> None:
        _require_finite(self)
        if not self.stall * self.no_load > 0.0:
            raise InputError(
                f"motor with stall torque {self.stall} N m and no-load speed {self.no_load} rad/s drives "
                "nothing; give both above 0, or both below for a motor that turns backwards"
            )

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return self.stall + self.derivative * np.asarray(speed, dtype=np.float64)

    @property
    def derivative(self) -> float:
        """How the torque changes with speed, in [N m s]."""
        return -self.stall / self.no_load


@dataclass(frozen=True, slots=True)
class DCMotor:
    """A direct-current motor on the crank: T = K (U - K w) / R; its inductance is left out.

    Attributes:
        voltage: U in [V].
        resistance: of the armature, R in [ohm].
        constant: K in [N m/A], which is also [V s/rad].
    """

    voltage: float
    resistance: float
    constant: float

    def __post_init__(self) -> None:
        _require_finite(self)
        for name, unit in (("resistance", "ohm"), ("constant", "N m/A")):
            if not getattr(self, name) > 0.0:
                raise InputError(f"motor {name} is {getattr(self, name)} {unit}; give one above 0")

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return self.constant * self.current(speed)

    def current(self, speed: ArrayLike) -> Array:
        """Return the armature current at crank speeds in [rad/s], (n,) in [A]."""
        return (self.voltage - self.constant * np.asarray(speed, dtype=np.float64)) / self.resistance

    @property
    def derivative(self) -> float:
        """How the torque changes with speed, in [N m s]."""
        return -(self.constant**2) / self.resistance

    @property
    def no_load(self) -> float:
        """The speed at which the torque vanishes, in [rad/s]."""
        return self.voltage / self.constant


PlainMotor = ConstantTorque | TorqueSpeedLine | DCMotor


@dataclass(frozen=True, slots=True)
class Geared:
    """A motor that turns `ratio` times as fast as the crank and drives it through a gear without losses.

    The rotor's own inertia is left out; as part of a flywheel on the crank it is ratio squared times as
    large.

    Attributes:
        motor: what the gear is driven by.
        ratio: turns of the motor per turn of the crank; negative where they turn opposite ways.
    """

    motor: PlainMotor
    ratio: float

    def __post_init__(self) -> None:
        if not 1.0 / STEEPEST <= abs(self.ratio) <= STEEPEST:
            raise InputError(
                f"gear ratio of the motor is {self.ratio}; give one from {1.0 / STEEPEST:g} to "
                f"{STEEPEST:g} either way"
            )

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return self.ratio * self.motor.torque(self.ratio * np.asarray(speed, dtype=np.float64))

    @property
    def derivative(self) -> float:
        """How the torque on the crank changes with the crank's speed, in [N m s]."""
        return self.ratio**2 * self.motor.derivative

    @property
    def no_load(self) -> float:
        """The crank speed at which the torque vanishes, in [rad/s]."""
        return self.motor.no_load / self.ratio


Motor = PlainMotor | Geared


def _require_finite(motor: PlainMotor) -> None:
    for parameter in fields(motor):
        value = getattr(motor, parameter.name)
        if not abs(value) < HUGE:
            raise InputError(
                f"motor {parameter.name.replace('_', ' ')} is {value}; "
                f"give a finite number, below {HUGE:g} either way"
            )
