"""Motion laws: driven coordinates as functions of time, and crank motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism.expressions import Instruction, instructions_of, parse_expression
from mechsim.mechanism.limits import MAX_REVOLUTIONS, require_revolutions
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array, number, units_remedy
from mechsim.numerics.collocation import quintic_spline

if TYPE_CHECKING:
    from mechsim.numerics.balls import Ball

# fraction of its range over which a crank that cannot rotate fully swings
SWING_FRACTION = 0.9
# smallest number of revolutions; less is an input error, since positions then differ by rounding only
MIN_TURNS = 1e-9
# smallest number of instants that resolve a crank motion of variable speed
MIN_INSTANTS = 48


@dataclass(frozen=True, slots=True)
class CrankProfile:
    """Crank motion over time.

    Attributes:
        duration: in [s].
        max_speed: largest crank speed, in [rad/s].
        state: times (n,) in [s] -> angle [rad], speed [rad/s], acceleration [rad/s2], (n,) each.
        steady: whether the speed is constant.
    """

    duration: float
    max_speed: float
    state: Callable[[Array], tuple[Array, Array, Array]]
    steady: bool = False

    @property
    def turns(self) -> float:
        """Revolutions of the crank in this time at its largest speed."""
        return self.duration * self.max_speed / REVOLUTION

    @property
    def angles(self) -> Array:
        """Crank angles in the order of the motion, in [rad]."""
        return self.state(np.linspace(0.0, self.duration, MIN_INSTANTS))[0]

    @property
    def min_instants(self) -> int:
        """Smallest number of instants, or steps, that resolves the motion."""
        return 1 if self.steady else MIN_INSTANTS


def revolutions_to(angle: float) -> float:
    """Return the whole revolutions in [rad] nearest to an angle: 0 for one in [-pi, pi)."""
    return float(REVOLUTION * np.floor((angle + np.pi) / REVOLUTION))


@dataclass(frozen=True, slots=True)
class Arcs:
    """Intervals of crank angle.

    Attributes:
        full: whether the crank rotates fully; then `arcs` is one revolution.
        arcs: (from, to) in [rad], from < to, from in [-pi, pi); empty if the loop closes nowhere.
    """

    full: bool
    arcs: tuple[tuple[float, float], ...]

    @classmethod
    def between(cls, low: float, high: float) -> Arcs:
        """Return one interval, which starts in [-pi, pi)."""
        revolution = revolutions_to(low)
        return cls(False, ((low - revolution, high - revolution),))

    def start(self) -> float:
        """Return the start angle: 0 if it is in an interval, else the middle of the longest interval.

        In an interval of more than a revolution, angles that differ by revolutions are different poses, and 0
        can be replaced by such an angle.
        """
        if self.full or not self.arcs:
            return 0.0
        for low, high in self.arcs:
            for angle in (0.0, REVOLUTION):
                if low < angle < high:
                    return angle if high - low > REVOLUTION else 0.0
        low, high = max(self.arcs, key=lambda arc: arc[1] - arc[0])
        return (low + high) / 2.0

    def __str__(self) -> str:
        if self.full:
            return "anywhere in the turn"
        return " and ".join(f"from {low:.6g} to {high:.6g} rad" for low, high in self.arcs)


def constant(speed: float, turns: float, start: float = 0.0) -> CrankProfile:
    """Return a crank that turns at constant speed.

    Args:
        speed: in [rad/s], negative for backward rotation.
        turns: number of revolutions.
        start: crank angle at time zero, in [rad].
    """
    if not 0.0 < abs(number(speed)) < np.inf:
        remedy = units_remedy(speed, "units.parse_speed('600 rpm') or units.rpm(600)")
        raise InputError(f"crank speed is {speed} rad/s; give a finite speed other than 0{remedy}")
    if not MIN_TURNS <= number(turns) < np.inf:
        raise InputError(f"{turns} turns requested; give a finite number above 0, {MIN_TURNS:g} at least")

    return CrankProfile(turns * REVOLUTION / abs(speed), abs(speed), Steady(start, speed), steady=True)


def swing(middle: float, reach: float, fastest: float) -> CrankProfile:
    """Return a crank that swings about an angle for one period, starting from its smallest angle.

    Args:
        middle: mean angle in [rad].
        reach: amplitude in [rad].
        fastest: largest crank speed, in [rad/s].
    """
    if not 0.0 < number(reach) < np.inf or not 0.0 < abs(number(fastest)) < np.inf:
        raise InputError(f"a swing of {reach} rad at {fastest} rad/s; give finite numbers above 0")
    rate = abs(fastest) / reach

    def state(time: Array) -> tuple[Array, Array, Array]:
        phase = rate * time
        return (middle - reach * np.cos(phase), reach * rate * np.sin(phase), reach * rate**2 * np.cos(phase))

    return CrankProfile(REVOLUTION / rate, abs(fastest), state)


def no_crank_range_error(name: str) -> AssemblyError:
    """Return the error for a mechanism whose crank range is empty."""
    return AssemblyError(f"{name}: the loops close at no crank angle; change the dimensions")


def interval_around(arcs: Arcs, angle: float) -> tuple[float, float] | None:
    """Return the interval that contains a crank angle, in the revolution of the angle, in [rad]; else None.

    Angles that differ by a revolution are the same configuration: the interval from 1 to 7 rad contains 0.5
        rad,
    and is then returned as -5.3 to 0.7 rad.
    """
    for low, high in arcs.arcs:
        offset = REVOLUTION * np.floor((angle - low) / REVOLUTION)
        if angle <= high + offset:
            return float(low + offset), float(high + offset)
    return None


def within_range(
    mechanism: Mechanism, arcs: Arcs, speed: float, turns: float = 1.0, through: float | None = None
) -> CrankProfile:
    """Return a crank motion that a mechanism can make: full revolutions, or a swing inside its range.

    Args:
        mechanism: the mechanism.
        arcs: range of its crank.
        speed: crank speed in [rad/s]; of a swing the largest.
        turns: revolutions of a crank that rotates fully.
        through: crank angle in [rad] within a swing; the default is the angle of the guess.

    Raises:
        AssemblyError: if the mechanism cannot be assembled at that angle.
    """
    if arcs.full:
        return constant(speed, turns, revolutions_to(mechanism.start))
    angle = mechanism.start if through is None else through
    interval = interval_around(arcs, angle)
    if interval is None:
        reason = "that of the guess; change the dimensions" if through is None else f"its range is {arcs}"
        raise AssemblyError(
            f"{mechanism.name}: the loops do not close at crank angle {angle:.6g} rad, {reason}"
        )
    low, high = interval
    middle, reach = (low + high) / 2.0, SWING_FRACTION * (high - low) / 2.0
    return swing(middle, reach if through is None else max(reach, abs(angle - middle)), speed)


# times (n,) in [s] -> value [m] or [rad], rate and acceleration, (n,) each
State = Callable[[Array], tuple[Array, Array, Array]]

# errors of a law that interval arithmetic cannot enclose
NOT_ENCLOSED = (TypeError, ValueError, AttributeError)


def state_in_balls(state: State, time: Ball) -> tuple[Ball, Ball, Ball]:
    """Return value, rate and acceleration of a driver over balls of time, (n,) in [s].

    Raises:
        TypeError, ValueError, AttributeError: if a motion law cannot be enclosed.
    """
    from mechsim.numerics.balls import ball

    law: Callable[[Any], tuple[Any, Any, Any]] = state
    value, rate, acceleration = (ball(entry) for entry in law(time))
    return value, rate, acceleration


# number of instants at which motion laws are checked for finite values and for their largest rate: evenly
# spaced, and as many at multiples of the golden ratio, because a law can have the period of the former
PROBES = 2048
GOLDEN_RATIO = 0.6180339887498949
# a motion counts as an oscillation of the frequency of one that fills at least 1 / BURSTS of its duration; a
# shorter pulse counts by its rate. Chosen by trial: 16 gave false differences from MuJoCo
BURSTS = 64
# intervals on which a law is first enclosed; those whose rate may exceed BETWEEN_PROBES times the largest
# at probes are halved, at most HALVINGS times and as many as these at a time
INTERVALS, HALVINGS, BETWEEN_PROBES = 256, 50, 2.0
# smallest and largest rate, in [rad/s] or characteristic lengths per second; the limit of accelerations is
# the square of the largest rate, above which squares overflow
MIN_RATE, MAX_RATE = 1e-12, 1e9


@dataclass(frozen=True)
class MotionLaws:
    """The motion laws of all drivers of a mechanism.

    The independent variable of the solvers is the path parameter, the time multiplied by `rate`. While it
    increases by one, the fastest driver moves by about one radian or one characteristic length.

    Attributes:
        duration: in [s].
        drivers: names of the driven coordinates.
        states: motion law of each driver, a `State`.
        rate: path parameter per second, in [rad/s]: the largest rate of a driver, or its mean with pulses.
        label: time in [s] -> name of the instant in messages; the default states the time.
        pulses: whether the largest rate is that of pulses, which are too short for time steps.
    """

    # whether a crank is driven, at a speed that each call sets
    crank: ClassVar[bool] = False
    # name and unit of the instants in tables
    axis: ClassVar[Literal["t", "angle"]] = "t"
    unit: ClassVar[Literal["s", "rad"]] = "s"

    duration: float
    drivers: tuple[str, ...]
    states: tuple[State, ...]
    rate: float
    label: Callable[[float], str] | None = None
    pulses: bool = False

    def require_drivers(self, mechanism: Mechanism) -> None:
        """Raise InputError unless the laws are those of all drivers of a mechanism."""
        if set(self.drivers) != set(mechanism.drivers):
            raise InputError(
                f"{mechanism.name}: there are motion laws of {', '.join(self.drivers)}; the drivers are "
                f"{', '.join(mechanism.drivers)}"
            )

    @property
    def length(self) -> float:
        """Path parameter at the end of the motion."""
        return self.rate * self.duration

    def path_speed(self, crank_speed: float) -> float:
        """Return the rate of the path parameter in [rad/s], the speed of a crank."""
        return self.rate

    def instants(self, parameter: Array) -> Array:
        """Return times in [s], or crank angles in [rad], at path parameters."""
        return parameter / self.rate

    def parameter(self, instants: Array) -> Array:
        """Return path parameters at times in [s], or at crank angles in [rad]."""
        return self.rate * instants

    def time(self, parameter: Array) -> Array | None:
        """Return times in [s] at path parameters; None for a crank."""
        return self.instants(parameter)

    def spread(self, count: int) -> Array:
        """Return evenly spaced path parameters, (count,); for a crank without the end of the revolution."""
        return np.linspace(0.0, self.length, count)

    def instant_label(self, parameter: float) -> str:
        """Return the name of the instant at a path parameter, for messages."""
        time = parameter / self.rate
        return f"{time:.7g} s" if self.label is None else self.label(time)

    @property
    def path_profile(self) -> CrankProfile:
        """The path parameter as a function of time."""
        return CrankProfile(self.duration, self.rate, Steady(0.0, self.rate), steady=True)

    def state(self, time: Array) -> tuple[Array, Array, Array]:
        """Return values, rates and accelerations of the drivers at times (n,) in [s], (drivers, n) each."""
        states = [state(time) for state in self.states]
        value, rate, acceleration = (
            np.array([np.broadcast_to(driver[i], time.shape) for driver in states]) for i in range(3)
        )
        return value, rate, acceleration

    def along_path(self, parameter: Array) -> tuple[Array, Array, Array]:
        """Return the drivers and their first two derivatives by the path parameter, (drivers, n) each."""
        value, rate, acceleration = self.state(parameter / self.rate)
        return value, rate / self.rate, acceleration / self.rate**2

    @property
    def by_name(self) -> Mapping[str, State]:
        """Driver -> its motion law."""
        return dict(zip(self.drivers, self.states, strict=True))

    @cached_property
    def first(self) -> Mapping[str, float]:
        """Driver -> its value at time zero."""
        return {name: float(np.ravel(state(np.zeros(1))[0])[0]) for name, state in self.by_name.items()}

    @cached_property
    def fastest(self) -> float:
        """Largest of `rate`, the angular frequency of any driver and one cycle per motion, in [rad/s]."""
        _, rate, second = self.state(np.sort(_probes(self.duration)))
        rate_rms, acceleration_rms = (np.sqrt((derivative**2).mean(1)) for derivative in (rate, second))
        frequency = np.divide(acceleration_rms, rate_rms, out=np.zeros_like(rate_rms), where=rate_rms > 0.0)
        # a probe on a narrow pulse has any ratio, but an oscillation changes signs at half the probes
        changes = (np.diff(np.sign(second)) != 0.0).sum(1)
        most = np.pi * (1.0 + changes) * BURSTS / self.duration
        return max(self.rate, float(np.minimum(frequency, most).max()), REVOLUTION / self.duration)

    @property
    def revolutions(self) -> float:
        """Revolutions of the fastest driver, or cycles of the fastest oscillation."""
        return self.duration * self.fastest / REVOLUTION


@dataclass(frozen=True)
class CrankLaw(MotionLaws):
    """A crank whose angle is the path parameter.

    Each call that solves or simulates sets its speed; the law itself is one revolution at 1 rad/s.
    """

    crank: ClassVar[bool] = True
    axis: ClassVar[Literal["t", "angle"]] = "angle"
    unit: ClassVar[Literal["s", "rad"]] = "rad"

    def require_drivers(self, mechanism: Mechanism) -> None:
        """Raise InputError unless a crank is the only driver of a mechanism."""
        if not mechanism.drivers:
            if not mechanism.coordinates:
                link = mechanism.links[-1].name
                raise InputError(
                    f"{mechanism.name} has no driver, and its balls and free joints have no coordinate that "
                    "a motion law could prescribe; drive a point or a link, as in "
                    f"--drive '{link}.rx=30deg*sin(2*pi*t)', or run it from an initial state "
                    "(mechsim dynamics forward)"
                )
            raise InputError(
                f"{mechanism.name} has no driver; give the motion law of one of its joints "
                f"{', '.join(mechanism.coordinates)} by --drive JOINT=LAW, or in Python by drive"
            )
        if not mechanism.has_crank:
            mechanism.require_driver()
            first, have = mechanism.drivers[0], "has" if len(mechanism.drivers) == 1 else "have"
            amplitude = "10mm" if mechanism.unit(first) == "m" else "30deg"
            raise InputError(
                f"{mechanism.name}: {', '.join(mechanism.drivers)} {have} no motion law; give each "
                f"driver one: --drive JOINT=LAW, as in --drive '{first}={amplitude}*sin(2*pi*t)', or in "
                f"Python drive={{'{first}': '{amplitude}*sin(2*pi*t)'}}"
            )

    def path_speed(self, crank_speed: float) -> float:
        return crank_speed

    def time(self, parameter: Array) -> None:
        return None

    def spread(self, count: int) -> Array:
        return self.length * np.arange(count) / count

    def instant_label(self, parameter: float) -> str:
        return f"crank angle {parameter:.6g} rad"

    def along_path(self, parameter: Array) -> tuple[Array, Array, Array]:
        return parameter[None], np.ones((1, len(parameter))), np.zeros((1, len(parameter)))


CRANK = CrankLaw(duration=REVOLUTION, drivers=(), states=(), rate=1.0)


def make_motion_laws(mechanism: Mechanism, states: Mapping[str, State], duration: float) -> MotionLaws:
    """Return the motion laws of a mechanism's drivers.

    Args:
        mechanism: the mechanism.
        states: driver -> its motion law.
        duration: in [s].

    Raises:
        InputError: for a driver without a motion law, a law of another coordinate, a law that is not finite
            or too fast, drivers that all almost stand still, or a motion with too many revolutions.
    """
    if not 0.0 < number(duration) < np.inf:
        raise InputError(f"the duration is {duration} s; give a finite time above 0")
    missing = [name for name in mechanism.drivers if name not in states]
    if missing:
        raise InputError(
            f"{mechanism.name}: {', '.join(missing)} {'has' if len(missing) == 1 else 'have'} no motion law; "
            "give each driver one: --drive JOINT=LAW"
        )
    unknown = [name for name in states if name not in mechanism.drivers]
    if unknown:
        raise InputError(
            f"{mechanism.name}: there is a motion law for {unknown[0]!r}, which is not driven; "
            f"drivers are {', '.join(mechanism.drivers)}"
        )
    chosen = tuple(states[name] for name in mechanism.drivers)
    state = MotionLaws(float(duration), mechanism.drivers, chosen, 1.0)
    with np.errstate(all="ignore"):
        times = np.concatenate([_probes(duration), *(_peaks(law, duration) for law in chosen)])
        values = state.state(np.sort(times))
    units = [mechanism.unit(name) for name in state.drivers]
    lengths = [mechanism.characteristic_length if unit == "m" else 1.0 for unit in units]
    # largest rate of each driver, in [rad/s] or characteristic lengths per second
    rates: list[float] = []
    for name, unit, length, *derivatives in zip(state.drivers, units, lengths, *values, strict=True):
        if not all(np.isfinite(derivative).all() for derivative in derivatives):
            raise InputError(
                f"{mechanism.name}: the motion law of {name} is not finite from 0 to {duration:g} s; "
                "give one with two finite derivatives"
            )
        rate, acceleration = (float(np.abs(derivative).max()) for derivative in derivatives[1:])
        for what, ending, worst, most in (
            ("rate", "s", rate, MAX_RATE),
            ("acceleration", "s2", acceleration, MAX_RATE**2),
        ):
            if not worst <= most * length:
                raise InputError(
                    f"{mechanism.name}: the {what} in the motion law of {name} is up to {worst:.3g} "
                    f"{unit}/{ending}; give one of {most * length:.3g} at most"
                )
        rates.append(rate / length)
    if 0.0 < max(rates) < MIN_RATE:
        raise InputError(
            f"{mechanism.name}: the fastest driver moves at {max(rates):.3g} rad/s or characteristic "
            f"lengths per second; give a motion law of at least {MIN_RATE:g}"
        )
    # of drivers at rest the path parameter is the time
    state = replace(state, rate=max(rates) or 1.0)
    if state.revolutions > MAX_REVOLUTIONS:
        # probes resolve slower oscillations than the limit, and `_peaks` are on the flanks of pulses
        travels = np.abs(np.diff(values[0])).sum(1)
        state = replace(state, rate=float((travels / lengths).max()) / duration, pulses=True)
    require_revolutions(mechanism.name, state.revolutions, duration)
    return state


def _probes(duration: float) -> Array:
    """Return times from 0 to a duration in [s], (2 * PROBES,)."""
    fractions = np.concatenate([np.linspace(0.0, 1.0, PROBES), GOLDEN_RATIO * np.arange(PROBES) % 1.0])
    return np.asarray(duration * fractions, dtype=np.float64)


def _peaks(law: State, duration: float) -> Array:
    """Return the times in [s] at which a law is faster than at all probes, as in a narrow spike, (n,).

    Intervals on which the rate may be large, by interval arithmetic, are halved until they lead to the spike.
    A law that interval arithmetic cannot enclose has none.
    """
    from mechsim.numerics.balls import OUTWARD, Ball

    largest, times = float(np.abs(law(_probes(duration))[1]).max(initial=0.0)), list[float]()
    half = 0.5 * duration / INTERVALS
    middle: Array = half * (1.0 + 2.0 * np.arange(INTERVALS, dtype=np.float64))
    for _ in range(HALVINGS):
        try:
            rates = state_in_balls(law, Ball(middle, np.full(len(middle), half * OUTWARD)))[1]
        except NOT_ENCLOSED:
            break
        # the rate of a law may be one number
        most, rate = rates.magnitude + 0.0 * middle, np.abs(law(middle)[1]) + 0.0 * middle
        if not (fastest := float(rate.max())) <= largest:
            largest = fastest
            times.append(float(middle[np.argmax(rate)]))
        wide = np.argsort(-most)[:INTERVALS]
        middle = middle[wide[~(most[wide] <= BETWEEN_PROBES * largest)]]
        if not (len(middle) and np.isfinite(largest)):
            break
        half *= 0.5
        middle = np.concatenate([middle - half, middle + half])
    return np.array(times)


@dataclass(frozen=True)
class Steady:
    """A motion law of a constant rate.

    Attributes:
        start: in [m] or [rad].
        rate: per second.
    """

    start: float
    rate: float

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at times (n,) in [s]."""
        zero = 0.0 * time
        return self.start + self.rate * time, self.rate + zero, zero

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation."""
        return instructions_of(parse_expression("start + rate*t"), {"start": self.start, "rate": self.rate})


def steady(start: float, rate: float) -> Steady:
    """Return the motion law of a constant rate from a start, in [m] or [rad] and per second."""
    return Steady(start, rate)


def tabled(name: str, time: ArrayLike, value: ArrayLike) -> State:
    """Return the motion law of a coordinate given by a table, interpolated by a quintic spline.

    Args:
        name: name of the coordinate, for messages.
        time: increasing, (n,) in [s], at least 6 values.
        value: (n,) in [m] or [rad].
    """
    return quintic_spline(f"the motion law of {name}", time, value)
