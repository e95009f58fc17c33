"""Values of a TOML file, checked by the table of keys and converted to SI."""

import difflib
import math
import re
import tomllib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, TypeGuard

from mechsim import units
from mechsim.errors import InputError, cut
from mechsim.files import is_table
from mechsim.model.coupling_functions import WrittenFunction
from mechsim.model.expressions import FUNCTIONS, evaluate_number, variables
from mechsim.numerics.inputs import HUGE, number
from mechsim.subjects.toml_keys import (
    ROOT,
    AnyOf,
    Boolean,
    JointNumber,
    KeyType,
    ListOf,
    Number,
    Profile,
    Table,
    TableOf,
    Text,
)
from mechsim.units import Unit

# largest number of digits of an integer that Python reads by default (sys.set_int_max_str_digits)
MAX_DIGITS = 4300
# largest number of characters of a value in an error message
MAX_SHOWN = 60

_NAME = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_DOTTED = rf"{_NAME}(?:\s*\.\s*{_NAME})*"
# a key of so many names costs the square of their number
_LONG_KEY = re.compile(r"""(?<![\w.'"-])(?:['"\w-]++\s*+\.\s*+){50}""")
_HEADER = re.compile(rf"\s*\[\[?\s*({_DOTTED})\s*\]")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=")

KeyPath = tuple[str | int, ...]


class LocatedError(InputError):
    """An error that names file and line."""


@dataclass(frozen=True)
class TomlSource:
    """A parsed TOML file.

    Attributes:
        path: its path, as given.
        document: its contents.
        lines: key path -> line number.
    """

    path: str
    document: dict[str, Any]
    lines: dict[tuple[str, ...], int] = field(default_factory=dict[tuple[str, ...], int])

    def line(self, key: KeyPath) -> int:
        """Return the line of a key, or of the table that contains it."""
        names = tuple(name for name in key if isinstance(name, str))
        while names and names not in self.lines:
            names = names[:-1]
        return self.lines.get(names, 1)

    def sibling(self, name: str) -> str:
        """Return the path of a file relative to the folder of this one."""
        return str(Path(self.path).parent / name.strip())

    def error(self, key: KeyPath, reason: str) -> InputError:
        """Return the error about a key: file, line, key, and reason."""
        return LocatedError(f"{self.path}, line {self.line(key)}: {dotted(key)} {reason}")

    @contextmanager
    def error_context(self, key: KeyPath) -> Generator[None]:
        """Add the position of a key to errors that have no position."""
        try:
            yield
        except LocatedError:
            raise
        except InputError as error:
            raise LocatedError(f"{self.path}, line {self.line(key)}: {error}") from None


def dotted(key: KeyPath) -> str:
    """Return a key path as text, such as joints.crank.a.at[1]."""
    text = "".join(f"[{name}]" if isinstance(name, int) else f".{name}" for name in key)
    return text.removeprefix(".") or "the file"


def shown(value: object) -> str:
    """Return a value as text for error messages."""
    return cut(repr(value), MAX_SHOWN)


