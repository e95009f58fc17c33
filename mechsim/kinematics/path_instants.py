"""The instants at which a motion is requested: crank angles with rates, or times in s."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.numerics.arrays import HUGE, Array, number, numbers

EXAMPLE = "t=[0, 0.1, 0.2]"


@dataclass(frozen=True, slots=True)
class PathInstants:
    """Instants of a motion.

    Attributes:
        parameter: path parameter in [rad]: crank angle, or under motion laws the normalised time.
        rate: its rate, scalar or (n,) in [rad/s].
        second: its second derivative by time, scalar or (n,) in [rad/s2].
        time: requested times, (n,) in [s]; None if angles were requested.
    """

    parameter: ArrayLike
    rate: ArrayLike
    second: ArrayLike
    time: Array | None = None


def path_instants(
    mechanism: Mechanism,
    motion_laws: MotionLaws,
    angles: ArrayLike | None,
    speed: ArrayLike | None,
    acceleration: ArrayLike,
    t: ArrayLike | None,
) -> PathInstants:
    """Return the instants given by crank angles and rates, or by times.

    Args:
        mechanism: the mechanism.
        motion_laws: its motion laws.
        angles: crank angles, (n,) in [rad] or text; None if times are given.
        speed: crank speed in [rad/s] or text; the default at crank angles is 1.
        acceleration: crank acceleration in [rad/s2].
        t: times, (n,) in [s]; at time zero the crank angle is `mechanism.start`.

    Raises:
        InputError: for crank angles or rates under motion laws, for both angles and times or neither, and for
            times that are not finite or outside a law's table.
    """
    angles = None if angles is None else units.si_angles(angles, "the crank angles")
    speed = units.si(speed, "rad/s", "the crank's speed")
    if not motion_laws.crank:
        drivers = ", ".join(motion_laws.drivers)
        if angles is not None or t is None:
            reason = "no times are given" if angles is None else "angles do not determine the time"
            raise InputError(
                f"{mechanism.name}: motion laws drive {drivers}, and {reason}; give times in s, as {EXAMPLE}"
            )
        if speed is not None or number(acceleration) != 0.0:
            what = "speed" if speed is not None else "acceleration"
            raise InputError(
                f"{mechanism.name}: motion laws drive {drivers} and determine every rate; leave {what} out"
            )
        time = _finite_list(f"{mechanism.name}: times t", t, f" in s, as {EXAMPLE}")
        for name, state in motion_laws.by_name.items():
            # only a motion law from a table ends
            end = getattr(state, "end_time", None)
            outside = [] if end is None else time[(time < 0.0) | (time > end * (1.0 + 1e-12))]
            if len(outside):
                raise InputError(
                    f"{mechanism.name}: t = {outside[0]:g} s is outside the table of {name}, 0 to {end:g} s; "
                    "give times within it, or more rows"
                )
        return PathInstants(motion_laws.parameter(time), motion_laws.rate, 0.0, time)
    if t is None and angles is None:
        raise InputError(f"{mechanism.name}: no instants are given; give crank angles in rad, or times as t=")
    if t is None:
        assert angles is not None
        return PathInstants(angles, 1.0 if speed is None else speed, acceleration)
    if angles is not None:
        raise InputError(f"{mechanism.name}: both crank angles and times t are given; leave one of them out")
    motion_laws.require_drivers(mechanism)
    time = _finite_list(f"{mechanism.name}: times t", t, f" in s, as {EXAMPLE}")
    constant = np.nan if speed is None else number(speed)
    if not (np.isfinite(constant) and number(acceleration) == 0.0):
        raise InputError(
            f"{mechanism.name}: times t of a crank need its constant speed; give speed= as one number in "
            "rad/s and no acceleration, or give crank angles"
        )
    return PathInstants(mechanism.start + constant * time, constant, 0.0, time)


def _finite_list(what: str, values: ArrayLike, remedy: str) -> Array:
    array = np.atleast_1d(numbers(values))
    if array.ndim != 1 or not array.size or not np.isfinite(array).all():
        raise InputError(f"{what} must be a list of finite numbers{remedy}")
    return array


def crank_angles(name: str, angles: ArrayLike) -> Array:
    """Return crank angles as (n,) in [rad]; they may be text.

    Raises:
        InputError: if they are no list of finite numbers.
    """
    angles = units.si_angles(angles, f"the crank angles of {name}")
    return _finite_list(f"{name}: crank angles", angles, "; give angles in [rad]")


def crank_motion(
    name: str, angles: ArrayLike, speed: ArrayLike, acceleration: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return crank angles as `crank_angles`, and speeds and accelerations, scalar or (n,) in SI, (n,) each.

    Raises:
        InputError: if a rate is not finite, or of another length.
    """
    angles = crank_angles(name, angles)
    count, rates = len(angles), list[Array]()
    for what, value in (("speed", speed), ("acceleration", acceleration)):
        rate = numbers(value)
        if rate.shape not in ((), (1,), (count,)) or not (np.abs(rate) < HUGE).all():
            raise InputError(
                f"{name}: the crank's {what} must be finite; give one number, or {count}, below {HUGE:g} in "
                "SI"
            )
        rates.append(np.broadcast_to(rate, (count,)))
    return angles, rates[0], rates[1]
