"""The result of a sweep as an `xarray.Dataset`, and as a file."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechsim._version import __version__
from mechsim.errors import InputError, cut
from mechsim.files import written_beside
from mechsim.maths.arrays import Array
from mechsim.studies.sweep.libraries import library
from mechsim.studies.sweep.task import OUTCOMES, SweepTask

if TYPE_CHECKING:
    from xarray import Dataset

ENDINGS = (".nc", ".zarr", ".parquet", ".csv")
# columns that are text
TEXTS = ("outcome", "reason")
# the attribute that tells one sweep from another
MARK = "sweep"


def dataset(
    task: SweepTask,
    values: Mapping[str, Array],
    outcome: NDArray[np.int8],
    reason: NDArray[np.object_],
    attributes: Mapping[str, Any],
) -> "Dataset":
    """Return a sweep as a Dataset.

    Dimensions are the parameters of a grid, or `design`; variables the measures, called as they were asked
    for (of FILE.py:FUNC without the folder), `outcome` and `reason`.
    """
    xarray = library("xarray")
    designs, shape, dims = task.designs, task.designs.shape, task.designs.dims
    variables: dict[str, Any] = {}
    for one in task.measures:
        variables[column_name(one.name)] = (dims, values[one.name].reshape(shape), {"units": one.unit or "1"})
    variables["outcome"] = (dims, np.array(OUTCOMES, dtype=object)[outcome].reshape(shape))
    variables["reason"] = (dims, reason.reshape(shape))
    coordinates: dict[str, Any] = {}
    for name, row in designs.values.items():
        along = name if designs.spread == "grid" else "design"
        coordinates[name] = (along, row, {"units": designs.units[name] or "1"})
    about = {
        "model": task.subject.name,
        "mechanism": task.subject.form.name,
        "designs": designs.said,
        "samples": task.samples,
        **_driven(task),
        "mechsim": __version__,
    }
    return xarray.Dataset(variables, coordinates, {**about, **attributes})


def _driven(task: SweepTask) -> dict[str, object]:
    """Return how designs are driven: the speed of a crank, or the duration of motion laws."""
    programs = task.subject.form.programs
    if programs is None:
        return {"speed": task.pace, "speed_units": "rad/s"}
    return {"duration": programs.duration, "duration_units": "s"}


def column_name(measure: str) -> str:
    """Return what a measure is called in a table: as it was asked for, of FILE.py:FUNC without the folder."""
    return Path(measure).name


def ending(path: str | Path) -> str:
    """Return the ending of an output.

    Raises:
        InputError: for another than those known.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in ENDINGS:
        raise InputError(f"{str(path)!r} ends in {suffix or 'nothing'}; sweeps are {', '.join(ENDINGS)}")
    return suffix


def require_libraries(path: str | Path | None) -> None:
    """Refuse at once what would lack a library in the end.

    Raises:
        MissingToolError: naming it.
    """
    needed = {".nc": ("netCDF4",), ".zarr": ("zarr",), ".parquet": ("pyarrow",)}
    for name in ("dask", "xarray", *needed.get("" if path is None else ending(path), ())):
        library(name)


def write_sweep(path: str | Path, found: "Dataset") -> None:
    """Write a sweep as .nc, .zarr, .parquet or .csv, whole or not at all; the same gives the same bytes.

    Raises:
        OutputError: where it cannot be written.
    """
    kind = ending(path)
    if kind == ".zarr":
        _write_zarr(Path(path), found)
        return
    with written_beside(path) as beside:
        if kind == ".nc":
            found.to_netcdf(beside, engine="netcdf4", format="NETCDF4")
        elif kind == ".parquet":
            _write_parquet(beside, found)
        else:
            _write_csv(beside, found)


def _write_zarr(path: Path, found: "Dataset") -> None:
    import shutil

    beside = path.with_name(f".{path.name}.new")
    shutil.rmtree(beside, ignore_errors=True)
    try:
        found.to_zarr(beside, mode="w", zarr_format=2, consolidated=True)
        shutil.rmtree(path, ignore_errors=True)
        beside.replace(path)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def columns(found: "Dataset") -> dict[str, np.ndarray]:
    """Return a sweep as columns: parameters, measures, outcome and reason, a row a design."""
    dims = [str(name) for name in found.dims]
    names = [*map(str, found.coords), *map(str, found.data_vars)]
    wide = {name: found[name].broadcast_like(found["outcome"]).transpose(*dims) for name in names}
    return {name: one.values.ravel() for name, one in wide.items()}


