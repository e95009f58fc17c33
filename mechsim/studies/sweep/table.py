"""The result of a sweep as an `xarray.Dataset`, and as a file."""

import warnings
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechsim._version import __version__
from mechsim.errors import InputError, needs
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
        # FILE.py:FUNC loses its folder
        Path(column.name).name: (dims, values[column.name].reshape(shape), {"units": column.unit or "1"})
        for column in task.measures
    }
    texts = {"outcome": np.array(OUTCOMES, dtype=object)[outcome], "reason": reason}
    variables = measured | {name: (dims, text.reshape(shape), {}) for name, text in texts.items()}
    coordinates = {
        name: (name if designs.spread == "grid" else "design", row, {"units": designs.units[name] or "1"})
        for name, row in designs.values.items()
    }
    laws = task.subject.solver.motion_laws
    driven = {"speed": task.path_speed, "speed_units": "rad/s"}
    if not laws.crank:
        driven = {"duration": laws.duration, "duration_units": "s"}
    about = {
        "model": task.subject.name,
        "mechanism": task.subject.solver.name,
        "designs": designs.description,
        "samples": task.samples,
        **driven,
        "mechsim": __version__,
    }
    return xarray.Dataset(variables, coordinates, about)


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
            try:
                result.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
            except RuntimeError as error:
                # netCDF4 reports so what HDF5 could not write, as on a full disk
                raise OSError(f"{error}; is the disk full?") from error
        else:
            table = library("pandas").DataFrame(design_columns(result))
            table.to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")


def design_columns(result: "Dataset") -> dict[str, np.ndarray]:
    """Return a sweep as columns: parameters, measures, outcome and reason, with a row for each design."""
    dims = [str(name) for name in result.dims]
    names = [*map(str, result.coords), *map(str, result.data_vars)]
    broadcast = {name: result[name].broadcast_like(result["outcome"]).transpose(*dims) for name in names}
    return {name: column.values.ravel() for name, column in broadcast.items()}
