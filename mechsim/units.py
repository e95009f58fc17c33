"""Quantities as people write them ("13 mm", "600 rpm", "0:360:5deg") to SI numbers, at the edges only.

A number without a unit is SI: metres, radians, radians per second, seconds. `option` declares a field of a
dataclass that people set so.
"""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError, cut

Array = NDArray[np.float64]
Value = TypeVar("Value")
# (unit as written, SI unit) -> how many of the second one of the first is: those written most, so that pint's
# definitions need not be read for them, and others as they are met
FACTORS: dict[tuple[str, str], float] = {
    ("mm", "m"): 1e-3,
    ("cm", "m"): 1e-2,
    ("deg", "rad"): np.pi / 180.0,
    ("rpm", "rad/s"): np.pi / 30.0,
    ("deg/s", "rad/s"): np.pi / 180.0,
    ("mm/s", "m/s"): 1e-3,
    ("ms", "s"): 1e-3,
    ("g", "kg"): 1e-3,
}
Unit = Literal[
    "m",
    "rad",
    "1",
    "rad/s",
    "m/s",
    "s",
    "kg",
    "kg m^2",
    "m/s^2",
    "rad/s^2",
    "N",
    "N m",
    "N/m",
    "N m/rad",
    "N s/m",
    "N m s/rad",
    "V",
    "ohm",
    "N m/A",
]

# more angles than this in one range is a slip of the step, not a wish
MOST_ANGLES = 10_000_000

# letters: no unit needs more, and of no slip is more repeated
LONGEST_UNIT = 60

# what each unit measures, and an example for the sentence that refuses a value
_KINDS: dict[str, tuple[str, str]] = {
    "m": ("a length", "13 mm"),
    "rad": ("an angle", "20 deg"),
    "1": ("a plain number", "0.5"),
    "rad/s": ("a speed of rotation", "600 rpm"),
    "m/s": ("a speed", "20 mm/s"),
    "s": ("a time", "2 ms"),
    "kg": ("a mass", "0.4 kg"),
    "kg m^2": ("a moment of inertia", "2 kg mm^2"),
    "m/s^2": ("an acceleration", "9.81 m/s^2"),
    "rad/s^2": ("an angular acceleration", "5 rad/s^2"),
    "N": ("a force", "20 N"),
    "N m": ("a moment", "3 N mm"),
    "N/m": ("a stiffness", "5 N/mm"),
    "N m/rad": ("a stiffness of turning", "2 N m/rad"),
    "N s/m": ("a damping", "4 N s/m"),
    "N m s/rad": ("a damping of turning", "1e-3 N m s/rad"),
    "V": ("a voltage", "24 V"),
    "ohm": ("an electric resistance", "0.5 ohm"),
    "N m/A": ("a motor's constant", "0.05 N m/A"),
}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)

# a unit is made of a few named ones: pint would take "mm!" and "mm=1" for mm, and reckon m**9**9**9
_NAME = r"(?:[^\W\d_]|[°%])+(?:\s*(?:\*\*|\^)\s*-?\d)?"
_UNIT = re.compile(rf"(?:1\s*/\s*)?{_NAME}(?:\s*[*/·]\s*{_NAME}|\s+{_NAME}){{0,5}}")


def option(
    default: Any,
    doc: str,
    *,
    unit: Unit | None = None,
    read: Callable[[str], Any] | None = None,
    text: str | None = None,
    name: str | None = None,
    metavar: str | None = None,
    many: bool = False,
) -> Any:
    """Declare a field of a dataclass that can be set on the command line.

    Args:
        default: where it is not set.
        doc: what it is, as help and errors show it.
        unit: of a quantity, which may then be written with a unit.
        read: makes the value of what was written, where that is no plain word, number or quantity.
        text: the default as people would write it, where help should show that.
        name: on the command line, where it is not the field's.
        metavar: what stands for the value in help.
        many: whether it may be given several times; the value is a tuple, each written by itself.
    """
    rule = {"doc": doc, "unit": unit, "read": read, "text": text, "name": name, "metavar": metavar}
    return field(default=default, metadata=rule | {"many": many})


# limits of a crank speed in [rad/s]: one revolution a day, and above any shaft
SLOWEST, FASTEST = 1e-4, 1e9


def crank_speed(value: float | str) -> float:
    """Return a crank speed in [rad/s]; raise InputError outside `SLOWEST` to `FASTEST`."""
    speed = float(si(value, "rad/s", "the crank speed"))
    if not SLOWEST <= abs(speed) <= FASTEST:
        raise InputError(
            f"the crank speed is {value}; give one other than 0, between {SLOWEST:g} and {FASTEST:g} rad/s "
            "in either direction, as in 600rpm"
        )
    return speed


def rpm(value: float) -> float:
    """Return revolutions per minute in [rad/s]."""
    return _plain(value, "rpm", "parse_speed") * np.pi / 30.0


def deg(value: float) -> float:
    """Return degrees in [rad]."""
    return _plain(value, "deg", "parse_angle") * np.pi / 180.0


