"""Ranges of joints: one rule for poses, by whichever road they were found."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# what rounding leaves beyond a range, in radians or metres, and in parts of a range that is longer
ROUNDED = 1e-9

# instants in a revolution of the crank or of the path parameter at which ranges are checked, and the most
INSTANTS, MOST_INSTANTS = 256, 65536

Ranges = Mapping[str, tuple[float, float]]


def check_instants(low: float, high: float) -> Array:
    """Return the path parameters, (n,) in [rad], at which joints are checked over a motion.

    They depend on the motion alone, so that all methods give the same verdict, whatever they record.
    """
    turns = int(np.clip(np.ceil((high - low) / TURN), 1, MOST_INSTANTS // INSTANTS))
    return np.linspace(low, high, INSTANTS * turns + 1)


def extremes(at: Array, values: Iterable[Array]) -> Array:
    """Return the parameters between even instants (n,) at which quantities (n,) are largest or smallest.

    A parabola through three instants gives them; the value there errs by the fourth power of the spacing.
    """
    found: list[Array] = [np.zeros(0)]
    for value in values:
        before, here, after = value[:-2], value[1:-1], value[2:]
        bend = after - 2.0 * here + before
        peak = ((here - before) * (after - here) <= 0.0) & (bend != 0.0)
        share = 0.5 * (before[peak] - after[peak]) / bend[peak]
        found.append(at[1:-1][peak] + np.clip(share, -1.0, 1.0) * (at[1] - at[0]))
    return np.unique(np.concatenate(found))


def require_within(
    name: str,
    ranges: Ranges,
    values: Mapping[str, Array],
    units: Mapping[str, str],
    said: Callable[[int], str],
    less: str,
) -> None:
    """Refuse poses beyond the range of a joint.

    Args:
        name: of the mechanism.
        ranges: joint -> lowest and highest value in [m] or [rad].
        values: joint -> (n,) in the same unit.
        units: joint -> "m" or "rad".
        said: says of the number of a pose where it is, as at which crank angle.
        less: what the user may do beside widening the range.

    Raises:
        AssemblyError: with the joint, its value, its bound and where.
    """
    for joint, (low, high) in ranges.items():
        if joint not in values:
            continue
        at = values[joint]
        beyond = np.maximum(low - at, at - high)
        worst = int(np.argmax(beyond)) if len(beyond) else 0
        if len(beyond) and beyond[worst] > ROUNDED * max(1.0, high - low):
            raise AssemblyError(
                f"{name}: joint {joint!r} would stand at {at[worst]:.6g} {units[joint]}, beyond its range of "
                f"{low:.6g} to {high:.6g}, at {said(worst)}; widen the range, start within it, or {less}"
            )
