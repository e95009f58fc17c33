"""Conversion of quantities in text ("13 mm", "600 rpm", "0:360:5deg") to SI numbers, for user input only.

A number without a unit is in SI: metres, radians, radians per second, seconds. `option` declares a field of a
dataclass that users can set in this form.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError, cut

Array = NDArray[np.float64]
Value = TypeVar("Value")
# (unit as written, SI unit) -> factor to SI of frequent units, which saves reading pint's definitions; other
# factors are added when used
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
    "A",
    "ohm",
    "H",
    "N m/A",
    "N/m^2",
]

# unit of a coordinate -> units of quantities along it
ALONG: dict[str, dict[str, Unit]] = {
    "m": {"rate": "m/s", "force": "N", "stiffness": "N/m", "damping": "N s/m"},
    "rad": {"rate": "rad/s", "force": "N m", "stiffness": "N m/rad", "damping": "N m s/rad"},
}

# ratio of a number in SI to the number that it replaces, and of a position to the size of the mechanism,
# above which it was probably given in another unit: a value in mm read as metres is 1,000 times too large
IMPLAUSIBLE, IMPLAUSIBLE_SIZES = 100.0, 10.0

# largest number of angles in a range; more is an error of the step
MAX_ANGLES = 10_000_000

# largest number of characters of a unit, also in messages
MAX_UNIT_LENGTH = 60

# quantity of each unit, and an example for error messages
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
    "N m/rad": ("a torsional stiffness", "2 N m/rad"),
    "N s/m": ("a damping", "4 N s/m"),
    "N m s/rad": ("a torsional damping", "1e-3 N m s/rad"),
    "V": ("a voltage", "24 V"),
    "A": ("a current", "1.5 A"),
    "ohm": ("an electric resistance", "0.5 ohm"),
    "H": ("an inductance", "1 mH"),
    "N m/A": ("a motor constant", "0.05 N m/A"),
    "N/m^2": ("a modulus of elasticity", "207 GPa"),
}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)

# a unit is a product of few names: pint would accept "mm!" and "mm=1" as mm, and evaluate m**9**9**9
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
    """Declare an option of the command line: a field of a dataclass, or the default of a command's parameter.

    Args:
        default: default value; `dataclasses.MISSING` for an option that must be given.
        doc: description for help and errors.
        unit: unit of a quantity, which can then be written with a unit.
        read: returns the value of the text, if it is no plain word, number or quantity.
        text: default value as text for help, if it differs.
        name: name on the command line, if it is not the field's.
        metavar: placeholder of the value in help.
        many: whether the option can be repeated; the value is then a tuple.
    """
    rule = {"doc": doc, "unit": unit, "read": read, "text": text, "name": name, "metavar": metavar}
    return field(default=default, metadata=rule | {"many": many})


# limits of a crank speed in [rad/s]: one revolution a day, and above that of any shaft
MIN_CRANK_SPEED, MAX_CRANK_SPEED = 1e-4, 1e9


def crank_speed(value: float | str) -> float:
    """Return a crank speed in [rad/s]; raise InputError outside `MIN_CRANK_SPEED` to `MAX_CRANK_SPEED`."""
    speed = float(si(value, "rad/s", "the crank speed"))
    if not MIN_CRANK_SPEED <= abs(speed) <= MAX_CRANK_SPEED:
        raise InputError(
            f"the crank speed is {value}; give one other than 0, between {MIN_CRANK_SPEED:g} and "
            f"{MAX_CRANK_SPEED:g} rad/s in either direction, as in 600rpm"
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
        text: a number with or without a unit; the default unit is `unit`.
        unit: the SI unit.
        name: name of the value in error messages.

    Raises:
        InputError: for text that is no finite number or has another dimension.
    """
    _require_text(text, unit, name)
    return _several([text], unit, text, name)[0]


def parse_length(text: str, name: str = "the length") -> float:
    """Return a length in [m]."""
    return parse(text, "m", name)


