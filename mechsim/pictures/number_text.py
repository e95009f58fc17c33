"""Number formats of plots, pictures and pages."""

import math

import numpy as np
from numpy.typing import ArrayLike

PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# angle in [rad] below which differences are in mrad and µrad
SMALL_ANGLE = 1e-3
# units that take no prefix
WITHOUT_PREFIX = ("kg", "1")


def power_of_ten(exponent: int) -> str:
    """Return a power of ten as plain text: 10⁻⁶."""
    return "10" if exponent == 1 else f"10{str(exponent).translate(SUPERSCRIPTS)}"


def number(value: float | None) -> str:
    """Return a number with three or four digits, very large or small ones with a power of ten."""
    if value is None or not math.isfinite(value):
        return "not a number"
    if value == 0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{int(value):,}".replace(",", "\u202f")  # a narrow space between thousands
    if 1e-3 <= abs(value) < 1e4:
        return f"{value:.4g}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}·{power_of_ten(int(exponent))}"


def prefixed(value: float, unit: str) -> str:
    """Return a quantity with three digits and the prefix for which it lies between 1 and 1000."""
    if not value:
        return f"0 {unit}"
    if not math.isfinite(value):
        return f"{value} {unit}"
    # rounded first, so that 0.9999 m becomes 1 m, not 1000 mm
    value = float(f"{value:.3g}")
    power = 3 * math.floor(math.log10(abs(value)) / 3.0 + 1e-9)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return f"{value / 10.0**power:.3g} {PREFIXES[power]}{unit}"


def quantity_text(value: float, unit: str) -> str:
    """Return a quantity with the prefix of its unit that gives a readable number; angles in degrees."""
    if unit == "rad" and abs(value) >= 1e-6:
        return f"{math.degrees(value):.3g}°"
    if unit.startswith(WITHOUT_PREFIX) or not 1e-9 <= abs(value) < 1e6:
        return f"{value:.3g} {unit}" if unit != "1" else f"{value:.3g}"
    return prefixed(value, unit)


def readable(values: ArrayLike, unit: str) -> tuple[float, str]:
    """Return a factor and the resulting unit, for which the numbers of an axis are short."""
    largest = float(np.nanmax(np.abs(np.asarray(values)), initial=0.0))
    if unit.startswith(WITHOUT_PREFIX):
        return 1.0, unit
    if unit == "rad" and not 0.0 < largest < SMALL_ANGLE:
        return math.pi / 180.0, "°"
    for power in (0, -3, -6):
        if largest >= 0.5 * 10.0**power or largest == 0.0:
            return float(f"1e{power}"), PREFIXES[power] + unit
    return 1e-6, PREFIXES[-6] + unit
