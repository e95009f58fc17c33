"""Designs of a sweep: the varied parameters and their values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mechsim import units
from mechsim.errors import InputError, require_once, several
from mechsim.files import read_rows
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.limits import require_count
from mechsim.mechanism.links import AXES
from mechsim.numerics.arrays import Array, numbers
from mechsim.numerics.resources import require_memory
from mechsim.units import Unit

# seed of random samples
SEED = 20240607
# largest number of designs of a sweep: a four-bar takes 25 us, so that they take 1.4 h
MAX_LISTED = 200_000_000
# bytes of a design in addition to its parameters while a table of one measure is built
BYTES_PER_DESIGN = 88.0
RANGE = "p=a:b:n, as in crank=12mm:15mm:31"
SPAN = "p=a:b, as in crank=12mm:15mm"


@dataclass(frozen=True)
class Designs:
    """Designs as a grid, all combinations of the values of each parameter, or as a list.

    Attributes:
        values: parameter -> values in SI: along its own axis of a grid, or of each design of a list.
        units: parameter -> SI unit.
        spread: "grid" or "list".
        description: text on how they were made.
    """

    values: Mapping[str, Array]
    units: Mapping[str, str]
    spread: Literal["grid", "list"]
    description: str

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the table: the grid's, or (designs,)."""
        lengths = tuple(len(values) for values in self.values.values())
        return lengths if self.spread == "grid" else lengths[:1]

    @property
    def count(self) -> int:
        """Number of designs."""
        return math.prod(self.shape)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the table's dimensions."""
        return tuple(self.values) if self.spread == "grid" else ("design",)

    def rows(self, low: int, high: int) -> dict[str, Array]:
        """Return the parameters of designs low to high, (high - low,) each in SI."""
        if self.spread == "list":
            return {name: values[low:high] for name, values in self.values.items()}
        indices = np.unravel_index(np.arange(low, high), self.shape)
        return {
            name: values[index] for (name, values), index in zip(self.values.items(), indices, strict=True)
        }


def parameter_units(design_family: DesignFamily, solver: KinematicSolver) -> dict[str, str]:
    """Return the parameters that may vary: name -> SI unit; choices such as branch included."""
    result = {name: values.unit for name, values in design_family.dimensions.items()}
    rows = {} if solver.closed_form is None else solver.closed_form.declared.rows
    choices = [name for name, row in rows.items() if row.is_choice and not isinstance(row.default, str)]
    return dict.fromkeys(choices, "1") | result


def declared_units(design_family: DesignFamily) -> dict[str, str]:
    """Return the units that a file declares for its parameters: name -> unit as in the file."""
    return {name: values.declared for name, values in design_family.dimensions.items() if values.declared}


def unit_of(name: str, model: str, parameters: Mapping[str, str]) -> str:
    """Return a parameter's unit.

    Raises:
        InputError: for an unknown parameter, with the closest known one.
    """
    if name not in parameters:
        components = [f"{name}.{axis}" for axis in AXES if f"{name}.{axis}" in parameters]
        if components:
            raise InputError(f"{name} of {model} is a position; vary its components, {', '.join(components)}")
        raise InputError(f"{model} has no parameter {name!r} to vary{suggestion(name, parameters)}")
    return parameters[name]


def parsed_range(
    text: str,
    model: str,
    parameters: Mapping[str, str],
    *,
    sampled: bool,
    declared: Mapping[str, str] | None = None,
) -> tuple[str, Array]:
    """Return a parameter and its values in SI, (n,), from `p=a:b:n` or `p=v,w,...`; sampled: its ends, (2,).

    Args:
        text: the range.
        model: name of the subject.
        parameters: parameter -> SI unit.
        sampled: whether the range bounds random samples.
        declared: parameter -> unit that a file declares for it.

    Raises:
        InputError: for other text, an unknown parameter, a range in descending order, or one without a unit
            if the file declares a unit other than SI.
    """
    name, equals, rest = text.partition("=")
    name = name.strip()
    if not equals:
        raise InputError(f"--vary {text!r} has no '='; write --vary {SPAN if sampled else RANGE}")
    what = f"{name} of {model}"
    bounds = rest.split(":")
    unit: Unit = unit_of(name, model, parameters) or _unit_of(bounds, what)  # pyright: ignore[reportAssignmentType]
    if declared_unit := (declared or {}).get(name):
        count = "".join(f":{text}" for text in bounds[2:])
        units.require_written(":".join(bounds[:2]), unit, declared_unit, name, count)
    if len(bounds) == 1 and not sampled:
        return name, np.array(units.parse_vector(rest, unit, what))
    if len(bounds) != (2 if sampled else 3):
        expected = f"a sample takes {SPAN}" if sampled else f"a grid takes {RANGE}, or p=a:b with --sample"
        raise InputError(f"--vary {text!r} is not a range: {expected}")
    low, high = units.parse_vector(",".join(bounds[:2]), unit, what)
    if low > high:
        raise InputError(
            f"--vary {text!r} is in descending order, from {low:g} to {high:g}; give the lower end first"
        )
    if sampled:
        return name, np.array([low, high])
    return name, np.linspace(low, high, _count(bounds[2], text))


def _unit_of(bounds: Sequence[str], what: str) -> str:
    """Return the SI unit of the text of a range, for a parameter without a unit."""
    return units.of_any_kind(bounds[min(1, len(bounds) - 1)].split(",")[-1], what)[1]


