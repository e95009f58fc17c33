"""What names the instants of a record: crank angles, or times where motion laws drive."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array

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
