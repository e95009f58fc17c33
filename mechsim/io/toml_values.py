"""Values of a TOML file, checked by the table of keys and converted to SI."""

import difflib
import math
import re
import tomllib
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from mechsim import units
from mechsim.errors import InputError, cut, first_names
from mechsim.files import is_table, read_in_si
from mechsim.io.toml_keys import Key, root
from mechsim.mechanism.expressions import FUNCTIONS, evaluate_number, variables
from mechsim.mechanism.joint_kinds import ALIASES
from mechsim.numerics.arrays import HUGE, number
from mechsim.units import Unit

if TYPE_CHECKING:
    from mechsim.mechanism.coupling_functions import TabledFunction, WrittenFunction

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
        stated: parameter -> its table with `uncertainty` and `source`; the document has its value.
    """

    path: str
    document: dict[str, Any]
    lines: dict[tuple[str, ...], int] = field(default_factory=dict[tuple[str, ...], int])
    stated: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])

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
    return f"{hint} choose from {first_names(listed)}" if listed else "; there are none"


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

    def checked(self, key: Key, value: Any, path: KeyPath) -> Any:
        """Return a value checked and converted by its key.

        Raises:
            InputError: for an invalid value; names file, line, key, value and remedy.
        """
        match key:
            case {"unit": "joint"}:
                # a number, a quantity or an expression unchanged: its reader gives it a unit
                if not isinstance(value, str):
                    self.plain_number(value, path)
                return value
            case {"unit": unit}:
                return value if "over" in key and is_profile(value) else self.quantity(value, unit, path)
            case {"anyOf": alternatives}:
                fitting = [entry for entry in alternatives if _fits(entry, value)]
                self._require(bool(fitting), value, key["description"], path)
                return self.checked(fitting[0], value, path)
            case {"type": "array", "items": item}:
                count: int | None = key.get("minItems")
                expected = "a list" if count is None else f"a list of {count}"
                fits = isinstance(value, list) and count in (None, len(value))
                self._require(fits, value, f"{expected}, each {item['description']}", path)
                return tuple(self.checked(item, entry, (*path, i)) for i, entry in enumerate(value))
            case {"type": "object"}:
                return self._table(key, value, path)
            case _:
                expected = "text" if key["type"] == "string" else "true or false"
                self._require(_fits(key, value), value, expected, path)
                if "enum" in key and value not in key["enum"]:
                    raise self.source.error(path, f"is {shown(value)}; it can be {', '.join(key['enum'])}")
                return ALIASES.get(value, value) if path[-1] == "kind" else value

    def _table(self, key: Key, value: Any, path: KeyPath) -> dict[str, Any]:
        self._require(isinstance(value, dict), value, "a table", path)
        keys: Key = key.get("properties") or dict.fromkeys(value, key["additionalProperties"])
        for name in value:
            if name not in keys:
                raise self.source.error((*path, name), f"is no known key{suggestion(name, keys)}")
        for name in key.get("required", ()):
            if name not in value:
                raise self.source.error(path, f"has no {name!r}; give it: {keys[name]['description']}")
        return {name: self.checked(keys[name], entry, (*path, name)) for name, entry in value.items()}

    def quantity(self, value: Any, unit: Unit, path: KeyPath) -> float:
        """Return a number, a quantity or an expression in SI; numbers without a unit are in the file's."""
        with self.source.error_context(path):
            if is_quantity(value):
                number = units.parse(value, unit, ".".join(str(name) for name in path))
            else:
                number = self.in_si(self.plain_number(value, path), unit)
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
        self._require(isinstance(entries, dict), entries, "a table", ("parameters",))
        for name in changed:
            if name not in entries:
                raise InputError(f"{self.source.path} has no parameter {name!r}{suggestion(name, entries)}")
        result = replace(self, parameters={})
        for name, value in entries.items():
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

    def _require(self, fits: bool, value: Any, expected: str, path: KeyPath) -> None:
        """Raise InputError for a value that is not the expected one."""
        if not fits:
            raise self.source.error(path, f"is {shown(value)}; give {expected}")


def written_function(values: Values, text: str, path: KeyPath, variable: str = "q") -> "WrittenFunction":
    """Return a function of a variable, in SI, with the parameters of the file."""
    from mechsim.mechanism.coupling_functions import WrittenFunction

    if (values.length, values.angle) != ("m", "rad"):
        raise values.source.error(path, "is in SI; give the file the units m and rad")
    names = [name for name in values.parameters if re.search(rf"\b{re.escape(name)}\b", text)]
    try:
        return WrittenFunction(text, tuple(names), tuple(values.parameters[name] for name in names), variable)
    except InputError as error:
        raise values.source.error(path, str(error)) from None


def tabled_function(
    values: Values,
    text: str,
    path: KeyPath,
    over: Sequence[str] = ("q",),
    value: str = "value",
    *,
    periodic: bool = False,
    units: Mapping[str, Unit] | None = None,
) -> "TabledFunction":
    """Return a function in SI that a table next to the file has in two columns.

    Args:
        values: reader of the file's numbers.
        text: name of the table.
        path: key path of the text.
        over: possible names of the column of the variable.
        value: name of the column of values.
        periodic: whether the function repeats.
        units: column -> its unit in SI.

    Raises:
        InputError: for a table with other columns, or units that do not suit them.
    """
    from mechsim.mechanism.coupling_functions import TabledFunction

    file = str(values.source.sibling(text))
    columns = read_in_si(file, units)
    variable = next((name for name in over if name in columns), over[0])
    if {*columns} != {variable, value}:
        expected = f"{' or '.join(over)}, and {value}, each in SI or with its unit in brackets"
        raise values.source.error(path, f"has columns {', '.join(columns)}; give {expected}")
    positions, targets = (tuple(columns[name].tolist()) for name in (variable, value))
    return TabledFunction(file, positions, targets, periodic, variable)


def values_of(source: TomlSource) -> Values:
    """Return the reader of values, with the file's units and without parameters."""
    stated = source.document.get("units", {})
    units = Values(source, "m", "rad", {}).checked(root()["properties"]["units"], stated, ("units",))
    values = Values(source, units.get("length", "m"), units.get("angle", "rad"), {})
    with source.error_context(("units",)):
        values.in_si(1.0, "m")
        values.in_si(1.0, "rad")
    return values


def is_quantity(value: object) -> TypeGuard[str]:
    """Whether a value is text that starts with a number and a unit."""
    return isinstance(value, str) and _QUANTITY.match(value) is not None


# type of a key -> that of its values in Python
_TYPES = {"string": str, "boolean": bool, "array": list, "object": dict}


def _fits(key: Key, value: Any) -> bool:
    if "anyOf" in key:
        return any(_fits(alternative, value) for alternative in key["anyOf"])
    return isinstance(value, str | int | float if "unit" in key else _TYPES[key["type"]])


def is_profile(value: object) -> TypeGuard[str]:
    """Whether a value is text with a load over time or crank angle."""
    return isinstance(value, str) and (is_table(value) or bool(variables(value)))
