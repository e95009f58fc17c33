"""Actuators: forces on joint coordinates, or on the line between two points, from a control.

One linear form covers MuJoCo's actuators (motor, position, velocity, intvelocity, damper, general) and the
motors of a TOML file (constant, line, dc, pd, pid). With the control u and the coordinates q_k:

    l = sum of gear_k q_k, or pull |b - a| between points a and b; v = its rate, u within control_range
    w' = inflow_0 u + inflow_1 w + inflow_2 l + inflow_3 v, w within state_range
    x = w, or x = u without a state
    p = (gain_0 + gain_1 l + gain_2 v) x + bias_0 + bias_1 l + bias_2 v + direct_0 u + direct_1 u'
    p within force_range
    force on q_k: gear_k p; on b away from a, and on a away from b: pull p

Source: MuJoCo documentation, Computation, section "Actuation model"; of the direct-current motor: K. Ogata,
Modern Control Engineering, section 3.3, with the current as w.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mechsim.errors import InputError, first_names
from mechsim.mechanism.links import Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import State
from mechsim.numerics.arrays import HUGE, Array

Range = tuple[float, float]
NO_LIMIT: Range = (-np.inf, np.inf)


def no_control(time: Array) -> tuple[Array, Array, Array]:
    """Return a control of zero with its derivatives, at times (n,)."""
    zero = np.zeros_like(time)
    return zero, zero, zero


@dataclass(frozen=True, slots=True)
class Actuator:
    """A force on joint coordinates or between points; see the module's equations.

    Attributes:
        name: name of the actuator.
        gear: coordinate -> change of length per change of the coordinate.
        control: time in [s] -> control u and its derivatives.
        gain: coefficients of x.
        bias: coefficients of the force without control.
        direct: coefficients of the control and its rate that act besides x.
        inflow: coefficients of u, w, l and v in w'; None without a state.
        start: initial state w.
        control_range, state_range, force_range: limits of u, w and p.
        inertia: moment of inertia or mass that moves with l, as a rotor before a gear; 0 between points.
        ends: the points a and b, as those of a spring; None for one on coordinates.
        pull: change of l per change of the distance.
        text: the control as written.
    """

    name: str
    gear: Mapping[str, float]
    control: State = no_control
    gain: tuple[float, float, float] = (1.0, 0.0, 0.0)
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direct: tuple[float, float] = (0.0, 0.0)
    inflow: tuple[float, float, float, float] | None = None
    start: float = 0.0
    control_range: Range = NO_LIMIT
    state_range: Range = NO_LIMIT
    force_range: Range = NO_LIMIT
    inertia: float = 0.0
    ends: tuple[str | tuple[str, Vector], str | tuple[str, Vector]] | None = None
    pull: float = 1.0
    text: str = field(default="0", compare=False)

    def __post_init__(self) -> None:
        for name in ("gain", "bias", "direct", "inflow", "start", "inertia", "pull"):
            values = np.ravel(getattr(self, name) or 0.0)
            if not (np.abs(values) < HUGE).all():
                raise InputError(
                    f"{name} of actuator {self.name!r} is {getattr(self, name)}; give finite numbers below "
                    f"{HUGE:g}"
                )
        if not self.inertia >= 0.0:
            raise InputError(f"inertia of actuator {self.name!r} is {self.inertia}; give 0 or more")
        if self.ends and (self.gear or self.inertia):
            raise InputError(
                f"actuator {self.name!r} acts between two points; leave out its coordinates and its inertia"
            )
        for name in ("control_range", "state_range", "force_range"):
            low, high = getattr(self, name)
            if not low < high:
                raise InputError(
                    f"{name.replace('_', ' ')} of actuator {self.name!r} is {low} to {high}; give a lower "
                    "limit below the upper one"
                )

    @property
    def limited(self) -> bool:
        """Whether control, state or force has a limit."""
        return bool(np.isfinite([self.control_range, self.state_range, self.force_range]).any())

    def replaced(self, driven: Collection[str]) -> bool:
        """Whether drivers replace it: it acts on their coordinates alone."""
        return not self.ends and {*self.gear} <= {*driven}

    @property
    def by_motion(self) -> bool:
        """Whether motion and time determine its force: it has no state, and a control if one acts."""
        unknown = self.inflow is not None or (self.control is no_control and any(self.gain))
        return not (unknown or (any(self.direct) and any(self.gain[1:])))

    def check(self, mechanism: Mechanism) -> None:
        """Raise InputError if the mechanism lacks one of the coordinates."""
        for name in self.gear:
            if name not in mechanism.coordinates:
                raise InputError(
                    f"actuator {self.name!r} acts on {name!r}, which is no coordinate of {mechanism.name}; "
                    f"it has {first_names(mechanism.coordinates)}"
                )

    def input(self, time: Array) -> tuple[Array, Array]:
        """Return the control within its range, and its rate, (n,)."""
        value, rate, *_ = (np.broadcast_to(values, time.shape) for values in self.control(time))
        low, high = self.control_range
        return np.clip(value, low, high), np.where((value < low) | (value > high), 0.0, rate)

    def force(self, inputs: tuple[Array, Array], length: Array, speed: Array, state: Array) -> Array:
        """Return the force p at inputs, lengths, speeds and states, (n,); complex steps are propagated."""
        control, rate = inputs
        x = control if self.inflow is None else state
        value = (self.gain[0] + self.gain[1] * length + self.gain[2] * speed) * x
        value = value + self.bias[0] + self.bias[1] * length + self.bias[2] * speed
        return limited(value + self.direct[0] * control + self.direct[1] * rate, self.force_range)

    def state_rate(self, inputs: tuple[Array, Array], length: Array, speed: Array, state: Array) -> Array:
        """Return w', (n,): zero where it would leave its range."""
        assert self.inflow is not None
        u, w, by_length, by_speed = self.inflow
        rate = u * inputs[0] + w * state + by_length * length + by_speed * speed
        if self.state_range == NO_LIMIT:
            return rate
        low, high = self.state_range
        leaving = ((state <= low) & (np.real(rate) < 0.0)) | ((state >= high) & (np.real(rate) > 0.0))
        return np.where(leaving, 0.0, rate)

    def steady_state(self, time: Array, length: Array, speed: Array) -> Array:
        """Return the state w with w' = 0, (n,); its start if w' does not depend on it."""
        if self.inflow is None or not self.inflow[1]:
            return np.full(np.shape(length), self.start)
        rest = self.state_rate(self.input(time), length, speed, np.zeros(np.shape(length)))
        return limited(-rest / self.inflow[1], self.state_range)


def limited(values: Array, limits: Range) -> Array:
    """Return values within limits; a complex step of a limited value is zero."""
    if limits == NO_LIMIT:
        return values
    low, high = limits
    real: Any = np.real(values)
    return np.where(real < low, low, np.where(real > high, high, values))
