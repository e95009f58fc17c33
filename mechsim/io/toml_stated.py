"""Parameters of a TOML file that state where they come from: tables of value, uncertainty and source."""

from dataclasses import replace
from typing import Any

from mechsim.io.toml_keys import root
from mechsim.io.toml_values import TomlSource, Values, is_quantity, shown, values_of
from mechsim.kinematics.designs import Dimension
from mechsim.units import Unit, of_any_kind

# keys of a parameter's table that only files of formulas have
FORMULA_KEYS = {"about", "kind", "choices"}
# position of this table among the forms of a parameter in the schema
STATED = 2


def with_stated(source: TomlSource) -> TomlSource:
    """Return a file with the value of each parameter in place of its table; files of formulas unchanged."""
    rows: dict[str, Any] = source.document["parameters"]
    stated = {name: row for name, row in rows.items() if isinstance(row, dict)}
    if any(FORMULA_KEYS & row.keys() for row in stated.values()):
        return source
    key = root()["properties"]["parameters"]["additionalProperties"]["anyOf"][STATED]
    for name, row in stated.items():
        values_of(source).checked(key, row, ("parameters", name))
    values = {name: row["value"] if name in stated else row for name, row in rows.items()}
    return replace(source, document={**source.document, "parameters": values}, stated=stated)


def as_stated(values: Values, dimension: Dimension) -> Dimension:
    """Return a dimension with the uncertainty and the source in its table.

    Raises:
        InputError: for an uncertainty in another unit than the dimension, or not above 0.
    """
    name, unit = dimension.name, dimension.unit
    row, path = values.source.stated[name], ("parameters", name, "uncertainty")
    dimension = replace(dimension, source=row.get("source", ""))
    if "uncertainty" not in row:
        return dimension
    written = row["uncertainty"]
    if is_quantity(written) and of_any_kind(written, f"uncertainty of {name}")[1] != unit:
        raise values.source.error(path, f"is {shown(written)}; give it in the unit of {name}, {unit}")
    own: dict[str, Unit] = {"m": "m", "rad": "rad"}
    value = values.parameter(written, path) * (values.in_si(1.0, own[unit]) if unit in own else 1.0)
    if not value > 0.0:
        raise values.source.error(path, f"is {shown(written)}; give a number above 0")
    return replace(dimension, uncertainty=value)