def parse_tolerance(text: str) -> float:
    """Return a tolerance of positions in [m]; one of 1 or more needs its unit."""
    value = parse_length(text, "the tolerance")
    if value >= 1.0 and not unit_in(text):
        raise InputError(f"the tolerance {text} is in m; write {text}um, or {text}m if that is meant")
    return value


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
    """Return a quantity in SI: text is read by `parse`, other values are returned unchanged."""
    return parse(value, unit, name) if isinstance(value, str) else value


def si_angles(value: ArrayLike, name: str = "the angles") -> ArrayLike:
    """Return angles in [rad]: text is read by `parse_angles`, other values are returned unchanged."""
    return parse_angles(value, name) if isinstance(value, str) else value


def require_written(
    text: str, unit: Unit, declared: str, name: str, rest: str = "", *, length: float = np.inf
) -> None:
    """Raise InputError for a number without a unit, other than 0, if its file declares another unit than SI.

    Also for a length that is implausible in SI.

    Args:
        text: one or several numbers, separated by commas or colons, or any other text.
        unit: SI unit of the quantity.
        declared: unit that the file declares for such quantities.
        name: name of the value in error messages.
        rest: text after the numbers if they are part of a longer one.
        length: characteristic length of the mechanism in [m], above `IMPLAUSIBLE_SIZES` times which a
            length is rejected.
    """
    try:
        values = [float(piece) for piece in re.split("[,:]", text)]
    except ValueError:
        return
    text, own = text.strip(), declared.removesuffix("/s")
    if in_si(1.0, declared, unit) == 1.0:
        if unit == "m" and max(map(abs, values)) > IMPLAUSIBLE_SIZES * length:
            raise InputError(
                f"{name}: {text}{rest} is in m, and the mechanism has a size of {length:.3g} m; write "
                f"{text}mm{rest}, or {text}m{rest} if that is meant"
            )
        return
    if not any(values):
        return
    raise InputError(
        f"{name}: {text}{rest} has no unit; the file is in {own}: write {text}{declared}{rest} "
        f"or {text}{unit}{rest}"
    )


def parse_vector(text: str, unit: Unit, name: str = "the vector") -> tuple[float, ...]:
    """Return quantities separated by commas; the last unit applies to all without a unit.

    Raises:
        InputError: as `parse`, for any of them.
    """
    _require_text(text, unit, name)
    return tuple(_several(text.split(","), unit, text, name))


def parse_names(text: str) -> tuple[str, ...]:
    """Return names separated by commas."""
    return tuple(text.split(","))


def parse_angles(text: str, name: str = "the angles") -> Array:
    """Return crank angles in [rad] from `start:stop:step`, both ends included, or from a comma list.

    The last unit applies to all numbers without a unit. If the step does not divide the range, the last step
    is shorter.

    Raises:
        InputError: as `parse`; also for a step of zero or in the wrong direction.
    """
    _require_text(text, "rad", name)
    if ":" not in text:
        return np.array(_several(text.split(","), "rad", text, name))
    texts = text.split(":")
    if len(texts) != 3:
        raise InputError(f"{name} {text!r} must be start:stop:step, for example 0:360:5deg")
    # count in the unit as written, in which 360 / 5 is an integer
    numbers, factors = _read(texts, "rad", text, name)
    if len(set(factors)) > 1:
        numbers, factors = [n * f for n, f in zip(numbers, factors, strict=True)], [1.0]
    start, stop, step = numbers
    if start == stop:
        return np.array([start]) * factors[0]
    if step == 0.0 or (stop - start) / step < 0.0:
        raise InputError(f"{name} {text!r} never get from start to stop; give a step such as in 0:360:5deg")
    count = (stop - start) / step
    if not count < MAX_ANGLES:
        raise InputError(f"{name} {text!r} are more than {MAX_ANGLES}; give a longer step, as in 0:360:5deg")
    # a step that misses the end by rounding reaches it
    whole = round(count) if abs(count - round(count)) < 1e-9 * max(1.0, count) else int(count)
    values = start + step * np.arange(whole + 1, dtype=np.float64)
    if whole >= count * (1.0 - 1e-9):
        values[-1] = stop
    else:
        values = np.concatenate([values, [stop]])
    return values * factors[0]