def _count(text: str, source: str) -> int:
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise InputError(f"--vary {source!r} has {text.strip()!r} values; give a whole number, as in {RANGE}")
    require_count(f"the values of --vary {source!r}", count, MAX_LISTED, f"reduce the number, as in {RANGE}")
    require_memory(f"{count:,} values", count, 16.0, "{most} fit: reduce the number")
    return count


def grid_designs(values: Mapping[str, object], model: str, parameters: Mapping[str, str]) -> Designs:
    """Return all combinations of values of parameters, the last parameter varying fastest.

    Raises:
        InputError: for an unknown parameter, or values that are not numbers.
    """
    kept = {name: _row(name, values, model, parameters) for name, values in values.items()}
    if not kept:
        raise InputError(f"no parameter of {model} varies; give --vary {RANGE}")
    description = " x ".join(f"{len(values)} {name}" for name, values in kept.items())
    count = math.prod(len(values) for values in kept.values())
    require_count(f"the designs of the grid, {description},", count, MAX_LISTED, "give fewer values")
    return Designs(kept, {name: parameters[name] for name in kept}, "grid", f"grid of {description}")


def listed_designs(
    values: Mapping[str, object], model: str, parameters: Mapping[str, str], description: str
) -> Designs:
    """Return a list of designs: parameter -> values, (n,) each in SI.

    Raises:
        InputError: for an unknown parameter, values that are not numbers, or lists of different lengths.
    """
    kept = {name: _row(name, values, model, parameters) for name, values in values.items()}
    if not kept:
        raise InputError(f"{description} names no parameter of {model}{suggestion('', parameters)}")
    lengths = {name: len(values) for name, values in kept.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"parameters have different numbers of values: {lengths}; give one for each design")
    return Designs(kept, {name: parameters[name] for name in kept}, "list", description)


def _row(name: str, value: object, model: str, parameters: Mapping[str, str]) -> Array:
    unit_of(name, model, parameters)
    try:
        row = np.atleast_1d(numbers(value))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        row = np.array([[np.nan]])
    if row.ndim != 1 or not len(row) or np.isnan(row).any():
        raise InputError(f"{name} of {model} needs a list of finite numbers; give numbers in SI")
    return row.astype(np.float64)


def sampled_designs(
    text: str, spans: Mapping[str, object], model: str, parameters: Mapping[str, str]
) -> Designs:
    """Return designs sampled between bounds of parameters: `sobol:N`.

    Args:
        text: "sobol:" and the number of designs.
        spans: parameter -> (low, high) in SI.
        model: name of the subject.
        parameters: parameter -> unit.

    Raises:
        InputError: for another text, or an invalid number.
    """
    word, _, number = text.partition(":")
    count = int(number) if number.isdigit() else 0
    if word != "sobol" or not 1 <= count <= MAX_LISTED:
        raise InputError(f"--sample is {text!r}; write sobol:N with N up to {MAX_LISTED:,}")
    if not spans:
        raise InputError(f"no parameter of {model} varies; give --vary {SPAN}")
    ends = {name: _row(name, values, model, parameters) for name, values in spans.items()}
    for name, values in ends.items():
        if len(values) != 2 or not values[0] <= values[1]:
            raise InputError(
                f"{name} of {model} has the bounds {values.tolist()}; give its lower and its upper end"
            )
    require_memory(
        f"{count:,} designs", count, BYTES_PER_DESIGN + 16.0 * len(ends), "{most} fit: reduce the number"
    )
    from scipy.stats import qmc

    # a power of two keeps the points balanced; the first are used
    points = qmc.Sobol(len(ends), scramble=True, rng=SEED).random_base2((count - 1).bit_length())[:count]
    values = {name: low + (high - low) * points[:, i] for i, (name, (low, high)) in enumerate(ends.items())}
    return Designs(values, {name: parameters[name] for name in values}, "list", f"{text}, seed {SEED}")


def read_designs(
    path: str, model: str, parameters: Mapping[str, str], declared: Mapping[str, str] | None = None
) -> Designs:
    """Return the designs of a CSV file with a column for each parameter; cells may contain units.

    Raises:
        InputError: for a missing file, cells that are not values, or cells without a unit if the
            mechanism's file declares a unit other than SI.
    """
    names, *rows = read_rows(path, "a table of designs") or [[]]
    if not rows:
        raise InputError(f"{path} has no row of numbers under a header; give a column for each parameter")
    require_once(path, names)
    columns: dict[str, Array] = {}
    for i, name in enumerate(names):
        unit = unit_of(name, model, parameters)
        own = (declared or {}).get(name, "")
        columns[name] = np.array([_value(row, i, unit, path, line, own) for line, row in enumerate(rows, 2)])
    return listed_designs(columns, model, parameters, f"{len(rows)} designs of {Path(path).name}")


def _value(row: Sequence[str], i: int, unit: str, path: str, line: int, declared: str) -> float:
    if i >= len(row):
        raise InputError(f"line {line} of {path} has {several(len(row), 'value')}; give one for each column")
    if declared:
        what = f"line {line} of {path}"
        units.require_written(row[i], unit, declared, what)  # pyright: ignore[reportArgumentType]
    try:
        return float(row[i])
    except ValueError:
        what = f"line {line} of {path}"
        return units.parse(row[i], unit or _unit_of([row[i]], what), what)  # pyright: ignore[reportArgumentType]
