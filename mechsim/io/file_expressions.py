"""The expressions of a TOML file whose parameters are the dimensions of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mechsim.io.formula_file import FormulaDescription
from mechsim.io.toml_reader import TomlModel
from mechsim.io.toml_values import Values
from mechsim.kinematics.designs import DesignFamily


@dataclass(frozen=True)
class FileExpressions:
    """The expressions of a file.

    Attributes:
        document: its tables.
        values: values of the file at the nominal parameters.
        parameters: parameter -> its expression, or its number in the file's unit.
        units: parameter -> SI unit, of those that are dimensions.
    """

    document: Mapping[str, Any]
    values: Values
    parameters: Mapping[str, Any]
    units: Mapping[str, Any]


def parameter_name(dimension: str) -> str:
    """Return the name of a dimension as that of a parameter, which has no dots."""
    return dimension.replace(".", "_")


def expressions_of(
    model: object, designs: DesignFamily, changed: Mapping[str, str | float]
) -> FileExpressions | None:
    """Return the expressions of a file whose parameters are the dimensions of its designs; None without.

    Args:
        model: the opened model of these designs.
        designs: the parametric model of the mechanism.
        changed: parameter -> its value, as `load` takes it.
    """
    units = {parameter_name(name): dimension.unit for name, dimension in designs.dimensions.items()}
    if isinstance(model, FormulaDescription):
        document, values = model.description(changed)
        parameters: Mapping[str, Any] = values.parameters
    elif isinstance(model, TomlModel):
        document, values = model.source.document, model.values(changed)
        parameters = {
            name: values.parameters[name] if name in changed else text
            for name, text in document.get("parameters", {}).items()
        }
    else:
        return None
    return FileExpressions(document, values, parameters, units) if {*units} <= {*parameters} else None
