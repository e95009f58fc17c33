"""Limits of joint ranges, path lengths and step counts, the same for both methods."""

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array, unique

# instants per revolution of the crank or the path parameter at which ranges are checked, and their maximum
INSTANTS, MAX_INSTANTS = 256, 65536

# magnitude of a limit from which on there is none: the largest number that MuJoCo accepts (mjMAXVAL)
UNLIMITED = 1e10
Ranges = Mapping[str, tuple[float, float]]
NO_RANGES: Ranges = {}


def check_instants(low: float, high: float) -> Array:
    """Return the path parameters, (n,) in [rad], at which ranges are checked over a motion.

    They depend on the motion only, so that all methods give the same verdict.
    """
    turns = int(np.clip(np.ceil((high - low) / REVOLUTION), 1, MAX_INSTANTS // INSTANTS))
    return np.linspace(low, high, INSTANTS * turns + 1)


def extremes(parameter: Array, values: Iterable[Array]) -> Array:
    """Return the parameters of the extrema of quantities (n,) sampled at evenly spaced instants (n,).

    Each is the vertex of the parabola through three instants; the extreme value has a fourth-order error in
    the spacing.
    """
    peaks: list[Array] = [np.zeros(0)]
    for value in values:
        before, middle, after = value[:-2], value[1:-1], value[2:]
        curvature = after - 2.0 * middle + before
        peak = ((middle - before) * (after - middle) <= 0.0) & (curvature != 0.0)
        share = 0.5 * (before[peak] - after[peak]) / curvature[peak]
        peaks.append(parameter[1:-1][peak] + np.clip(share, -1.0, 1.0) * (parameter[1] - parameter[0]))
    return unique(np.concatenate(peaks))


def require_within(
    name: str,
    ranges: Ranges,
    values: Mapping[str, Array],
    units: Mapping[str, str],
    describe: Callable[[int], str],
    remedy: str,
) -> None:
    """Raise AssemblyError for configurations outside the range of a joint.

    Args:
        name: name of the mechanism.
        ranges: joint -> lower and upper limit in [m] or [rad].
        values: joint -> its values, (n,) in the same unit.
        units: joint -> "m" or "rad".
        describe: index of a configuration -> its label, such as its crank angle.
        remedy: alternative to widening the range.

    Raises:
        AssemblyError: names the joint, its value, its range and the configuration.
    """
    for joint, (low, high) in ranges.items():
        if joint not in values:
            continue
        position = values[joint]
        beyond = np.maximum(low - position, position - high)
        worst = int(np.argmax(beyond)) if len(beyond) else 0
        if len(beyond) and beyond[worst] > ROUNDING * max(1.0, abs(position[worst])):
            raise AssemblyError(
                f"{name}: joint {joint!r} would be at {position[worst]:.6g} {units[joint]}, beyond its "
                f"range of {low:.6g} to {high:.6g}, at {describe(worst)}; widen the range, start within it "
                f"(--start JOINT=VALUE), or {remedy}"
            )


# largest number of revolutions of the fastest driver in one motion; loop equations take 4 ms (four-bar
# linkage) to 40 ms (leg of a humanoid robot) per revolution
MAX_REVOLUTIONS = 1_000.0
# largest number of time steps of a run; a step of a four-bar linkage takes MuJoCo about 3 us
MAX_STEPS = 100_000_000
# the same for a run of an unchanged MJCF scene, at 10 to 100 us per step
MAX_SCENE_STEPS = 2_000_000


def require_revolutions(who: str, revolutions: float, duration: float) -> None:
    """Raise InputError if motion laws take the drivers through too many revolutions.

    Args:
        who: name of the mechanism in the message.
        revolutions: largest travel or number of oscillations of a driver.
        duration: duration of the motion in [s].
    """
    if not revolutions <= MAX_REVOLUTIONS:
        raise InputError(
            f"{who}: the motion laws take a driver through {revolutions:.4g} revolutions or oscillations in "
            f"{duration:g} s; the limit is {MAX_REVOLUTIONS:,.0f} per motion. Give "
            f"a --duration of {_rounded_down(duration * MAX_REVOLUTIONS / revolutions):g} s or less, or "
            "slower laws"
        )


def _rounded_down(value: float) -> float:
    """Return a positive value rounded down to two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit) * unit:.2g}")


def require_travel(who: str, start: str, end: str, travel: float) -> None:
    """Raise InputError if a path is too long to trace.

    Args:
        who: the mechanism and the moving coordinate, for the message.
        start: start of the path, for the message.
        end: end of the path, for the message.
        travel: its length in [rad] of the fastest driver.
    """
    # the margin of 1 rad is for the continuation beyond the end of a motion
    if not travel <= REVOLUTION * MAX_REVOLUTIONS + 1.0:
        raise InputError(
            f"{who} spans {travel / REVOLUTION:,.0f} revolutions, from {start} to {end}; the limit is "
            f"{MAX_REVOLUTIONS:,.0f}. Shorten it {math.ceil(travel / REVOLUTION / MAX_REVOLUTIONS):,} times"
        )


def require_count(what: str, count: int, most: int, remedy: str, least: int = 1) -> None:
    """Raise InputError before work on too few or too many items starts.

    Args:
        what: the items, for the message.
        count: their number.
        most: largest number.
        remedy: what to do about too many.
        least: smallest number.
    """
    if not least <= count <= most:
        remedy = f"give {least} or more" if count < least else remedy
        raise InputError(f"{what} are {count:,}, and {least:,} to {most:,} are allowed; {remedy}")


def require_steps(what: str, steps: float, remedy: str, limit: int = MAX_STEPS) -> None:
    """Raise InputError if a run takes too many time steps.

    Args:
        what: the run, for the message.
        steps: number of time steps.
        remedy: what to do.
        limit: largest number of time steps.
    """
    if not steps <= limit:
        raise InputError(f"{what} needs {steps:.3g} time steps; the limit is {limit:,} per run; {remedy}")
