"""A driver's program as people write it: steady, an expression of t, or a table in a file."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.programs import State, steady, tabled
from mechsim.subjects.time_expressions import over_time
from mechsim.units import Unit

# gives where a driver starts, in SI
Start = Callable[[], float]

# a number and what may be its unit, and nothing else
_QUANTITY = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*([^\d\W_°%][^*+()]*|[°%])?")
_RATES: dict[str, Unit] = {"m": "m/s", "rad": "rad/s"}
_EXAMPLES = {
    "m": "20mm/s, 10mm*sin(2*pi*t), 15mm where it stands, or FILE.csv",
    "rad": "600rpm, 30deg*sin(2*pi*0.6*t), 45deg where it stands, or FILE.csv",
}


@dataclass(frozen=True)
class Program:
    """How a driver goes over time.

    Attributes:
        text: by which a command line or a file in SI says the same.
        state: times (n,) in [s] -> value, rate, acceleration.
        lasts: where its table ends, in [s]; None where it goes on for ever.
    """

    text: str
    state: State
    lasts: float | None = None

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at times (n,) in [s]."""
        return self.state(time)


def program(
    text: str,
    name: str,
    unit: str,
    start: Start,
    *,
    bare: float = 1.0,
    names: Mapping[str, float] | None = None,
    declared: str = "",
) -> Program:
    """Return the program of a driver.

    Args:
        text: `600rpm` or `20mm/s`, steady from where the driver starts; an expression of t in s, such as
            `30deg*sin(2*pi*t)`; `30deg`, which stands still; or FILE.csv with columns t and value in SI.
        name: of the driven coordinate.
        unit: of it, "m" or "rad".
        start: gives where it starts, in SI.
        bare: what numbers without a unit are counted in, in SI.
        names: parameter -> its number in those units.
        declared: unit that the mechanism's file declares for the coordinate, where the text is from
            elsewhere; text without a unit is then rejected.

    Raises:
        InputError: names the driver, the text and the remedy.
    """
    said = f"the program of {name}, {text!r},"
    try:
        if text.strip().lower().endswith(files.EXTENSIONS):
            return _from_table(text.strip(), name)
        quantity = _QUANTITY.fullmatch(text)
        if quantity is None or quantity[1] == "t":
            return Program(*over_time(text, unit, bare=bare, names=names, declared=declared))
    except InputError as error:
        if text.strip().lower().endswith(files.EXTENSIONS):
            raise
        raise InputError(f"{said} {error}, as in {_EXAMPLES[unit]}") from None
    if quantity[1] is None:
        if declared:
            rated: Unit = _RATES[unit]
            units.require_written(text, rated, f"{declared}/s", f"the program of {name}")
        rate = bare * float(text)
        return Program(f"{rate:.17g}", steady(start(), rate))
    try:
        return Program(text, steady(start(), units.parse(text, _RATES[unit])))
    except InputError:
        pass
    try:
        place = units.parse(text, "m" if unit == "m" else "rad")
    except InputError:
        kind = "a speed or a length" if unit == "m" else "a speed of rotation or an angle"
        raise InputError(f"{said} measures something else; give {kind}, as in {_EXAMPLES[unit]}") from None
    return Program(text, steady(place, 0.0))


def _from_table(path: str, name: str) -> Program:
    """Return the program that two columns of a file say; of more the one of the driver's name."""
    _, at, value = column(path, name, ("t", "time"), f"the program of {name} give two, t in s")
    state = tabled(name, at, value)
    if not at[0] <= 0.0 < at[-1]:
        raise InputError(
            f"{path} goes from {at[0]:g} to {at[-1]:g} s; give the program of {name} from 0 s, and beyond it"
        )
    return Program(path, state, float(at[-1]))


def column(path: str, name: str, axes: Sequence[str], wanted: str) -> tuple[str, Array, Array]:
    """Return the axis of a table in a file, its places and the values there, (n,) each.

    Args:
        path: of the file.
        name: of the column of values where there are several.
        axes: names of which one is the axis.
        wanted: what the file is to be, for messages, up to its axis.

    Raises:
        InputError: for a file that is no table, has no axis or two, or no such column.
    """
    table = files.read(path)
    over = [one for one in axes if one in table]
    others = [one for one in table if one not in axes]
    if len(over) != 1 or not others or (len(others) > 1 and name not in others):
        raise InputError(
            f"{path} has columns {', '.join(table)}; as {wanted} and its value in SI, or one called {name}"
        )
    return over[0], table[over[0]], table[others[0] if len(others) == 1 else name]
