"""Tolerances of a verdict, each with its reason.

A tolerance lies between the measured error and the effect of the smallest relevant mistake. A link that is
0.1 % too long moves a point of any catalogue mechanism by 1e-3 of the crank's stroke or more. An error of 0.1
% in the mass of a link changes torque, forces and energies of any mechanism by more than 1e-5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import EPS, Array

# conditioning of the loops below which tolerances widen. Measured over random mechanisms:
# validation/robustness/bounds.py
WELL_CONDITIONED = 0.1
# start of the reason of a tolerance relative to a measured scale
FRACTION_OF = "{part:.0e} of {scale:.3g} {unit}; "


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A tolerance, its unit and its reason.

    Attributes:
        value: tolerance for well-conditioned loops.
        unit: unit of the value; "1" is a fraction of a quantity's scale.
        reason: reason of the value.
        power: the tolerance is divided by this power of (conditioning / `WELL_CONDITIONED`) if that is below
            1.
    """

    value: float
    unit: str
    reason: str
    power: int = 0

    def widened(self, conditioning: Array | None, count: int) -> Array:
        """Return the tolerance at each of `count` instants with their conditioning, (n,)."""
        if conditioning is None or not self.power:
            return np.full(count, self.value)
        return self.value * np.maximum(1.0, WELL_CONDITIONED / np.maximum(conditioning, EPS)) ** self.power


# the error of a pose is rounding divided by the conditioning, that of rates by its square: measured 0.5 times
# this for closed forms of random four-bars at conditioning 1e-8 to 1e-4, mostly 0.3 and at most 70 for loop
# equations: tests/cli/test_conditioning.py
RATES = Tolerance(
    EPS / WELL_CONDITIONED**2,
    "1",
    "accelerations relative to their magnitude: rounding over conditioning²",
    power=2,
)


@dataclass(frozen=True, slots=True)
class Requested:
    """The requested tolerance of a run.

    Attributes:
        tolerance: requested tolerance; 0 for no request.
        scale: scale of its quantity, in the unit of the tolerance.
    """

    tolerance: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class ToleranceRule:
    """A rule for a tolerance, from a quantity's scale and the requested tolerance.

    Attributes:
        reason: text with {part}, the tolerance relative to the scale, {scale} and {unit}.
        fixed: fraction of the scale that is always allowed.
        requested: multiple of the requested tolerance that is allowed.
        power: power of the conditioning, as in `Tolerance`.
        scale: scale of the fixed fraction; empty for that of the quantity.
    """

    reason: str
    fixed: float = 0.0
    requested: float = 0.0
    power: int = 0
    scale: str = ""

    def tolerance(self, unit: str, scale: float, requested: Requested) -> Tolerance:
        """Return the tolerance of a quantity with a scale in its unit."""
        fraction = max(self.fixed, self.requested * requested.tolerance / requested.scale)
        tolerance = max(
            self.fixed * scale, self.requested * (requested.tolerance * (scale / requested.scale))
        )
        reason = self.reason.format(part=fraction, scale=scale, unit=unit)
        return Tolerance(tolerance, unit, reason, self.power)


# rows of a table without times
InstantUnit = Literal["rad", "s", "row"]


@dataclass(frozen=True, slots=True)
class RecordInstants:
    """The instants of a record.

    Attributes:
        value: crank angle in [rad], time in [s], or row number of a table from 1, (n,).
        unit: unit of the values.
    """

    value: Array
    unit: InstantUnit


def instants_of(record: Any) -> RecordInstants:
    """Return the instants of a motion or a force record.

    The angle of a record under motion laws is an internal path parameter; its times are used instead.
    """
    drives: Mapping[str, Array] = getattr(record, "drives", {})
    laws = record.drivers if isinstance(record, Motion) else drives
    if laws and record.time is not None:
        return RecordInstants(record.time, "s")
    return RecordInstants(record.angle, "rad")


def instant_text(value: float, unit: InstantUnit) -> str:
    """Return an instant in words."""
    return {"rad": f"crank angle {value:.4f} rad", "s": f"t = {value:.4f} s", "row": f"row {value:g}"}[unit]
