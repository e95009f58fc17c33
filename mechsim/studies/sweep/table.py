"""The result of a sweep as an `xarray.Dataset`, and as a file."""

import math
import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechsim._version import __version__
from mechsim.errors import InputError, cut, needs
from mechsim.files import atomic_path
from mechsim.numerics.arrays import Array
from mechsim.studies.sweep.task import OUTCOMES, SweepTask

if TYPE_CHECKING:
    from xarray import Dataset


def library(name: str) -> Any:
    """Return a library.

    Raises:
        MissingToolError: if it is not installed.
    """
    with needs("sweep"), warnings.catch_warnings():
        # harmless according to numpy's documentation
        warnings.filterwarnings("ignore", "numpy.ndarray size changed")
        return import_module(name)


SUFFIXES = (".nc", ".csv")
# names of text columns
TEXTS = ("outcome", "reason")


def dataset(
    task: SweepTask,
    values: Mapping[str, Array],
    outcome: NDArray[np.int8],
    reason: NDArray[np.object_],
) -> "Dataset":
    """Return a sweep as a Dataset.

    Dimensions are the parameters of a grid, or `design`. Variables are the measures by their requested names
    (FILE.py:FUNC without the folder), `outcome` and `reason`.
    """
    xarray = library("xarray")
    designs, shape, dims = task.designs, task.designs.shape, task.designs.dims
    measured = {
        column_name(column.name): (dims, values[column.name].reshape(shape), {"units": column.unit or "1"})
        for column in task.measures
    }
    texts = {"outcome": np.array(OUTCOMES, dtype=object)[outcome], "reason": reason}
    variables = measured | {name: (dims, text.reshape(shape), {}) for name, text in texts.items()}
    coordinates = {
        name: (name if designs.spread == "grid" else "design", row, {"units": designs.units[name] or "1"})
        for name, row in designs.values.items()
    }
    about = {
        "model": task.subject.name,
        "mechanism": task.subject.solver.name,
        "designs": designs.description,
        "samples": task.samples,
        **_driven(task),
        "mechsim": __version__,
    }
    return xarray.Dataset(variables, coordinates, about)


def _driven(task: SweepTask) -> dict[str, object]:
    """Return the speed of the crank, or the duration of the motion laws."""
    motion_laws = task.subject.solver.motion_laws
    if motion_laws.crank:
        return {"speed": task.path_speed, "speed_units": "rad/s"}
    return {"duration": motion_laws.duration, "duration_units": "s"}


def column_name(measure: str) -> str:
    """Return the name of a measure in a table: the requested one; FILE.py:FUNC loses its folder."""
    return Path(measure).name


def suffix_of(path: str | Path) -> str:
    """Return the suffix of an output file.

    Raises:
        InputError: for an unknown suffix.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{str(path)!r} ends in {suffix or 'no suffix'}; choose from {', '.join(SUFFIXES)}")
    return suffix


def require_libraries(path: str | Path | None) -> None:
    """Reject an output early if its library is missing.

    Raises:
        MissingToolError: for a missing library.
    """
    library("xarray")
    if path is not None and suffix_of(path) == ".nc":
        library("netCDF4")


def write_sweep(path: str | Path, result: "Dataset") -> None:
    """Write a sweep as .nc or .csv atomically; equal sweeps give equal bytes.

    Raises:
        OutputError: if it cannot be written.
    """
    kind = suffix_of(path)
    with atomic_path(path) as temporary:
        if kind == ".nc":
            result.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
        else:
            table = library("pandas").DataFrame(design_columns(result))
            table.to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")


def design_columns(result: "Dataset") -> dict[str, np.ndarray]:
    """Return a sweep as columns: parameters, measures, outcome and reason, with a row for each design."""
    dims = [str(name) for name in result.dims]
    names = [*map(str, result.coords), *map(str, result.data_vars)]
    broadcast = {name: result[name].broadcast_like(result["outcome"]).transpose(*dims) for name in names}
    return {name: column.values.ravel() for name, column in broadcast.items()}


def read_sweep(path: str | Path) -> "Dataset":
    """Return a sweep from a file. A .csv file has no units, and its grids become lists.

    Raises:
        InputError: for a missing file, or a file without a sweep.
    """
    kind, xarray = suffix_of(path), library("xarray")
    if not Path(path).exists():
        raise InputError(f"there is no file {path}; name the output of a sweep")
    require_libraries(path)
    try:
        if kind == ".nc":
            with xarray.open_dataset(path, engine="netcdf4") as file:
                result = file.load()
        else:
            result = _from_columns(_read_csv(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        line = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} contains no sweep: {cut(line, 120)}") from None
    if "outcome" not in result:
        raise InputError(f"{path} contains no sweep: it has no column outcome")
    return result


def _read_csv(path: str | Path) -> dict[str, Any]:
    texts = library("pandas").read_csv(path, dtype=str, keep_default_na=False)
    return {
        name: column.to_numpy(object) if name in TEXTS else column.replace("", "nan").to_numpy(float)
        for name, column in texts.items()
    }


def _from_columns(columns_read: Mapping[str, Any]) -> "Dataset":
    # parameter names contain no colon, unlike measures
    measured = [name for name in columns_read if name in TEXTS or ":" in name or name in FACT_NAMES]
    parameters = {name: column for name, column in columns_read.items() if name not in measured}
    if grid := _grid_of(parameters):
        axes = {name: np.unique(column) for name, column in parameters.items()}
        shape = tuple(len(column) for column in axes.values())
        variables = {name: (grid, columns_read[name].reshape(shape)) for name in measured}
    else:
        variables = {name: ("design", columns_read[name]) for name in measured}
        axes = {name: ("design", column) for name, column in parameters.items()}
    result = library("xarray").Dataset(variables, axes)
    for name in result.variables:
        if name not in TEXTS:
            result[name].attrs["units"] = "1"
    return result


def _grid_of(parameter_names: Mapping[str, Any]) -> list[str]:
    """Return the dimensions of columns that form a grid row by row; empty for others."""
    axes = [np.unique(column) for column in parameter_names.values()]
    if not axes or math.prod(len(column) for column in axes) != len(next(iter(parameter_names.values()))):
        return []
    broadcast = np.meshgrid(*axes, indexing="ij")
    is_grid = all(
        np.array_equal(a.ravel(), b) for a, b in zip(broadcast, parameter_names.values(), strict=True)
    )
    return [*parameter_names] if is_grid else []


FACT_NAMES = ("crank_range", "dead_centres", "assemblies")
