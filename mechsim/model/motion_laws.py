"""How driven coordinates go over time: one motion law each, and what they are together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.model.limits import require_revolutions
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.collocation import quintic_spline
from mechsim.numerics.inputs import number, numbers, units_remedy

# a crank that cannot turn fully swings over this part of its range
PART_OF_RANGE = 0.9
# fewer turns are a slip: between crank angles nearer to each other no motion is to be seen
LEAST_TURNS = 1e-9
# instants at which a crank that does not turn steadily is looked at, however little it turns
LEAST_INSTANTS = 48


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
        """Turns the crank would make in this time at its fastest."""
        return self.duration * self.max_speed / REVOLUTION

    @property
    def angles(self) -> Array:
        """Crank angles in the order of the motion, the first included, in [rad]."""
        return self.state(np.linspace(0.0, self.duration, LEAST_INSTANTS))[0]

    @property
    def min_instants(self) -> int:
        """Instants, and steps, of which fewer do not show the motion: a short swing ends where it began."""
        return 1 if self.steady else LEAST_INSTANTS


class CrankRange(Protocol):
    """The arcs of crank angle over which the loops of a mechanism close, in words too."""

    @property
    def full(self) -> bool: ...

    @property
    def arcs(self) -> Sequence[tuple[float, float]]: ...


def constant(speed: float, turns: float, start: float = 0.0) -> CrankProfile:
    """Return a crank that turns at constant speed.

    Args:
        speed: in [rad/s], negative backwards.
        turns: how far, in turns.
        start: crank angle at time zero, in [rad].
    """
    if not 0.0 < abs(number(speed)) < np.inf:
        remedy = units_remedy(speed, "units.parse_speed('600 rpm') or units.rpm(600)")
        raise InputError(f"crank speed is {speed} rad/s; give a finite speed other than 0{remedy}")
    if not LEAST_TURNS <= number(turns) < np.inf:
        raise InputError(f"{turns} turns asked for; give a finite number above 0, {LEAST_TURNS:g} at least")

    def state(time: Array) -> tuple[Array, Array, Array]:
        return start + speed * time, np.full_like(time, speed), np.zeros_like(time)

    return CrankProfile(turns * REVOLUTION / abs(speed), abs(speed), state, steady=True)


def table(time: ArrayLike, angle: ArrayLike) -> CrankProfile:
    """Return a crank that follows a table of angles, joined by a quintic spline.

    Args:
        time: rising, from 0, (n,) in [s], at least 6 values.
        angle: unwrapped, (n,) in [rad].
    """
    state = quintic_spline("a crank profile", time, angle)
    time = numbers(time)
    if time[0] != 0.0:
        raise InputError(f"the times of a crank profile begin at {time[0]:g} s; begin at 0")
    fine = np.linspace(0.0, time[-1], 20 * len(time))
    fastest = float(np.abs(state(fine)[1]).max())
    if not fastest > 0.0:
        raise InputError("the crank profile stands still; give angles that change")
    return CrankProfile(float(time[-1]), fastest, state)


def swing(middle: float, reach: float, fastest: float) -> CrankProfile:
    """Return a crank that swings once to and fro about an angle, starting from its lower end.

    Args:
        middle: of the swing, in [rad].
        reach: to either side, in [rad].
        fastest: crank speed in the middle, in [rad/s].
    """
    if not 0.0 < number(reach) < np.inf or not 0.0 < abs(number(fastest)) < np.inf:
        raise InputError(f"a swing of {reach} rad at {fastest} rad/s; give finite numbers above 0")
    rate = abs(fastest) / reach

    def state(time: Array) -> tuple[Array, Array, Array]:
        phase = rate * time
        return (
            middle - reach * np.cos(phase),
            reach * rate * np.sin(phase),
            reach * rate**2 * np.cos(phase),
        )

    return CrankProfile(REVOLUTION / rate, abs(fastest), state)


def no_crank_range_error(name: str) -> AssemblyError:
    """Return the error for a mechanism whose crank range is empty."""
    return AssemblyError(f"{name}: the loops close at no crank angle; change the dimensions")


def interval_around(arcs: CrankRange, angle: float) -> tuple[float, float] | None:
    """Return the arc that holds a crank angle in the angle's revolution, in [rad]; None if none does.

    A turn fewer or more is the same pose: an arc from 1 to 7 rad holds 0.5 rad as one from -5.3 to 0.7.
    """
    for low, high in arcs.arcs:
        offset = REVOLUTION * np.floor((angle - low) / REVOLUTION)
        if angle <= high + offset:
            return float(low + offset), float(high + offset)
    return None


def within_range(
    mechanism: Mechanism, arcs: CrankRange, speed: float, turns: float = 1.0, through: float | None = None
) -> CrankProfile:
    """Return the crank motion a mechanism can make: whole turns, or a swing inside its range.

    Args:
        mechanism: the mechanism.
        arcs: over which its crank can turn.
        speed: of the crank in [rad/s]; of a swing the largest.
        turns: of a crank that turns fully.
        through: crank angle in [rad] that a swing passes; None takes where assembly begins.

    Raises:
        AssemblyError: if the loops do not close there.
    """
    if arcs.full:
        return constant(speed, turns)
    angle = mechanism.start if through is None else through
    around = interval_around(arcs, angle)
    if around is None:
        reason = "where assembly begins; change the dimensions" if through is None else f"it can stand {arcs}"
        raise AssemblyError(
            f"{mechanism.name}: the loops do not close at crank angle {angle:.6g} rad, {reason}"
        )
    low, high = around
    middle, reach = (low + high) / 2.0, PART_OF_RANGE * (high - low) / 2.0
    return swing(middle, reach if through is None else max(reach, abs(angle - middle)), speed)


# times (n,) in [s] -> value [m] or [rad], rate and acceleration, (n,) each
State = Callable[[Array], tuple[Array, Array, Array]]

# times at which motion laws are probed for what is not finite and for their fastest rate: evenly spread,
# and so many at multiples of the golden ratio, for a law may have the period of the even ones
PROBES = 2048
GOLDEN = 0.6180339887498949
# smallest and largest rate, in [rad/s] or mechanism sizes a second; accelerations are limited by the
# square of the largest rate, beyond which squares overflow
SLOWEST, FASTEST = 1e-12, 1e9


@dataclass(frozen=True)
class MotionLaws:
    """The motion laws of all drivers of a mechanism.

    Solvers follow them over the path parameter: the time multiplied by `rate`, so that the fastest driver
    moves by about a radian, or by the mechanism's size, while the parameter grows by one.

    Attributes:
        duration: in [s].
        drivers: names of the driven coordinates.
        states: of each driver, as `State`.
        rate: path parameter per second, in [rad/s].
        label: time in [s] -> name of an instant in messages; None names it by its time.
    """

    # whether a crank is driven, at a speed that each call states
    crank: ClassVar[bool] = False
    # name and unit of the instants in tables
    axis: ClassVar[Literal["t", "angle"]] = "t"
    unit: ClassVar[Literal["s", "rad"]] = "s"

    duration: float
    drivers: tuple[str, ...]
    states: tuple[State, ...]
    rate: float
    label: Callable[[float], str] | None = None

    def require_drivers(self, mechanism: Mechanism) -> None:
        """Raise InputError unless these laws drive all drivers of a mechanism, and nothing else."""
        if set(self.drivers) != set(mechanism.drivers):
            raise InputError(
                f"{mechanism.name}: the motion laws are of {', '.join(self.drivers)}; drivers are "
                f"{', '.join(mechanism.drivers)}"
            )

    @property
    def length(self) -> float:
        """Path parameter at the end."""
        return self.rate * self.duration

    def path_speed(self, crank_speed: float) -> float:
        """Return the rate of the path parameter, in [rad/s]: of a crank its speed."""
        return self.rate

    def instants(self, parameter: Array) -> Array:
        """Return times in [s], or angles of a crank in [rad], at path parameters."""
        return parameter / self.rate

    def parameter(self, instants: Array) -> Array:
        """Return path parameters at times in [s], or at angles of a crank in [rad]."""
        return self.rate * instants

    def time(self, parameter: Array) -> Array | None:
        """Return times in [s] at path parameters; None of a crank."""
        return self.instants(parameter)

    def spread(self, count: int) -> Array:
        """Return path parameters over the whole motion, (count,); a crank's last is one before the first."""
        return np.linspace(0.0, self.length, count)

    def instant_label(self, parameter: float) -> str:
        """Return what the instant of a path parameter is called."""
        time = parameter / self.rate
        return f"{time:.7g} s" if self.label is None else self.label(time)

    @property
    def path_profile(self) -> CrankProfile:
        """The path parameter over time."""

        def state(time: Array) -> tuple[Array, Array, Array]:
            return self.rate * time, np.full_like(time, self.rate), np.zeros_like(time)

        return CrankProfile(self.duration, self.rate, state, steady=True)

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
        """Where the drivers stand at time zero."""
        return {name: float(np.ravel(state(np.zeros(1))[0])[0]) for name, state in self.by_name.items()}

    @cached_property
    def fastest(self) -> float:
        """The rate, or the angular frequency where drivers oscillate faster, in [rad/s]: a cycle at least."""
        _, rate, second = self.state(_probes(self.duration))
        quick, quicker = (np.sqrt((derivative**2).mean(1)) for derivative in (rate, second))
        frequency = np.divide(quicker, quick, out=np.zeros_like(quick), where=quick > 0.0)
        return max(self.rate, float(frequency.max()), REVOLUTION / self.duration)

    @property
    def revolutions(self) -> float:
        """Revolutions of the fastest driver, or cycles of the one that oscillates most often."""
        return self.duration * self.fastest / REVOLUTION

    def with_duration(self, duration: float) -> "MotionLaws":
        """Return the same motion laws over another duration in [s]."""
        return replace(self, duration=duration)