def _write_csv(path: Path, found: "Dataset") -> None:
    table = columns(found)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        rows = (one.tolist() for one in table.values())
        writer.writerows(zip(*rows, strict=True))


def _write_parquet(path: Path, found: "Dataset") -> None:
    import json

    arrow, parquet = library("pyarrow"), library("pyarrow.parquet")
    about = {
        "attributes": {name: _plain(value) for name, value in found.attrs.items()},
        "units": {str(name): one.attrs.get("units", "1") for name, one in found.variables.items()},
        "grid": [str(name) for name in found.dims] if "design" not in found.dims else [],
    }
    table = columns(found)
    arrays = [
        arrow.array(one, arrow.string()).dictionary_encode() if name in TEXTS else arrow.array(one)
        for name, one in table.items()
    ]
    made = arrow.table(arrays, names=[*table]).replace_schema_metadata({b"mechsim": json.dumps(about)})
    parquet.write_table(made, path)


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def read_sweep(path: str | Path) -> "Dataset":
    """Return a sweep that was written; of .csv the units are not known, and grids are lists.

    Raises:
        InputError: for a file that is not there, or holds no sweep.
    """
    kind, xarray = ending(path), library("xarray")
    if not Path(path).exists():
        raise InputError(f"there is no {path}; name a sweep that was written")
    require_libraries(path)
    try:
        if kind == ".nc":
            with xarray.open_dataset(path, engine="netcdf4") as file:
                found = file.load()
        elif kind == ".zarr":
            with xarray.open_zarr(path) as file:
                found = file.load()
        else:
            found = _read_parquet(path) if kind == ".parquet" else _read_csv(path)
    except (OSError, ValueError, KeyError, TypeError) as error:
        line = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} holds no sweep: {cut(line, 120)}") from None
    if "outcome" not in found:
        raise InputError(f"{path} holds no sweep: it has no outcome")
    return found


def _read_parquet(path: str | Path) -> "Dataset":
    import json

    table = library("pyarrow.parquet").read_table(path)
    about = json.loads(table.schema.metadata[b"mechsim"])
    read = {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names}
    return _from_columns(read, about["units"], about["grid"], about["attributes"])


def _read_csv(path: str | Path) -> "Dataset":
    with Path(path).open(encoding="utf-8", newline="") as file:
        head, *rows = list(csv.reader(file))
    read: dict[str, Any] = {}
    for name, cells in zip(head, zip(*rows, strict=True), strict=True):
        read[name] = np.array(cells, dtype=object) if name in TEXTS else np.array([*map(_number, cells)])
    return _from_columns(read, {}, [], {})


def _number(text: str) -> float:
    return float(text) if text else math.nan


def _from_columns(
    read: Mapping[str, Any], units: Mapping[str, str], grid: list[str], attributes: Mapping[str, Any]
) -> "Dataset":
    xarray = library("xarray")
    # parameters are named so that nothing of them has the colon of a measure
    measured = [name for name in read if name in TEXTS or ":" in name or name in FACT_NAMES]
    given = [name for name in read if name not in measured]
    grid = grid or _grid_of({name: read[name] for name in given})
    if grid:
        axes = {name: np.unique(read[name]) for name in grid}
        shape = tuple(len(one) for one in axes.values())
        variables = {name: (grid, read[name].reshape(shape)) for name in measured}
        found = xarray.Dataset(variables, axes, dict(attributes))
    else:
        variables = {name: ("design", read[name]) for name in measured}
        coordinates = {name: ("design", read[name]) for name in given}
        found = xarray.Dataset(variables, coordinates, dict(attributes))
    for name in found.variables:
        if name not in TEXTS:
            found[name].attrs["units"] = units.get(str(name), "1")
    return found


def _grid_of(given: Mapping[str, Any]) -> list[str]:
    """Return the dimensions of columns that are a grid row by row; empty where they are none."""
    axes = [np.unique(one) for one in given.values()]
    if not axes or math.prod(len(one) for one in axes) != len(next(iter(given.values()))):
        return []
    wide = np.meshgrid(*axes, indexing="ij")
    same = all(np.array_equal(a.ravel(), b) for a, b in zip(wide, given.values(), strict=True))
    return [*given] if same else []


FACT_NAMES = ("crank_range", "dead_centres", "assemblies")
