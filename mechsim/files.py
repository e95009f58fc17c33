"""Files written whole or not at all: a motion as a table of columns (`.csv`, `.npz`), numbers as JSON."""

import json
import math
import os
import tempfile
import zipfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import InputError, OutputError
from mechsim.maths.arrays import Array
from mechsim.model.motion import Motion

Table = dict[str, Array]
EXTENSIONS = (".csv", ".npz")

# rows formatted in one go: long enough to be fast, short enough to stay in the cache
ROWS = 4096


@contextmanager
def written_beside(path: str | Path) -> Generator[Path]:
    """Give a temporary path beside `path`, and put it in its place when the block ends well.

    The temporary file keeps the extension, so that writers which go by it are content. A reader sees
    the old file or the whole new one, never a part; nothing is left behind if the block raises.

    Raises:
        OutputError: if the directory does not exist, or the file cannot be written there.
    """
    path = Path(path)
    if path.is_dir():
        raise OutputError(f"cannot write {path}: it is a directory; name a file in it")
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: there is no directory {path.parent}; make it first")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem[:32]}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise _cannot_write(path, error) from error
    beside = Path(name)
    try:
        yield beside
        # mkstemp makes files that only their owner reads
        beside.chmod(0o666 & ~_umask())
        beside.replace(path)
    except OutputError:
        raise
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        beside.unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, numbers that are none as None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: str | Path, value: Any) -> None:
    """Write a value as JSON (see `plain`).

    Raises:
        OutputError: where the file cannot be written.
    """
    text = json.dumps(plain(value), indent=1, allow_nan=False)
    with written_beside(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def write(path: str | Path, motion: Motion) -> None:
    """Write the columns of a motion (see `Motion.columns`) in SI.

    Args:
        path: ends in `.csv` (a header, then numbers that read back to the last bit) or `.npz`.
        motion: what to write.

    Raises:
        InputError: for another extension.
        OutputError: where the file cannot be written.
    """
    kind = _kind(path)
    table = dict(motion.columns())
    with written_beside(path) as beside:
        if kind == ".csv":
            _write_csv(beside, table)
        else:
            np.savez_compressed(beside, allow_pickle=False, **table)  # pyright: ignore[reportArgumentType]


def read(path: str | Path) -> Table:
    """Read a table back: column name -> (n,) numbers.

    Raises:
        InputError: for another extension, a file that is not there, or one that holds no such table.
    """
    kind = _kind(path)
    try:
        return _read_csv(Path(path)) if kind == ".csv" else _read_npz(Path(path))
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name one that can be read") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} holds no table of numbers with a header: it is no text") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} holds no table of numbers with a header: {first_line}") from error


def _write_csv(path: Path, table: Mapping[str, Array]) -> None:
    rows = np.column_stack(list(table.values()))
    line = ",".join(["%.17g"] * rows.shape[1]) + "\n"
    with path.open("w", encoding="ascii", newline="") as file:
        file.write(",".join(table) + "\n")
        for start in range(0, len(rows), ROWS):
            block = rows[start : start + ROWS]
            file.write(line * len(block) % tuple(block.ravel().tolist()))


def _read_csv(path: Path) -> Table:
    with path.open(encoding="ascii") as file:
        names, *lines = file.read().splitlines() or [""]
    if not lines:
        raise ValueError("it has no row of numbers")
    names = names.split(",")
    try:
        rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    except ValueError:
        raise ValueError(_first_bad(names, lines)) from None
    if rows.shape[1] != len(names):
        raise ValueError(f"{len(names)} names stand over {rows.shape[1]} columns")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"column {twice!r} stands there twice")
    return dict(zip(names, np.ascontiguousarray(rows.T), strict=True))


def _first_bad(names: list[str], lines: list[str]) -> str:
    """Return what is wrong with the first row that is not one number under each name."""
    for number, line in enumerate(lines, 2):
        cells = line.split(",")
        if len(cells) != len(names):
            return f"line {number} has {len(cells)} values under {len(names)} names"
        for name, cell in zip(names, cells, strict=True):
            try:
                float(cell)
            except ValueError:
                return f"{cell.strip()!r} in line {number} under {name!r} is no number"
    return "its rows are not numbers with commas between"


def _read_npz(path: Path) -> Table:
    with np.load(path, allow_pickle=False) as file:
        return {name: np.asarray(file[name], dtype=np.float64) for name in file.files}


def _kind(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in EXTENSIONS:
        raise InputError(f"{path} ends in {suffix or 'no extension'}; tables are {' or '.join(EXTENSIONS)}")
    return suffix


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(f"cannot write {path}: {error.strerror or error}; choose another place")
