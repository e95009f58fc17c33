"""Numbers as pictures write them."""

import math

PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}


def prefixed(value: float, unit: str) -> str:
    """Return a quantity with three digits and the prefix that leaves it between 1 and 1000."""
    if not value:
        return f"0 {unit}"
    if not math.isfinite(value):
        return f"{value} {unit}"
    # rounded first, so that 0.9999 m is 1 m and not 1000 mm
    value = float(f"{value:.3g}")
    power = 3 * math.floor(math.log10(abs(value)) / 3.0 + 1e-9)
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return f"{value / 10.0**power:.3g} {PREFIXES[power]}{unit}"