@dataclass(frozen=True)
class CrankLaw(MotionLaws):
    """One crank, whose angle is the path parameter.

    A call that solves or simulates states its speed; the laws are those of a revolution at 1 rad/s.
    """

    crank: ClassVar[bool] = True
    axis: ClassVar[Literal["t", "angle"]] = "angle"
    unit: ClassVar[Literal["s", "rad"]] = "rad"

    def require_drivers(self, mechanism: Mechanism) -> None:
        """Raise InputError unless a crank is the only driver of a mechanism."""
        if not mechanism.has_crank:
            first, have = mechanism.drivers[0], "has" if len(mechanism.drivers) == 1 else "have"
            amplitude = "10mm" if mechanism.unit(first) == "m" else "30deg"
            raise InputError(
                f"{mechanism.name}: {', '.join(mechanism.drivers)} {have} no motion law; give each one: "
                f"--drive JOINT=LAW, as in --drive '{first}={amplitude}*sin(2*pi*t)', or in Python "
                f"drive={{'{first}': '{amplitude}*sin(2*pi*t)'}}"
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
        mechanism: whose drivers they are.
        states: driver -> its state over time.
        duration: in [s].

    Raises:
        InputError: for a driver without a motion law, a law without its driver, one that is not finite or
            beyond all sense fast, drivers that all stand still or next to it, or a motion of more revolutions
            than one run can follow.
    """
    if not 0.0 < number(duration) < np.inf:
        raise InputError(f"the duration is {duration} s; give a finite time above 0")
    missing = [name for name in mechanism.drivers if name not in states]
    if missing:
        raise InputError(
            f"{mechanism.name}: no motion law says how {', '.join(missing)} "
            f"move{'s' if len(missing) == 1 else ''}; give each a --drive JOINT=LAW"
        )
    unknown = [name for name in states if name not in mechanism.drivers]
    if unknown:
        raise InputError(
            f"{mechanism.name}: there is a motion law for {unknown[0]!r}, which is not driven; "
            f"drivers are {', '.join(mechanism.drivers)}"
        )
    chosen = tuple(states[name] for name in mechanism.drivers)
    made = MotionLaws(float(duration), mechanism.drivers, chosen, 1.0)
    with np.errstate(all="ignore"):
        values = made.state(_probes(duration))
    for name, *derivatives in zip(made.drivers, *values, strict=True):
        if not all(np.isfinite(derivative).all() for derivative in derivatives):
            raise InputError(
                f"{mechanism.name}: the motion law of {name} is not finite from 0 to {duration:g} s; "
                "give one with two finite rates"
            )
    rates = [
        _max_rate(mechanism, name, *derivatives[1:])
        for name, *derivatives in zip(made.drivers, *values, strict=True)
    ]
    if not max(rates) > 0.0:
        raise InputError(f"{mechanism.name}: all drivers stand still; give one a motion law that moves")
    if not max(rates) >= SLOWEST:
        raise InputError(
            f"{mechanism.name}: no driver moves by more than {max(rates):.3g} rad or sizes a second; give "
            f"one a motion law that moves by {SLOWEST:g} at least"
        )
    made = replace(made, rate=max(rates))
    require_revolutions(mechanism.name, made.revolutions, duration)
    return made


def _probes(duration: float) -> Array:
    """Return times from 0 to a duration in [s], (2 * PROBES,)."""
    fractions = np.concatenate([np.linspace(0.0, 1.0, PROBES), GOLDEN * np.arange(PROBES) % 1.0])
    return np.asarray(duration * fractions, dtype=np.float64)


def _max_rate(mechanism: Mechanism, name: str, rate: Array, acceleration: Array) -> float:
    """Return how fast a driver's motion law goes at the most, in [rad/s] or sizes a second."""
    unit = mechanism.unit(name)
    length = mechanism.characteristic_length if unit == "m" else 1.0
    for what, ending, values, most in (
        ("rate", "s", rate, FASTEST * length),
        ("acceleration", "s2", acceleration, FASTEST**2 * length),
    ):
        if not (worst := float(np.abs(values).max())) <= most:
            raise InputError(
                f"{mechanism.name}: the {what} in the motion law of {name} is up to {worst:.3g} "
                f"{unit}/{ending}; give one of {most:.3g} at the most"
            )
    return float(np.abs(rate).max()) / length


def steady(start: float, rate: float) -> State:
    """Return the motion law of a steady rate from a start, in [m] or [rad] and per second."""

    def state(time: Array) -> tuple[Array, Array, Array]:
        zero = 0.0 * time
        return start + rate * time, rate + zero, zero

    return state


def tabled(name: str, time: ArrayLike, value: ArrayLike) -> State:
    """Return the motion law of a coordinate along a table, joined by a quintic spline.

    Args:
        name: of the coordinate, for messages.
        time: rising, (n,) in [s], at least 6 values.
        value: (n,) in [m] or [rad].
    """
    return quintic_spline(f"the motion law of {name}", time, value)
