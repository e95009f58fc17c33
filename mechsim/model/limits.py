"""Ranges of joints: one rule for poses of either method."""

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array

# what rounding leaves beyond a range, in radians or metres, and in parts of a range that is longer
ROUNDED = 1e-9

# instants in a revolution of the crank or of the path parameter at which ranges are checked, and the most
INSTANTS, MOST_INSTANTS = 256, 65536

Ranges = Mapping[str, tuple[float, float]]
NO_RANGES: Ranges = {}


def check_instants(low: float, high: float) -> Array:
    """Return the path parameters, (n,) in [rad], at which joints are checked over a motion.

    They depend on the motion alone, so that all methods give the same verdict, whatever they record.
    """
    turns = int(np.clip(np.ceil((high - low) / REVOLUTION), 1, MOST_INSTANTS // INSTANTS))
    return np.linspace(low, high, INSTANTS * turns + 1)


def extremes(parameter: Array, values: Iterable[Array]) -> Array:
    """Return the parameters between even instants (n,) at which quantities (n,) are largest or smallest.

    A parabola through three instants gives them; the value there errs by the fourth power of the spacing.
    """
    peaks: list[Array] = [np.zeros(0)]
    for value in values:
        before, middle, after = value[:-2], value[1:-1], value[2:]
        curvature = after - 2.0 * middle + before
        peak = ((middle - before) * (after - middle) <= 0.0) & (curvature != 0.0)
        share = 0.5 * (before[peak] - after[peak]) / curvature[peak]
        peaks.append(parameter[1:-1][peak] + np.clip(share, -1.0, 1.0) * (parameter[1] - parameter[0]))
    return np.unique(np.concatenate(peaks))


def require_within(
    name: str,
    ranges: Ranges,
    values: Mapping[str, Array],
    units: Mapping[str, str],
    describe: Callable[[int], str],
    remedy: str,
) -> None:
    """Refuse poses beyond the range of a joint.

    Args:
        name: of the mechanism.
        ranges: joint -> lowest and highest value in [m] or [rad].
        values: joint -> (n,) in the same unit.
        units: joint -> "m" or "rad".
        describe: index of a pose -> its label, such as its crank angle.
        remedy: what the user may do besides widening the range.

    Raises:
        AssemblyError: with the joint, its value, its bound and where.
    """
    for joint, (low, high) in ranges.items():
        if joint not in values:
            continue
        position = values[joint]
        beyond = np.maximum(low - position, position - high)
        worst = int(np.argmax(beyond)) if len(beyond) else 0
        if len(beyond) and beyond[worst] > ROUNDED * max(1.0, high - low):
            raise AssemblyError(
                f"{name}: joint {joint!r} would stand at {position[worst]:.6g} {units[joint]}, beyond its "
                f"range of {low:.6g} to {high:.6g}, at {describe(worst)}; widen the range, start within it, "
                f"or {remedy}"
            )


# revolutions of the fastest driver in one motion; loop equations take 4 ms (four-bar linkage) to 40 ms (leg
# of a humanoid robot) to follow one
MAX_REVOLUTIONS = 1_000.0
# time steps of one run; MuJoCo takes about 3 us for one of a four-bar linkage
MAX_STEPS = 100_000_000
# of one free run whose motor or damping is so stiff that it, not the motion, limits explicit steps
MAX_STIFF_STEPS = 500_000
# of one run of an MJCF scene as it is, at 10 to 100 us each
MAX_SCENE_STEPS = 2_000_000


def require_revolutions(who: str, revolutions: float, duration: float) -> None:
    """Raise InputError where motion laws take the drivers through too many revolutions.

    Args:
        who: the mechanism, as the sentence names it.
        revolutions: the longest way or the number of oscillations of any driver.
        duration: of the motion in [s].
    """
    if not revolutions <= MAX_REVOLUTIONS:
        raise InputError(
            f"{who}: the motion laws take the drivers through {revolutions:.4g} revolutions or oscillations "
            f"in {duration:g} s, and {MAX_REVOLUTIONS:,.0f} are the limit of one motion; give a --duration "
            f"of {_rounded_down(duration * MAX_REVOLUTIONS / revolutions):g} s or less, or slower laws"
        )


def _rounded_down(value: float) -> float:
    """Return a positive value with two significant digits, no larger than it is."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit) * unit:.2g}")


def require_travel(who: str, start: str, end: str, travel: float) -> None:
    """Raise InputError where a path is too long to be followed.

    Args:
        who: the mechanism and what moves, as the sentence names them.
        start: where the path starts, as the sentence names it.
        end: where it ends.
        travel: its length in [rad] of the fastest driver.
    """
    # what is looked at beyond the end of a motion is no part of it
    if not travel <= REVOLUTION * MAX_REVOLUTIONS + 1.0:
        raise InputError(
            f"{who} would be followed from {start} to {end}, {travel / REVOLUTION:,.0f} revolutions, and "
            f"{MAX_REVOLUTIONS:,.0f} are the limit of one motion; ask for a motion "
            f"{math.ceil(travel / REVOLUTION / MAX_REVOLUTIONS):,} times shorter"
        )


def require_steps(what: str, steps: float, remedy: str, limit: int = MAX_STEPS) -> None:
    """Raise InputError where a run takes too many time steps.

    Args:
        what: takes them, as the sentence names it.
        steps: how many.
        remedy: what to do.
        limit: of time steps.
    """
    if not steps <= limit:
        raise InputError(
            f"{what} takes {steps:.3g} time steps, and {limit:,} are the limit of one run; {remedy}"
        )
