"""A figure of a sweep file."""

from typing import Any

from mechsim.pictures.plots.sweep import SweepTable, sweep_plot
from mechsim.studies.sweep.table import TEXTS, columns, read_sweep


def drawn_sweep(path: str, measures: tuple[str, ...] | None, kind: str | None) -> Any:
    """Return a figure of a sweep file.

    Args:
        path: of the sweep.
        quantity: measures to draw; None for all.
        kind: of plot; None for what suits.

    Raises:
        InputError: for a file without a sweep, or a measure it does not contain.
    """
    result = read_sweep(path)
    table = columns(result)
    parameter_names = [str(name) for name in result.coords]
    measure_names = [name for name in table if name not in (*parameter_names, *TEXTS)]
    measured_columns = {name: table[name] for name in measure_names}
    description = {
        str(name): str(variable.attrs.get("units", "1")) for name, variable in result.variables.items()
    }
    title = str(result.attrs.get("model", path))
    parameters = {name: table[name] for name in parameter_names}
    return sweep_plot(
        SweepTable(title, parameters, measured_columns, description, result["outcome"].shape), measures, kind
    )
