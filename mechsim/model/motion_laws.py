"""How driven coordinates go over time: one program each, and what they are together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.model.crank_profile import CrankProfile
from mechsim.model.mechanism import Mechanism
from mechsim.model.work_size import require_revolutions
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import number
from mechsim.numerics.interpolation import quintic_spline

# times (n,) in [s] -> value [m] or [rad], rate and acceleration, (n,) each
State = Callable[[Array], tuple[Array, Array, Array]]

# times at which programs are probed for what is not finite and for their fastest rate: so many evenly spread,
# and so many at multiples of the golden ratio, for a law may have the period of the even ones
PROBES = 2048
GOLDEN = 0.6180339887498949
# rates beyond these, in [rad/s] or sizes a second, and accelerations beyond the square of the larger, are
# slips of the pen, and their squares soon beyond what a float holds
SLOWEST, FASTEST = 1e-12, 1e9


@dataclass(frozen=True)
class MotionLaws:
    """The programs of all drivers of a mechanism, by a clock that runs as fast as the fastest of them.

    The clock's angle stands where a crank's would: `clock` is the profile of a crank that turns steadily,
    by about a radian where the fastest driver moves by a radian or by the mechanism's size.

    Attributes:
        duration: in [s].
        drivers: names of the driven coordinates.
        states: of each driver, as `State`.
        pace: angle of the clock per second, in [rad/s].
        moment: what an instant is called in messages; None where it is called by its time.
    """

    duration: float
    drivers: tuple[str, ...]
    states: tuple[State, ...]
    pace: float
    moment: Callable[[float], str] | None = None

    def called(self, angle: float) -> str:
        """Return what the instant of an angle of the clock is called."""
        time = angle / self.pace
        return f"{time:.7g} s" if self.moment is None else self.moment(time)

    @property
    def clock(self) -> CrankProfile:
        """The profile of the clock."""

        def state(time: Array) -> tuple[Array, Array, Array]:
            return self.pace * time, np.full_like(time, self.pace), np.zeros_like(time)

        return CrankProfile(self.duration, self.pace, state, steady=True)

    def state(self, time: Array) -> tuple[Array, Array, Array]:
        """Return values, rates and accelerations of the drivers at times (n,) in [s], (drivers, n) each."""
        found = [state(time) for state in self.states]
        value, rate, acceleration = (
            np.array([np.broadcast_to(one[i], time.shape) for one in found]) for i in range(3)
        )
        return value, rate, acceleration

    def by_clock(self, angle: Array) -> tuple[Array, Array, Array]:
        """Return the drivers and their first two derivatives at angles of the clock, (drivers, n) each."""
        value, rate, acceleration = self.state(angle / self.pace)
        return value, rate / self.pace, acceleration / self.pace**2

    @property
    def by_name(self) -> Mapping[str, State]:
        """Driver -> its program."""
        return dict(zip(self.drivers, self.states, strict=True))

    @cached_property
    def first(self) -> Mapping[str, float]:
        """Where the drivers stand at time zero."""
        values = self.state(np.zeros(1))[0][:, 0]
        return dict(zip(self.drivers, values.tolist(), strict=True))

    @cached_property
    def fastest(self) -> float:
        """The pace, or the angular frequency where drivers oscillate faster, in [rad/s]: a cycle at least."""
        _, rate, second = self.state(_probes(self.duration))
        quick, quicker = (np.sqrt((one**2).mean(1)) for one in (rate, second))
        frequency = np.divide(quicker, quick, out=np.zeros_like(quick), where=quick > 0.0)
        return max(self.pace, float(frequency.max()), TURN / self.duration)

    @property
    def revolutions(self) -> float:
        """Revolutions of the fastest driver, or cycles of the one that oscillates most often."""
        return self.duration * self.fastest / TURN

    def lasting(self, duration: float) -> "MotionLaws":
        """Return the same programs over another duration in [s]."""
        return replace(self, duration=duration)


def make_motion_laws(mechanism: Mechanism, states: Mapping[str, State], duration: float) -> MotionLaws:
    """Return the programs of a mechanism's drivers.

    Args:
        mechanism: whose drivers they are.
        states: driver -> its state over time.
        duration: in [s].

    Raises:
        InputError: for a driver without a program, a program without its driver, one that is not finite or
            beyond all sense fast, drivers that all stand still or next to it, or a motion of more revolutions
            than one run can follow.
    """
    if not 0.0 < number(duration) < np.inf:
        raise InputError(f"the duration is {duration} s; give a finite time above 0")
    missing = [name for name in mechanism.drivers if name not in states]
    if missing:
        raise InputError(
            f"{mechanism.name}: no program says how {', '.join(missing)} "
            f"move{'s' if len(missing) == 1 else ''}; give each a --drive JOINT=PROGRAM"
        )
    unknown = [name for name in states if name not in mechanism.drivers]
    if unknown:
        raise InputError(
            f"{mechanism.name}: there is a program for {unknown[0]!r}, which is not driven; "
            f"drivers are {', '.join(mechanism.drivers)}"
        )
    chosen = tuple(states[name] for name in mechanism.drivers)
    made = MotionLaws(float(duration), mechanism.drivers, chosen, 1.0)
    with np.errstate(all="ignore"):
        found = made.state(_probes(duration))
    for name, *parts in zip(made.drivers, *found, strict=True):
        if not all(np.isfinite(part).all() for part in parts):
            raise InputError(
                f"{mechanism.name}: the program of {name} is not finite from 0 to {duration:g} s; "
                "give one with two finite rates"
            )
    paces = [_pace(mechanism, name, *parts[1:]) for name, *parts in zip(made.drivers, *found, strict=True)]
    if not max(paces) > 0.0:
        raise InputError(f"{mechanism.name}: all drivers stand still; give one a program that moves")
    if not max(paces) >= SLOWEST:
        raise InputError(
            f"{mechanism.name}: no driver moves by more than {max(paces):.3g} rad or sizes a second; give "
            f"one a program that moves by {SLOWEST:g} at least"
        )
    made = replace(made, pace=max(paces))
    require_revolutions(mechanism.name, made.revolutions, duration)
    return made


def _probes(duration: float) -> Array:
    """Return times from 0 to a duration in [s], (2 * PROBES,)."""
    parts = np.concatenate([np.linspace(0.0, 1.0, PROBES), GOLDEN * np.arange(PROBES) % 1.0])
    return np.asarray(duration * parts, dtype=np.float64)


def _pace(mechanism: Mechanism, name: str, rate: Array, acceleration: Array) -> float:
    """Return how fast a driver's program goes at the most, in [rad/s] or sizes a second."""
    unit = mechanism.unit(name)
    size = mechanism.size if unit == "m" else 1.0
    for what, ending, values, most in (
        ("rate", "s", rate, FASTEST * size),
        ("acceleration", "s2", acceleration, FASTEST**2 * size),
    ):
        if not (worst := float(np.abs(values).max())) <= most:
            raise InputError(
                f"{mechanism.name}: the {what} in the program of {name} is up to {worst:.3g} "
                f"{unit}/{ending}; give one of {most:.3g} at the most"
            )
    return float(np.abs(rate).max()) / size


def steady(start: float, rate: float) -> State:
    """Return the program of a coordinate that moves steadily from a start, in [m] or [rad] and per second."""

    def state(time: Array) -> tuple[Array, Array, Array]:
        return start + rate * time, np.full_like(time, rate), np.zeros_like(time)

    return state


def tabled(name: str, time: ArrayLike, value: ArrayLike) -> State:
    """Return the program of a coordinate along a table, joined by a quintic spline.

    Args:
        name: of the coordinate, for messages.
        time: rising, (n,) in [s], at least 6 values.
        value: (n,) in [m] or [rad].
    """
    return quintic_spline(f"the program of {name}", time, value)
