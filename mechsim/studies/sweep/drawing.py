"""A sweep that was written, as a figure."""

from typing import Any

from mechsim.pictures.plots.sweep import SweepTable, sweep_plot
from mechsim.studies.sweep.table import TEXTS, columns, read_sweep


def drawn_sweep(path: str, of: tuple[str, ...] | None, kind: str | None) -> Any:
    """Return a sweep that was written as a figure.

    Args:
        path: of the sweep.
        of: measures to draw; None for all.
        kind: of plot; None for what suits.

    Raises:
        InputError: for a file that holds no sweep, or what it does not hold.
    """
    found = read_sweep(path)
    table = columns(found)
    given = [str(name) for name in found.coords]
    measured = [name for name in table if name not in (*given, *TEXTS)]
    numbers = {name: table[name] for name in measured}
    said = {str(name): str(one.attrs.get("units", "1")) for name, one in found.variables.items()}
    title = str(found.attrs.get("model", path))
    parameters = {name: table[name] for name in given}
    return sweep_plot(SweepTable(title, parameters, numbers, said, found["outcome"].shape), of, kind)
