"""Bounds with reasons: what a verdict allows, and why.

A bound lies between the error measured and the effect of the smallest mistake worth catching: a link
0.1 % long moves a point of any catalogue mechanism by 1e-3 of the crank's stroke or more; a link's mass
0.1 % off changes torque, forces and energies of every one by more than 1e-5.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array

EPS = 2.0**-52
# conditioning of the loops from which they count as sound: below it bounds widen. Measured over random
# drives: validation/robustness/bounds.py
WELL_CONDITIONED = 0.1
# turns over which errors of a free run are bounded; over more they may grow
FREE_TURNS = 10.0
# before the reason of a bound that is a part of something measured
FRACTION_OF = "{part:.0e} of {scale:.3g} {unit}; "


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A bound, its unit, and the reason it is what it is.

    Attributes:
        value: where the loops are well conditioned.
        unit: of the bound; "1" is a part of a quantity's scale.
        reason: for the value.
        power: of the loops' conditioning, in units of `SOUND`, by which it widens where that is less.
    """

    value: float
    unit: str
    reason: str
    power: int = 0

    def widened(self, conditioning: Array | None, count: int) -> Array:
        """Return the bound at each of so many instants of known conditioning, (n,)."""
        if conditioning is None or not self.power:
            return np.full(count, self.value)
        return self.value * np.maximum(1.0, WELL_CONDITIONED / np.maximum(conditioning, EPS)) ** self.power


# rounding over the conditioning moves a pose, that over it once more its rates: measured 0.5 times this for
# closed forms of random four-bars at conditioning 1e-8 to 1e-4, mostly 0.3 and up to 70 for loop equations:
# tests/cli/test_conditioning.py
RATES = Tolerance(
    EPS / WELL_CONDITIONED**2,
    "1",
    "accelerations beside their own size: rounding over conditioning²",
    power=2,
)


@dataclass(frozen=True, slots=True)
class Requested:
    """What a run was asked to keep, and how long it was.

    Attributes:
        tolerance: asked for; 0 where nothing was.
        of: what it is a part of, in its unit.
        turns: of a free crank.
    """

    tolerance: float = 0.0
    of: float = 1.0
    turns: float = 0.0


@dataclass(frozen=True, slots=True)
class ToleranceRule:
    """How a tolerance follows from a quantity's scale and from what was asked.

    Attributes:
        reason: {part}, {scale} and {unit} stand for the bound as a part of the scale, and that.
        fixed: part of the scale that is allowed in any case.
        requested: multiple of the requested tolerance that is allowed.
        growth: power of the turns, beyond `FREE_TURNS`, by which the fixed part grows.
        power: of the conditioning, as in `Tolerance`.
        scale: what the fixed part is a part of, where that is not the quantity's own.
    """

    reason: str
    fixed: float = 0.0
    requested: float = 0.0
    growth: int = 0
    power: int = 0
    scale: str = ""

    def tolerance(self, unit: str, scale: float, asked: Requested) -> Tolerance:
        """Return the tolerance of a quantity with a scale in its unit."""
        fixed = self.fixed * max(1.0, abs(asked.turns) / FREE_TURNS) ** self.growth
        part = max(fixed, self.requested * asked.tolerance / asked.of)
        bound = max(fixed * scale, self.requested * (asked.tolerance * (scale / asked.of)))
        return Tolerance(bound, unit, self.reason.format(part=part, scale=scale, unit=unit), self.power)


# rows are those of a table without times
InstantUnit = Literal["rad", "s", "row"]


@dataclass(frozen=True, slots=True)
class RecordInstants:
    """The instants of a record.

    Attributes:
        value: crank angle in [rad], time in [s], or row of a table counted from 1, (n,).
        unit: which of them.
    """

    value: Array
    unit: InstantUnit


def instants_of(record: Any) -> RecordInstants:
    """Return the instants of a motion, efforts or a free run.

    The angle of a record under motion laws is an internal path parameter, so its times stand for it.
    """
    drives: Mapping[str, Array] = getattr(record, "drives", {})
    laws = record.drivers if isinstance(record, Motion) else drives
    if laws and record.time is not None:
        return RecordInstants(record.time, "s")
    return RecordInstants(record.angle, "rad")


def instant_text(value: float, unit: InstantUnit) -> str:
    """Return an instant in words."""
    return {"rad": f"crank angle {value:.4f} rad", "s": f"t = {value:.4f} s", "row": f"row {value:g}"}[unit]