def mm(value: float) -> float:
    """Return millimetres in [m]."""
    return _plain(value, "mm", "parse_length") / 1000.0


def _plain(value: float, unit: str, reader: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InputError(
            f"{unit} is given {value!r}; give a number, or read text by units.{reader}"
        ) from None


def parse(text: str, unit: Unit, name: str = "the value") -> float:
    """Return a quantity given as text in an SI unit.

    Args:
        text: a number with or without a unit; without one it is in `unit` already.
        unit: what is wanted.
        name: what the value is called in the sentence of an error.

    Raises:
        InputError: for what is no finite number or has another dimension.
    """
    _require_text(text, unit, name)
    return _several([text], unit, text, name)[0]


def parse_length(text: str, name: str = "the length") -> float:
    """Return a length in [m]."""
    return parse(text, "m", name)


def parse_angle(text: str, name: str = "the angle") -> float:
    """Return an angle in [rad]."""
    return parse(text, "rad", name)


def parse_speed(text: str, name: str = "the speed") -> float:
    """Return a speed of rotation in [rad/s]."""
    return parse(text, "rad/s", name)


def parse_time(text: str, name: str = "the time") -> float:
    """Return a time in [s]."""
    return parse(text, "s", name)


def si(value: Value | str, unit: Unit, name: str = "the value") -> Value | float:
    """Return a quantity in SI: text is read as by `parse`, all else is returned as it is."""
    return parse(value, unit, name) if isinstance(value, str) else value


def si_angles(value: ArrayLike, name: str = "the angles") -> ArrayLike:
    """Return angles in [rad]: text is read as by `parse_angles`, all else is returned as it is."""
    return parse_angles(value, name) if isinstance(value, str) else value


def require_written(text: str, unit: Unit, declared: str, name: str, rest: str = "") -> None:
    """Reject a bare number other than 0 where the file that it is for declares another unit.

    Args:
        text: one number or several, with commas or colons between, or anything else.
        unit: of the quantity in SI.
        declared: unit that the file declares for such quantities.
        name: what the value is called in the sentence of an error.
        rest: what follows the text where it is part of a longer one.

    Raises:
        InputError: where no number of the text has a unit and one is not 0.
    """
    try:
        values = [float(piece) for piece in re.split("[,:]", text)]
    except ValueError:
        return
    if not any(values) or in_si(1.0, declared, unit) == 1.0:
        return
    text, own = text.strip(), declared.removesuffix("/s")
    raise InputError(
        f"{name}: {text}{rest} has no unit; the file is in {own}: write {text}{declared}{rest}, or "
        f"{text}{unit}{rest} if {unit} is meant"
    )


def parse_vector(text: str, unit: Unit, name: str = "the vector") -> tuple[float, ...]:
    """Return quantities with commas between; the last unit applies to all that have none.

    Raises:
        InputError: as `parse`, for any of them.
    """
    _require_text(text, unit, name)
    return tuple(_several(text.split(","), unit, text, name))


def parse_names(text: str) -> tuple[str, ...]:
    """Return names written with commas between."""
    return tuple(text.split(","))


def parse_angles(text: str, name: str = "the angles") -> Array:
    """Return crank angles in [rad] from `start:stop:step`, both ends included, or from a comma list.

    The last unit applies to all that have none. A step that does not divide the range is followed by
    a shorter last one.

    Raises:
        InputError: as `parse`; also for a step of zero or in the wrong direction.
    """
    _require_text(text, "rad", name)
    if ":" not in text:
        return np.array(_several(text.split(","), "rad", text, name))
    texts = text.split(":")
    if len(texts) != 3:
        raise InputError(f"{name} {text!r} must be start:stop:step, for example 0:360:5deg")
    # counted in the unit as written, where 360 / 5 is a whole number
    numbers, factors = _read(texts, "rad", text, name)
    if len(set(factors)) > 1:
        numbers, factors = [n * f for n, f in zip(numbers, factors, strict=True)], [1.0]
    start, stop, step = numbers
    if start == stop:
        return np.array([start]) * factors[0]
    if step == 0.0 or (stop - start) / step < 0.0:
        raise InputError(f"{name} {text!r} never get from start to stop; give a step such as in 0:360:5deg")
    count = (stop - start) / step
    if not count < MOST_ANGLES:
        raise InputError(f"{name} {text!r} are more than {MOST_ANGLES}; give a longer step, as in 0:360:5deg")
    # a step that misses the end by rounding only is one that meets it
    whole = round(count) if abs(count - round(count)) < 1e-9 * max(1.0, count) else int(count)
    values = start + step * np.arange(whole + 1, dtype=np.float64)
    if whole >= count * (1.0 - 1e-9):
        values[-1] = stop
    else:
        values = np.concatenate([values, [stop]])
    return values * factors[0]


def in_si(value: float, written: str, unit: Unit, name: str = "the value") -> float:
    """Return a number of a unit written as text, in an SI unit.

    Raises:
        InputError: for a unit that is not known or measures something else.
    """
    return _in_si(value, _factor(written, unit, written, name))


def unit_in(text: str) -> str:
    """Return the unit of a quantity as it is written; empty where there is none."""
    match = _QUANTITY.fullmatch(text)
    return match[2] if match else ""


def of_any_kind(text: str, name: str = "the value") -> tuple[float, Unit]:
    """Return a quantity in the SI unit of what it measures, and that unit.

    Raises:
        InputError: for what is no finite number with a known unit.
    """
    kinds: tuple[Unit, ...] = get_args(Unit)
    match = _QUANTITY.fullmatch(text)
    written = match[2] if match else ""
    # of a unit that is known without pint no others need be tried
    for unit in sorted(kinds, key=lambda unit: unit != written and (written, unit) not in FACTORS):
        with suppress(InputError):
            return parse(text, unit, name), unit
    raise InputError(f"{name} {_short(text.strip())!r} is no number with a unit; give one such as '13 mm'")


def _require_text(text: str, unit: Unit, name: str) -> None:
    if unit not in _KINDS:
        raise InputError(f"there is no unit {unit!r} to turn {name} into; known are {', '.join(_KINDS)}")
    if not isinstance(text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        example = _KINDS[unit][1]
        raise InputError(
            f"{name} is {text!r}, which is no text; give text such as {example!r}, or the number"
        )


def _several(texts: list[str], unit: Unit, text: str, name: str) -> list[float]:
    numbers, factors = _read(texts, unit, text, name)
    values = [_in_si(number, factor) for number, factor in zip(numbers, factors, strict=True)]
    if not all(abs(value) < np.inf for value in values):
        raise _unit_error(text, unit, name, "is too large")
    return values


def _in_si(number: float, factor: float) -> float:
    # 13 / 1000 is the number nearest to 0.013, 13 * 0.001 is its neighbour
    inverse = round(1.0 / factor) if factor < 1.0 else 0
    return number / inverse if inverse and 1.0 / inverse == factor else number * factor


def _read(texts: list[str], unit: Unit, text: str, name: str) -> tuple[list[float], list[float]]:
    """Return the numbers as written and the factor to SI of each; the last unit stands for missing ones."""
    pairs = [_split(piece, unit, text, name) for piece in texts]
    last = pairs[-1][1]
    return [number for number, _ in pairs], [_factor(own or last, unit, text, name) for _, own in pairs]


def _split(piece: str, unit: Unit, text: str, name: str) -> tuple[float, str]:
    """Return the number and the unit as written; the unit may be empty."""
    match = _QUANTITY.fullmatch(piece)
    number = float(match[1]) if match else np.nan
    if match is None or not abs(number) < np.inf:
        what = "is" if piece == text else f"holds {_short(piece.strip())!r}, which is"
        raise _unit_error(text, unit, name, f"{what} not a finite number with a unit")
    return number, match[2]


@cache
def _registry() -> Any:
    # pint takes a third of a second to read its definitions: only when a unit is really written
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("@alias turn = rev")
    return registry


def _factor(written: str, unit: Unit, text: str, name: str) -> float:
    """Return how many of `unit` one of the written unit is."""
    if written in ("", unit):
        return 1.0
    if (written, unit) not in FACTORS:
        FACTORS[written, unit] = converted(written, unit, text, name)
    return FACTORS[written, unit]


def converted(written: str, unit: Unit, text: str, name: str) -> float:
    """Return the factor from a written unit to an SI unit, as pint has it."""
    if len(written) > LONGEST_UNIT or not _UNIT.fullmatch(written):
        raise _unit_error(text, unit, name, f"has unit {_short(written)!r}, which is not known")
    registry = _registry()
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(written)).to_root_units()
    except Exception:  # pint's parser lets errors of every kind through for what is no unit
        raise _unit_error(text, unit, name, f"has unit {written!r}, which is not known") from None
    target = registry.Unit("dimensionless" if unit == "1" else unit)
    # pint takes an angle for a plain number, so that 1 Hz would be 1 rad/s and 1 mm/m an angle
    turns = ("radian" in str(quantity.units)) == ("rad" in unit)
    if not turns or not quantity.is_compatible_with(target):
        raise _unit_error(text, unit, name, f"has unit {written!r}, which does not measure that")
    return float(quantity.to(target).magnitude)


def _unit_error(text: str, unit: Unit, name: str, what: str) -> InputError:
    kind, example = _KINDS[unit]
    return InputError(f"{name} {_short(text.strip())!r} {what}; give {kind} such as {example!r}")


def _short(text: str) -> str:
    return cut(text, 4 * LONGEST_UNIT)


@dataclass(frozen=True, slots=True)
class WrittenUnits:
    """The units of bare numbers in a file, as written there.

    Attributes:
        length: such as "mm"; "m" where the file declares none.
        angle: such as "deg"; "rad" where the file declares none.
    """

    length: str = "m"
    angle: str = "rad"

    def declared(self, unit: str) -> str:
        """Return the unit declared for quantities of an SI unit, "m" or "rad"; of all others the SI unit."""
        return {"m": self.length, "rad": self.angle}.get(unit, unit)