def in_si(value: float, written: str, unit: Unit, name: str = "the value") -> float:
    """Return a number with a unit given as text in an SI unit.

    Raises:
        InputError: for an unknown unit or one of another dimension.
    """
    return _in_si(value, _factor(written, unit, written, name))


def unit_in(text: str) -> str:
    """Return the unit of a quantity as written; empty if it has none."""
    match = _QUANTITY.fullmatch(text)
    return match[2] if match else ""


def of_any_kind(text: str, name: str = "the value") -> tuple[float, Unit]:
    """Return a quantity in SI and its SI unit, whatever its dimension.

    Raises:
        InputError: for text that is no finite number with a known unit.
    """
    kinds: tuple[Unit, ...] = get_args(Unit)
    match = _QUANTITY.fullmatch(text)
    written = match[2] if match else ""
    # try the units that are known without pint first
    for unit in sorted(kinds, key=lambda unit: unit != written and (written, unit) not in FACTORS):
        with suppress(InputError):
            return parse(text, unit, name), unit
    raise InputError(f"{name} {_short(text.strip())!r} is no number with a unit; give one such as '13 mm'")


def _require_text(text: str, unit: Unit, name: str) -> None:
    if unit not in _KINDS:
        raise InputError(f"{name} cannot be converted to {unit!r}; choose from {', '.join(_KINDS)}")
    if not isinstance(text, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        example = _KINDS[unit][1]
        raise InputError(
            f"{name} must be text such as {example!r}, or a number, not {type(text).__name__} ({text!r})"
        )


def _several(texts: list[str], unit: Unit, text: str, name: str) -> list[float]:
    numbers, factors = _read(texts, unit, text, name)
    values = [_in_si(number, factor) for number, factor in zip(numbers, factors, strict=True)]
    if not all(abs(value) < np.inf for value in values):
        raise _unit_error(text, unit, name, "is too large")
    return values


def _in_si(number: float, factor: float) -> float:
    # 13 / 1000 is the number nearest to 0.013, 13 * 0.001 is not
    inverse = round(1.0 / factor) if factor < 1.0 else 0
    return number / inverse if inverse and 1.0 / inverse == factor else number * factor


def _read(texts: list[str], unit: Unit, text: str, name: str) -> tuple[list[float], list[float]]:
    """Return the numbers as written and their factors to SI; the last unit applies to those without one."""
    pairs = [_split(piece, unit, text, name) for piece in texts]
    last, stated = pairs[-1][1], next((own for _, own in pairs if own), "")
    if stated and not last and any(number for number, own in pairs if not own):
        raise InputError(f"{name}: {text!r} has units, but not at its last number; write {text}{stated}")
    return [number for number, _ in pairs], [_factor(own or last, unit, text, name) for _, own in pairs]


def _split(piece: str, unit: Unit, text: str, name: str) -> tuple[float, str]:
    """Return the number and the unit as written; the unit can be empty."""
    match = _QUANTITY.fullmatch(piece)
    number = float(match[1]) if match else np.nan
    if match is None or not abs(number) < np.inf:
        what = "is" if piece == text else f"holds {_short(piece.strip())!r}, which is"
        raise _unit_error(text, unit, name, f"{what} not a finite number with a unit")
    return number, match[2]


@cache
def _registry() -> Any:
    # pint takes a third of a second to read its definitions, so import it only for units it must convert
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("@alias turn = rev")
    registry.define("newton_meter = newton * meter = Nm")
    return registry


def _factor(written: str, unit: Unit, text: str, name: str) -> float:
    """Return the factor from the written unit to `unit`."""
    if written in ("", unit):
        return 1.0
    if (written, unit) not in FACTORS:
        FACTORS[written, unit] = converted(written, unit, text, name)
    return FACTORS[written, unit]


def converted(written: str, unit: Unit, text: str, name: str) -> float:
    """Return the factor from a written unit to an SI unit, by pint."""
    # a power without its sign, as in kg m2
    written = re.sub(r"(?<=[^\W\d_])([23])\b", r"^\1", written)
    if len(written) > MAX_UNIT_LENGTH or not _UNIT.fullmatch(written):
        raise _unit_error(text, unit, name, f"has unit {_short(written)!r}, which is not known")
    registry = _registry()
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(written)).to_root_units()
    except Exception:  # pint's parser raises errors of every kind for invalid units
        raise _unit_error(text, unit, name, f"has unit {written!r}, which is not known") from None
    target = registry.Unit("dimensionless" if unit == "1" else unit)
    # pint treats an angle as a plain number, so that 1 Hz would be 1 rad/s and 1 mm/m an angle
    turns = ("radian" in str(quantity.units)) == ("rad" in unit)
    if not turns or not quantity.is_compatible_with(target):
        raise _unit_error(text, unit, name, f"has unit {written!r}, which is the wrong kind of unit")
    return float(quantity.to(target).magnitude)