def suggestion(name: str, names: Iterable[str]) -> str:
    """Return the end of an error message: the closest name, and all names."""
    listed = list(names)
    close = difflib.get_close_matches(name, listed, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    return f"{hint} choose from {', '.join(listed)}" if listed else "; there are none"


def parsed_source(path: str, text: str) -> TomlSource:
    """Return a TOML file with its text.

    Raises:
        InputError: for text that is no TOML.
    """
    try:
        if _LONG_KEY.search(text):
            raise RecursionError
        return TomlSource(path, tomllib.loads(text), _lines(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is no TOML: {error}; correct that line") from None
    except ValueError:  # Python reads no integer of more digits
        number = re.search(rf"[\d_]{{{MAX_DIGITS},}}", text)
        line = text.count("\n", 0, number.start() if number else 0) + 1
        raise InputError(f"{path}, line {line}: a number has over {MAX_DIGITS} digits; shorten it") from None
    except RecursionError:
        raise InputError(f"{path} nests too deep; a mechanism needs five levels") from None


def head_comment(path: str) -> str:
    """Return the first sentence of the comment at the head of a mechanism's file; empty if there is none."""
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    head = takewhile(lambda line: line.startswith("# ") and not line.startswith("# Source:"), lines)
    sentence = re.split(r"[.;] ", " ".join(line.removeprefix("# ") for line in head))[0].rstrip(".")
    return f"{sentence}." if sentence else ""


def _lines(text: str) -> dict[tuple[str, ...], int]:
    """Return the line of each key; keys of inline tables have the line of their table."""
    lines: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    for line_number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            table = _key_names(header[1])
            lines.setdefault(table, line_number)
        elif key:
            lines.setdefault(table + _key_names(key[1]), line_number)
    return lines


def _key_names(name: str) -> tuple[str, ...]:
    return tuple(name_.strip().strip("\"'") for name_ in re.findall(_NAME, name))


# a number followed by letters is a quantity; other text is an expression
_QUANTITY = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*[^\W\d_eE°%]|.*[°%]")


@dataclass(frozen=True)
class Values:
    """Converts values of a file to plain values in SI.

    Attributes:
        source: the file.
        length: unit of lengths without a unit.
        angle: unit of angles without a unit.
        parameters: name -> value, lengths and angles in the file's units, others in SI.
    """

    source: TomlSource
    length: str
    angle: str
    parameters: Mapping[str, float]

    def checked(self, key: KeyType, value: Any, path: KeyPath) -> Any:
        """Return a value checked and converted by its key.

        Raises:
            InputError: for an invalid value; names file, line, key, value and remedy.
        """
        match key:
            case Number(unit=unit) | Profile(unit=unit):
                unchanged = isinstance(key, Profile) and is_profile(value)
                return value if unchanged else self.quantity(value, unit, path)
            case JointNumber():
                # a number, a quantity or an expression unchanged, if the key gives it a unit later
                if not isinstance(value, str):
                    self.plain_number(value, path)
                return value
            case Boolean():
                self._require(isinstance(value, bool), value, "true or false", path)
                return value
            case Text(options=options):
                return self._text(value, options, path)
            case ListOf(item=item, count=count):
                expected = "a list" if count is None else f"a list of {count}"
                fits = isinstance(value, list) and count in (None, len(value))
                self._require(fits, value, f"{expected}, each {item.about}", path)
                return tuple(self.checked(item, entry, (*path, i)) for i, entry in enumerate(value))
            case TableOf(value_type=item):
                entries = self._table(value, path).items()
                return {name: self.checked(item, entry, (*path, name)) for name, entry in entries}
            case Table():
                return self._known_keys(value, key, path)
            case AnyOf(alternatives=item, about=about):
                fitting = [entry for entry in item if _fits(entry, value)]
                self._require(bool(fitting), value, about, path)
                return self.checked(fitting[0], value, path)

    def quantity(self, value: Any, unit: Unit, path: KeyPath) -> float:
        """Return a number, a quantity or an expression in SI; numbers without a unit are in the file's."""
        bare = None if is_quantity(value) else self.plain_number(value, path)
        with self.source.error_context(path):
            if bare is None:
                number = units.parse(value, unit, ".".join(str(name) for name in path))
            else:
                number = self.in_si(bare, unit)
        if not abs(number) <= HUGE:
            raise self.source.error(path, f"is {shown(value)}; give at most {HUGE:g} in SI")
        return number

    def plain_number(self, value: Any, path: KeyPath) -> float:
        """Return a number, or the value of an expression."""
        if isinstance(value, str):
            try:
                return evaluate_number(value, self._parameter, self.in_si(1.0, "rad"))
            except InputError as error:
                raise self.source.error(path, f"is {shown(value)}, which {error}") from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.source.error(path, f"is {shown(value)}; give a number, or text such as '13 mm'")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.source.error(path, f"is {shown(value)}; give a finite number")
        return number

    def _parameter(self, name: str) -> float:
        if name in self.parameters:
            return self.parameters[name]
        hint = suggestion(name, self.parameters)
        raise InputError(f"names {name!r}, which is no parameter defined before{hint}")

    def in_si(self, value: float, unit: Unit) -> float:
        """Return a number without a unit in SI."""
        own: dict[Unit, str] = {"m": self.length, "rad": self.angle}
        return units.in_si(value, own.get(unit, unit), unit)

    def with_parameters(
        self, entries: Any, changed: Mapping[str, str | float], units_of: Mapping[str, Unit]
    ) -> "Values":
        """Return the same reader with parameters; each expression uses parameters before it.

        Args:
            entries: the table of parameters in the file.
            changed: name -> text, or number in SI, that replaces the value in the file.
            units_of: parameter -> "m" or "rad", if its use determines it.
        """
        table = self._table(entries, ("parameters",))
        for name in changed:
            if name not in table:
                raise InputError(f"{self.source.path} has no parameter {name!r}{suggestion(name, table)}")
        result = replace(self, parameters={})
        for name, value in table.items():
            path = ("parameters", name)
            if not name.isidentifier() or name in (*FUNCTIONS, "pi"):
                raise self.source.error(path, "is no valid parameter name; use letters, digits and _")
            if name in changed:
                number = result.changed_parameter(name, changed[name], value, units_of)
            else:
                number = result.parameter(value, path)
            result = replace(result, parameters={**result.parameters, name: number})
        return result

    def changed_parameter(
        self, name: str, text: str | float, before: Any, units_of: Mapping[str, Unit]
    ) -> float:
        """Return the value of `--set` or `set=` for a parameter, in the file's unit; see `_require_unit`."""
        path = ("parameters", name)
        unit = self.unit_of(name, before, units_of)
        if unit is not None:
            self._require_unit(name, text, before, unit)
        try:
            bare = float(text)
        except (TypeError, ValueError):
            return self.parameter(text, path)
        return self.plain_number(bare, path) / (1.0 if unit is None else self.in_si(1.0, unit))

    def unit_of(self, name: str, before: Any, units_of: Mapping[str, Unit]) -> Unit | None:
        """Return the unit of a parameter, by its use or its text in the file; None if unknown."""
        unit = units_of.get(name)
        if unit is None and is_quantity(before):
            with self.source.error_context(("parameters", name)):
                unit = units.of_any_kind(before, f"parameter {name}")[1]
        return unit

    def declared_unit(self, before: Any, unit: Unit) -> str:
        """Return the unit of a parameter's text in the file, else that of numbers without a unit."""
        if is_quantity(before):
            return units.unit_in(before)
        return {"m": self.length, "rad": self.angle}.get(unit, unit)

    def _require_unit(self, name: str, text: str | float, before: Any, unit: Unit) -> None:
        """Raise InputError for text without a unit or implausible SI numbers if the file has another unit."""
        declared = self.declared_unit(before, unit)
        if isinstance(text, str):
            with self.source.error_context(("parameters", name)):
                units.require_written(text, unit, declared, name)
            return
        value = number(text)
        if units.in_si(1.0, declared, unit) == 1.0 or not math.isfinite(value):
            return
        file_value = abs(self.parameter(before, ("parameters", name)) * self.in_si(1.0, unit))
        limit = 2.0 * math.pi if unit == "rad" else units.IMPLAUSIBLE * file_value
        if limit > 0.0 and abs(value) > limit:
            raise InputError(
                f"{name}: {value:g} is {value:g} {unit}, and the file has {file_value:.6g} {unit}; numbers "
                f"in set= are SI and the file is in {declared}: give text, as '{value:g}{declared}' or "
                f"'{value:g}{unit}'"
            )

    def parameter(self, value: Any, path: KeyPath) -> float:
        """Return a parameter; a length or an angle in the file's unit."""
        if not is_quantity(value):
            return self.plain_number(value, path)
        with self.source.error_context(path):
            number, unit = units.of_any_kind(value, f"parameter {path[-1]}")
            return number / self.in_si(1.0, unit)

    def _text(self, value: Any, options: tuple[str, ...], path: KeyPath) -> str:
        self._require(isinstance(value, str), value, "text", path)
        if options and value not in options:
            raise self.source.error(path, f"is {shown(value)}; it can be {', '.join(options)}")
        return value

    def _known_keys(self, value: Any, keys: Table, path: KeyPath) -> dict[str, Any]:
        table = self._table(value, path)
        for name in table:
            if name not in keys.keys:
                raise self.source.error((*path, name), f"is no known key{suggestion(name, keys.keys)}")
        for name in keys.required:
            if name not in table:
                raise self.source.error(path, f"has no {name!r}; give it: {keys.keys[name].about}")
        return {name: self.checked(keys.keys[name], entry, (*path, name)) for name, entry in table.items()}

    def _table(self, value: Any, path: KeyPath) -> dict[str, Any]:
        self._require(isinstance(value, dict), value, "a table", path)
        return value

    def _require(self, fits: bool, value: Any, expected: str, path: KeyPath) -> None:
        """Raise InputError for a value that is not the expected one."""
        if not fits:
            raise self.source.error(path, f"is {shown(value)}; give {expected}")


def written_function(values: Values, text: str, path: KeyPath, variable: str = "q") -> WrittenFunction:
    """Return a function of a variable, in SI, with the parameters of the file."""
    if (values.length, values.angle) != ("m", "rad"):
        raise values.source.error(path, "is in SI; give the file the units m and rad")
    names = [name for name in values.parameters if re.search(rf"\b{re.escape(name)}\b", text)]
    return WrittenFunction(text, tuple(names), tuple(values.parameters[name] for name in names), variable)


def values_of(source: TomlSource) -> Values:
    """Return the reader of values, with the file's units and without parameters."""
    bare = Values(source, "m", "rad", {})
    units_table = Table({"units": ROOT.keys["units"]}, "")
    stated = {name: entry for name, entry in source.document.items() if name == "units"}
    units = bare.checked(units_table, stated, ()).get("units", {})
    values = Values(source, units.get("length", "m"), units.get("angle", "rad"), {})
    with source.error_context(("units",)):
        values.in_si(1.0, "m")
        values.in_si(1.0, "rad")
    return values


def is_quantity(value: object) -> TypeGuard[str]:
    """Whether a value is text that starts with a number and a unit."""
    return isinstance(value, str) and _QUANTITY.match(value) is not None


def _fits(key: KeyType, value: Any) -> bool:
    match key:
        case Number() | JointNumber() | Profile():
            return isinstance(value, str | int | float)
        case Text():
            return isinstance(value, str)
        case Boolean():
            return isinstance(value, bool)
        case ListOf():
            return isinstance(value, list)
        case AnyOf(alternatives=alternatives):
            return any(_fits(alternative, value) for alternative in alternatives)
        case _:
            return isinstance(value, dict)


def is_profile(value: object) -> TypeGuard[str]:
    """Whether a value is text with a load over time or crank angle."""
    return isinstance(value, str) and (is_table(value) or bool(variables(value)))
