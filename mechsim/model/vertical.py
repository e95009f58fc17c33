"""Which coordinate axis of a mechanism points up: opposite to gravity, or as its description states."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[Up, ...] = ("x", "y", "z", "-x", "-y", "-z")


def against(gravity: Sequence[float]) -> Up | None:
    """Return the coordinate axis nearest to the direction opposite to gravity; None without gravity."""
    largest = int(np.argmax(np.abs(gravity)))
    if not abs(gravity[largest]) > 0.0:
        return None
    return AXES[largest] if gravity[largest] < 0.0 else AXES[3 + largest]


def unit_vector(up: Up) -> Array:
    """Return the unit vector of an axis, (3,)."""
    return np.eye(3)["xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0)


def require_axis(who: str, up: object) -> None:
    """Raise InputError for what names no coordinate axis; None is allowed."""
    if up is not None and up not in AXES:
        raise InputError(f"{who}: up is {up!r}; it can be {', '.join(AXES)}")
