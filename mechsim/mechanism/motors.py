"""Motors: torque on the crank as a function of its speed; controllers: forces as expressions of the state."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError, first_names
from mechsim.mechanism.expressions import Expression, Instruction, compiled
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import HUGE, Array

# value or rate of a coordinate, such as crank.q or P.x.v; not a number such as 2.5
_STATE = re.compile(r"(?<![\w.])([^\W\d][\w.]*)\.(q|v)(?![\w.])")


@dataclass(frozen=True)
class Controller:
    """A force or torque on a coordinate that depends on the state and the time.

    Attributes:
        coordinate: name of the coordinate it acts on.
        text: torque in [N m] or force in [N], an expression of the coordinates `J.q` in [rad] or [m], their
            rates `J.v` per second and the time `t` in [s].
        inputs: pairs (coordinate, "q" or "v") that the expression reads.

    Raises:
        InputError: if the text is not such an expression.

    Example:
        >>> import mechsim as ms
        >>> ms.Controller("crank", "-20*(crank.q - 0.5) - 2*crank.v")
        Controller(coordinate='crank', text='-20*(crank.q - 0.5) - 2*crank.v')
    """

    coordinate: str
    text: str
    inputs: tuple[tuple[str, str], ...] = field(init=False, repr=False, compare=False)
    _expression: Expression = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        inputs = tuple(dict.fromkeys((match[1], match[2]) for match in _STATE.finditer(self.text)))
        names = {pair: f"state_{k}_" for k, pair in enumerate(inputs)}
        text = _STATE.sub(lambda match: names[match[1], match[2]], self.text)
        try:
            expression = compiled(text, ("t", *names.values()))
        except InputError as error:
            raise InputError(
                f"the controller of {self.coordinate}, {self.text!r}, {error}; "
                "write an expression of J.q, J.v and t"
            ) from None
        object.__setattr__(self, "inputs", inputs)
        object.__setattr__(self, "_expression", expression)

    @property
    def varies(self) -> bool:
        """Whether it depends on the time."""
        return "t" in self._expression.names

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """The evaluation of its expression, in which the k-th input is named `state_k_`."""
        return self._expression.instructions

    @property
    def coordinates(self) -> set[str]:
        """Names of the coordinates that it reads or acts on."""
        return {self.coordinate, *(name for name, _ in self.inputs)}

    def effort(self, values: Mapping[str, Array], rates: Mapping[str, Array], time: Array) -> Array:
        """Return the torque [N m] or force [N] at coordinates and rates in SI and times in [s], (n,) each.

        Complex steps of coordinates and rates are propagated.
        """
        variables = {
            f"state_{k}_": (values if letter == "q" else rates)[name]
            for k, (name, letter) in enumerate(self.inputs)
        }
        return self._expression.stepped(variables | {"t": time}, len(time))

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError if the mechanism lacks one of the coordinates."""
        for name in sorted(self.coordinates):
            if name not in mechanism.coordinates:
                raise InputError(
                    f"the controller of {self.coordinate} names {name!r}, which is no coordinate of "
                    f"{mechanism.name}; it has {first_names(mechanism.coordinates)}"
                )


# largest gear ratio, and inverse of the smallest; others are input errors, and their squares overflow
MAX_RATIO = 1e9


@dataclass(frozen=True, slots=True)
class ConstantTorque:
    """A constant torque.

    Attributes:
        value: in [N m], positive for increasing crank angle.
    """

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return np.full(np.shape(speed), self.value)

    @property
    def derivative(self) -> float:
        """Derivative of the torque by the speed, in [N m s]."""
        return 0.0

    @property
    def no_load(self) -> float:
        """Speed of zero torque, in [rad/s]: infinite."""
        return np.inf


@dataclass(frozen=True, slots=True)
class TorqueSpeedLine:
    """A straight torque-speed line T = T0 (1 - w / w0); beyond the no-load speed it brakes.

    Attributes:
        stall: torque T0 at rest in [N m].
        no_load: speed w0 of zero torque in [rad/s]; it has the sign of the torque.
    """

    stall: float
    no_load: float

    def __post_init__(self) -> None:
        _require_finite(self)
        if not self.stall * self.no_load > 0.0:
            raise InputError(
                f"motor with stall torque {self.stall} N m and no-load speed {self.no_load} rad/s drives "
                "nothing; give both above 0, or both below 0 for a motor that rotates backwards"
            )

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return self.stall + self.derivative * np.asarray(speed)

    @property
    def derivative(self) -> float:
        """Derivative of the torque by the speed, in [N m s]."""
        return -self.stall / self.no_load


@dataclass(frozen=True, slots=True)
class DCMotor:
    """A direct-current motor on the crank: T = K (U - K w) / R, without inductance.

    Attributes:
        voltage: voltage U in [V].
        resistance: resistance R of the armature in [ohm].
        constant: motor constant K in [N m/A], which equals [V s/rad].
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
        return (self.voltage - self.constant * np.asarray(speed)) / self.resistance

    @property
    def derivative(self) -> float:
        """Derivative of the torque by the speed, in [N m s]."""
        return -(self.constant**2) / self.resistance

    @property
    def no_load(self) -> float:
        """Speed of zero torque, in [rad/s]."""
        return self.voltage / self.constant


PlainMotor = ConstantTorque | TorqueSpeedLine | DCMotor


@dataclass(frozen=True, slots=True)
class Geared:
    """A motor that drives the crank through a gear without losses.

    The inertia of the rotor is not included; add ratio squared times its inertia to the flywheel.

    Attributes:
        motor: the motor before the gear.
        ratio: revolutions of the motor per revolution of the crank; negative for opposite directions.
    """

    motor: PlainMotor
    ratio: float

    def __post_init__(self) -> None:
        if not 1.0 / MAX_RATIO <= abs(self.ratio) <= MAX_RATIO:
            raise InputError(
                f"gear ratio of the motor is {self.ratio}; give a magnitude from {1.0 / MAX_RATIO:g} to "
                f"{MAX_RATIO:g}"
            )

    def torque(self, speed: ArrayLike) -> Array:
        """Return the torque on the crank at crank speeds in [rad/s], (n,) in [N m]."""
        return self.ratio * self.motor.torque(self.ratio * np.asarray(speed))

    @property
    def derivative(self) -> float:
        """Derivative of the torque on the crank by the crank's speed, in [N m s]."""
        return self.ratio**2 * self.motor.derivative

    @property
    def no_load(self) -> float:
        """Crank speed of zero torque, in [rad/s]."""
        return self.motor.no_load / self.ratio


Motor = PlainMotor | Geared


def _require_finite(motor: PlainMotor) -> None:
    for parameter in fields(motor):
        value = getattr(motor, parameter.name)
        if not abs(value) < HUGE:
            raise InputError(
                f"motor {parameter.name.replace('_', ' ')} is {value}; "
                f"give a finite number with a magnitude below {HUGE:g}"
            )
