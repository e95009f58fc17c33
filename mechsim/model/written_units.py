"""The units that a file declares for numbers without one."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WrittenUnits:
    """The units of bare numbers in a file, as written there.

    Attributes:
        length: such as "mm"; "m" where the file declares none.
        angle: such as "deg"; "rad" where the file declares none.
    """

    length: str = "m"
    angle: str = "rad"

    def of(self, unit: str) -> str:
        """Return the unit declared for quantities of an SI unit, "m" or "rad"; of all others the SI unit."""
        return {"m": self.length, "rad": self.angle}.get(unit, unit)
