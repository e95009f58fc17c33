"""Units as powers of kg, m, s and rad."""

import re
from collections.abc import Sequence

import numpy as np

Powers = tuple[float, ...]
PLAIN: Powers = (0.0, 0.0, 0.0, 0.0)

# base units of a derived unit: powers of kg, m, s and rad
_POWERS: dict[str, Powers] = {
    "1": (0, 0, 0, 0),
    "kg": (1, 0, 0, 0),
    "m": (0, 1, 0, 0),
    "s": (0, 0, 1, 0),
    "rad": (0, 0, 0, 1),
    "N": (1, 1, -2, 0),
    "J": (1, 2, -2, 0),
    "W": (1, 2, -3, 0),
}
_NAMED = ("1", "m", "rad", "m/s", "rad/s", "m/s2", "rad/s2", "N", "N m", "W", "kg m2", "kg", "s")
_DESCRIPTIONS = {
    "1": "a plain number",
    "m": "a length",
    "rad": "an angle",
    "N": "a force",
    "N m": "a moment",
}


def unit_powers(unit: str) -> Powers:
    """Return the powers of kg, m, s and rad in a unit as "N m" or "m/s2"."""
    total = np.zeros(4)
    above, _, below = unit.partition("/")
    for sign, side in ((1.0, above), (-1.0, below)):
        for factor in side.split():
            match = re.fullmatch(r"([A-Za-z1]+?)(-?\d*)", factor)
            assert match is not None
            total += sign * float(match[2] or 1) * np.array(_POWERS[match[1]])
    return tuple(total.tolist())


def unit_text(powers: Sequence[float]) -> str:
    """Return the unit of powers of kg, m, s and rad, by its usual name where it has one."""
    if powers[0]:
        # torque times angle is work
        powers = (*powers[:3], 0.0)
    named = {unit_powers(unit): unit for unit in reversed(_NAMED)}
    factors = [
        f"{base}{power:g}" if power != 1.0 else base
        for base, power in zip(("kg", "m", "s", "rad"), powers, strict=True)
        if power
    ]
    return named.get(tuple(powers), " ".join(factors))


def without_time(powers: Sequence[float]) -> Powers:
    """Return powers of kg, m, s and rad as in expressions of t, where time counts as a plain number."""
    mass, length, _, angle = powers
    return (mass, length, 0.0, angle)


def described(powers: Sequence[float]) -> str:
    """Return what a value with powers of kg, m, s and rad measures, in words."""
    for unit, description in _DESCRIPTIONS.items():
        if tuple(powers) in (unit_powers(unit), without_time(unit_powers(unit))):
            return description
    return f"a value in {unit_text(powers)}"