def _unit_error(text: str, unit: Unit, name: str, what: str) -> InputError:
    kind, example = _KINDS[unit]
    return InputError(f"{name} {_short(text.strip())!r} {what}; give {kind} such as {example!r}")


def _short(text: str) -> str:
    return cut(text, 4 * MAX_UNIT_LENGTH)


@dataclass(frozen=True, slots=True)
class WrittenUnits:
    """The units of numbers without a unit in a file.

    Attributes:
        length: unit of lengths, such as "mm"; the default is "m".
        angle: unit of angles, such as "deg"; the default is "rad".
    """

    length: str = "m"
    angle: str = "rad"

    def declared(self, unit: str) -> str:
        """Return the declared unit of quantities with the SI unit "m" or "rad"; for others the SI unit."""
        return {"m": self.length, "rad": self.angle}.get(unit, unit)


SI_UNITS = WrittenUnits()


def parse_coordinate(
    text: str, unit: Unit, name: str, written: WrittenUnits = SI_UNITS, *, length: float = np.inf
) -> float:
    """Return a joint's value in SI; reject numbers without a unit as `require_written`, and above a turn."""
    require_written(text, unit, written.declared(unit), name, length=length)
    value, text = parse(text, unit, name), text.strip()
    if unit == "rad" and not unit_in(text) and abs(value) > 2.0 * np.pi:
        raise InputError(f"{name}: {text} rad is more than a turn; write {text}deg, or {text}rad if meant")
    return value


def table_in_si(
    table: Mapping[str, ArrayLike], where: str, units: Mapping[str, Unit] | None = None
) -> dict[str, Array]:
    """Return the columns of a table in SI, without the units of headers such as `P.x [mm]`; others are SI.

    Args:
        table: header -> values.
        where: name of the table, for messages.
        units: name of a column -> the SI unit that its own must suit; those of instants are known.

    Raises:
        InputError: for a unit that is unknown or does not suit its column, or two columns of one name.
    """
    columns: dict[str, Array] = {}
    for header, values in table.items():
        name, factor = _column_in_si(header, where, {**_COLUMNS, **(units or {})})
        if name in columns:
            raise InputError(f"{where} has the column {name!r} twice; leave one out")
        columns[name] = factor * np.asarray(values, dtype=np.float64)
    return columns


# units of the columns of instants; and a header with its unit
_COLUMNS: Mapping[str, Unit] = {"t": "s", "time": "s", "angle": "rad"}
_UNIT_OF_COLUMN = re.compile(r"(.*?)\s*\[([^\]]*)\]\s*")


def _column_in_si(header: str, where: str, units: Mapping[str, Unit]) -> tuple[str, float]:
    """Return the name in a header such as `P.x [mm]`, and the factor that converts its values to SI."""
    match = _UNIT_OF_COLUMN.fullmatch(header)
    if match is None:
        return header, 1.0
    name, written = match.groups()
    for unit in (units[name],) if name in units else get_args(Unit):
        with suppress(InputError):
            return name, parse(f"1 {written}", unit)
    examples = {"rad": "[deg]", "m": "[mm]"}
    expected = examples.get(units[name], f"[{units[name]}]") if name in units else "[mm] or [deg]"
    raise InputError(f"{where} has the column {header!r}, whose unit does not suit; write it as {expected}")
