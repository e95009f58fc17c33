"""Ranges of joints: one rule for poses, by whichever road they were found."""

from collections.abc import Callable, Mapping

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array

# what rounding leaves beyond a range, in radians or metres, and in parts of a range that is longer
ROUNDED = 1e-9

Ranges = Mapping[str, tuple[float, float]]


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
