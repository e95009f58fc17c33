"""Motion laws of drivers written as text: constant speed, an expression of t, or a table in a file."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.model.motion_laws import State, steady, tabled
from mechsim.numerics.arrays import Array
from mechsim.subjects.time_expressions import time_function
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
class MotionLaw:
    """The motion law of a driver.

    Attributes:
        text: the law as a command line or a file in SI states it.
        state: times (n,) in [s] -> value, rate, acceleration.
        end_time: last time of its table, in [s]; None if the law has no end.
    """

    text: str
    state: State
    end_time: float | None = None

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at times (n,) in [s]."""
        return self.state(time)


def parse_motion_law(
    text: str,
    name: str,
    unit: str,
    start: Start,
    *,
    default_unit: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    declared: str = "",
) -> MotionLaw:
    """Return the motion law of a driver.

    Args:
        text: `600rpm` or `20mm/s`, steady from where the driver starts; an expression of t in s, such as
            `30deg*sin(2*pi*t)`; `30deg`, which stands still; or FILE.csv with columns t and value in SI.
        name: of the driven coordinate.
        unit: of it, "m" or "rad".
        start: gives where it starts, in SI.
        default_unit: what numbers without a unit are counted in, in SI.
        parameters: parameter -> its number in those units.
        declared: unit that the mechanism's file declares for the coordinate, where the text is from
            elsewhere; text without a unit is then rejected.

    Raises:
        InputError: names the driver, the text and the remedy.
    """
    subject = f"the program of {name}, {text!r},"
    try:
        if text.strip().lower().endswith(files.EXTENSIONS):
            return _tabulated_law(text.strip(), name)
        quantity = _QUANTITY.fullmatch(text)
        if quantity is None or quantity[1] == "t":
            return MotionLaw(
                *time_function(
                    text, unit, default_unit=default_unit, parameters=parameters, declared=declared
                )
            )
    except InputError as error:
        if text.strip().lower().endswith(files.EXTENSIONS):
            raise
        raise InputError(f"{subject} {error}, as in {_EXAMPLES[unit]}") from None
    if quantity[1] is None:
        if declared:
            rate_unit: Unit = _RATES[unit]
            units.require_written(text, rate_unit, f"{declared}/s", f"the program of {name}")
        rate = default_unit * float(text)
        return MotionLaw(f"{rate:.17g}", steady(start(), rate))
    try:
        return MotionLaw(text, steady(start(), units.parse(text, _RATES[unit])))
    except InputError:
        pass
    try:
        position = units.parse(text, "m" if unit == "m" else "rad")
    except InputError:
        kind = "a speed or a length" if unit == "m" else "a speed of rotation or an angle"
        raise InputError(f"{subject} measures something else; give {kind}, as in {_EXAMPLES[unit]}") from None
    return MotionLaw(text, steady(position, 0.0))


def _tabulated_law(path: str, name: str) -> MotionLaw:
    """Return the program that two columns of a file say; of more the one of the driver's name."""
    _, time, value = read_column(path, name, ("t", "time"), f"the program of {name} give two, t in s")
    state = tabled(name, time, value)
    if not time[0] <= 0.0 < time[-1]:
        raise InputError(
            f"{path} goes from {time[0]:g} to {time[-1]:g} s; "
            f"give the program of {name} from 0 s, and beyond it"
        )
    return MotionLaw(path, state, float(time[-1]))


def read_column(path: str, name: str, axes: Sequence[str], expected: str) -> tuple[str, Array, Array]:
    """Return the axis of a table in a file, its places and the values there, (n,) each.

    Args:
        path: of the file.
        name: of the column of values where there are several.
        axes: names of which one is the axis.
        expected: what the file is to be, for messages, up to its axis.

    Raises:
        InputError: for a file that is no table, has no axis or two, or no such column.
    """
    table = files.read(path)
    axis_columns = [name_ for name_ in axes if name_ in table]
    value_columns = [name_ for name_ in table if name_ not in axes]
    if len(axis_columns) != 1 or not value_columns or (len(value_columns) > 1 and name not in value_columns):
        raise InputError(
            f"{path} has columns {', '.join(table)}; as {expected} and its value in SI, or one called {name}"
        )
    return (
        axis_columns[0],
        table[axis_columns[0]],
        table[value_columns[0] if len(value_columns) == 1 else name],
    )
