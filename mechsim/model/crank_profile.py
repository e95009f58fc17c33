"""How the crank is meant to turn: at constant speed, or along a given angle over time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import number, numbers, units_remedy
from mechsim.numerics.interpolation import quintic_spline

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
        fastest: largest crank speed, in [rad/s].
        state: times (n,) in [s] -> angle [rad], speed [rad/s], acceleration [rad/s2], (n,) each.
        steady: whether the speed is constant.
    """

    duration: float
    fastest: float
    state: Callable[[Array], tuple[Array, Array, Array]]
    steady: bool = False

    @property
    def turns(self) -> float:
        """Turns the crank would make in this time at its fastest."""
        return self.duration * self.fastest / TURN

    @property
    def angles(self) -> Array:
        """Crank angles in the order of the motion, the first included, in [rad]."""
        return self.state(np.linspace(0.0, self.duration, LEAST_INSTANTS))[0]

    @property
    def least(self) -> int:
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

    return CrankProfile(turns * TURN / abs(speed), abs(speed), state, steady=True)


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

    return CrankProfile(TURN / rate, abs(fastest), state)


def closes_nowhere(name: str) -> AssemblyError:
    """Return the refusal of a mechanism whose crank range is empty."""
    return AssemblyError(f"{name}: the loops close at no crank angle; change the dimensions")


def arc_around(arcs: CrankRange, angle: float) -> tuple[float, float] | None:
    """Return the arc that holds a crank angle, counted on the angle's lap, in [rad]; None if none does.

    A turn fewer or more is the same pose: an arc from 1 to 7 rad holds 0.5 rad as one from -5.3 to 0.7.
    """
    for low, high in arcs.arcs:
        lap = TURN * np.floor((angle - low) / TURN)
        if angle <= high + lap:
            return float(low + lap), float(high + lap)
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
    around = arc_around(arcs, angle)
    if around is None:
        why = "where assembly begins; change the dimensions" if through is None else f"it can stand {arcs}"
        raise AssemblyError(f"{mechanism.name}: the loops do not close at crank angle {angle:.6g} rad, {why}")
    low, high = around
    middle, reach = (low + high) / 2.0, PART_OF_RANGE * (high - low) / 2.0
    return swing(middle, reach if through is None else max(reach, abs(angle - middle)), speed)
