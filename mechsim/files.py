"""Files written whole or not at all: a motion as a table of columns (`.csv`, `.npz`), numbers as JSON."""

import csv
import io
import json
import math
import os
import re
import secrets
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mechsim.errors import InputError, OutputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import require_memory

Table = dict[str, Array]
EXTENSIONS = (".csv", ".npz")

# bytes in memory for each byte of text, and for each of an unpacked table, whose numbers may be of one byte
IN_MEMORY, UNPACKED = 10.0, 10.0
SHORTER = "give a shorter table"
# characters of a file's name that come from a name of a mechanism
LONGEST_STEM = 100
# rows formatted in one go: long enough to be fast, short enough to stay in the cache
ROWS = 4096


class Tabled(Protocol):
    """What is a table of columns, such as a motion."""

    def columns(self) -> Iterable[tuple[str, Array]]:
        """Return names and columns of equal length."""
        ...


def resolved_path(path: str | Path) -> Path:
    """Return where a file that is asked for really lies: what a symbolic link points to.

    Raises:
        OutputError: where no file can be written there, or one lies there that must not be.
    """
    path = Path(path)
    try:
        target = Path(os.path.realpath(path)) if path.is_symlink() else path
        if target.is_dir():
            raise OutputError(f"cannot write {path}: it is a directory; name a file in it")
        if not target.parent.is_dir():
            raise OutputError(f"cannot write {path}: there is no directory {target.parent}; make it first")
        if target.is_symlink():
            raise OutputError(f"cannot write {path}: its links lead in a circle; name another file")
        # root may write what nobody may; it is protected all the same
        if target.exists() and not (target.stat().st_mode & 0o222 and os.access(target, os.W_OK)):
            raise OutputError(
                f"cannot write {path}: it is read-only; name another file, or change its rights"
            )
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        raise _cannot_write(path, error) from error
    return target


def stem_of(name: str) -> str:
    """Return a name as the beginning of a file's, without what leads to another folder or upsets a shell."""
    return re.sub(r"[^\w.+-]+", "_", name)[-LONGEST_STEM:].lstrip("-.") or "_"


def require_writable(path: str | Path) -> None:
    """Refuse a file that cannot be made or written, before there is anything to write.

    Raises:
        OutputError: says why.
    """
    target = resolved_path(path)
    if not target.exists():
        temporary = _temporary_path(target, target.parent)
        try:
            _make(temporary)
        except OSError as error:
            raise _cannot_write(Path(path), error) from error
        finally:
            temporary.unlink(missing_ok=True)
    elif stat.S_ISCHR(target.stat().st_mode):
        # a device that takes nothing says so of no bytes, too
        try:
            with target.open("wb", buffering=0) as taker:
                taker.write(b"")
        except OSError as error:
            raise _cannot_write(Path(path), error) from error


def _temporary_path(target: Path, folder: Path) -> Path:
    """Return a temporary path, named before it is made: no signal comes between that and its care."""
    return folder / f".{target.stem[:32]}-{secrets.token_hex(4)}{target.suffix}"


def _make(path: Path) -> None:
    """Make an empty file that only its owner can read."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))


@contextmanager
def atomic_path(path: str | Path) -> Generator[Path]:
    """Yield a temporary path next to `path`, and move it there when the block ends without an error.

    The temporary file keeps the extension, so that writers which go by it are content. A reader sees
    the old file or the whole new one, never a part; nothing is left behind if the block raises. A symbolic
    link stays one, and what it points to is written; into a device or a named pipe the file is copied.

    Raises:
        OutputError: if the directory does not exist, or the file cannot be written there.
    """
    target = resolved_path(path)
    exists = target.exists()
    special = exists and not target.is_file()
    folder = tempfile.gettempdir() if special else target.parent
    temporary = _temporary_path(target, Path(folder))
    try:
        _make(temporary)
        yield temporary
        if special:
            with temporary.open("rb") as whole, target.open("wb") as taker:
                shutil.copyfileobj(whole, taker)
        else:
            # until now only its owner could read it
            temporary.chmod(stat.S_IMODE(target.stat().st_mode) if exists else 0o666 & ~_umask())
            temporary.replace(target)
    except OutputError:
        raise
    except OSError as error:
        raise _cannot_write(Path(path), error) from error
    finally:
        temporary.unlink(missing_ok=True)


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
    with atomic_path(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write(path: str | Path, motion: Tabled) -> None:
    """Write the columns of a motion (see `Motion.columns`) in SI.

    Args:
        path: ends in `.csv` (a header, then numbers that read back to the last bit) or `.npz`.
        motion: what to write.

    Raises:
        InputError: for another extension.
        OutputError: where the file cannot be written.
    """
    write_table(path, dict(motion.columns()))


def write_table(path: str | Path, table: Mapping[str, Array]) -> None:
    """Write columns of numbers as `.csv` or `.npz`, as `write` does those of a motion.

    Raises:
        InputError: for another extension.
        OutputError: where the file cannot be written.
    """
    kind = _kind(path)
    with atomic_path(path) as temporary:
        if kind == ".csv":
            _write_csv(temporary, table)
        else:
            np.savez_compressed(temporary, allow_pickle=False, **table)  # pyright: ignore[reportArgumentType]


def write_records(path: str | Path, records: Iterable[Tabled]) -> None:
    """Write a motion that comes part by part as `.csv`, with no more than one part in memory.

    Raises:
        OutputError: where the file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        for number, record in enumerate(records):
            table = dict(record.columns())
            if number == 0:
                file.write(csv_head(table))
            file.writelines(csv_lines(table))


def read(path: str | Path) -> Table:
    """Read a table back: column name -> (n,) numbers.

    Raises:
        InputError: for another extension, a file that is not there, one that holds no such table, or one
            that memory does not hold.
    """
    kind = _kind(path)
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InputError(f"{path} is no regular file; name one that holds a table")
        return _read_csv(Path(path)) if kind == ".csv" else _read_npz(Path(path))
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name one that can be read") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} holds no table of numbers with a header: it is no text") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} holds no table of numbers with a header: {first_line}") from error
    except MemoryError:
        raise InputError(f"{path} holds more than memory; give a shorter table") from None


def _write_csv(path: Path, table: Mapping[str, Array]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(csv_head(table))
        file.writelines(csv_lines(table))


def csv_head(names: Iterable[str]) -> str:
    """Return the first line of a table: names with commas between, in quotes where they hold a comma."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(names)
    return line.getvalue()


def csv_lines(table: Mapping[str, Array]) -> Iterator[str]:
    """Yield the rows of a table as text, many at a time, in numbers that read back to the last bit."""
    line = ",".join(["%.17g"] * len(table)) + "\n"
    columns = list(table.values())
    for start in range(0, len(columns[0]), ROWS):
        block = np.column_stack([column[start : start + ROWS] for column in columns])
        yield line * len(block) % tuple(block.ravel().tolist())


def _read_csv(path: Path) -> Table:
    require_memory(f"what {path.name} holds", path.stat().st_size, IN_MEMORY, SHORTER)
    # a spreadsheet begins its text with a mark of the encoding
    with path.open(encoding="utf-8-sig") as file:
        head, *lines = file.read().splitlines() or [""]
    if not lines:
        raise ValueError("it has no row of numbers")
    names = [name.strip() for name in next(csv.reader([head]), [])]
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
        entries = line.split(",")
        if len(entries) != len(names):
            return f"line {number} has {len(entries)} values under {len(names)} names"
        for name, entry in zip(names, entries, strict=True):
            try:
                float(entry)
            except ValueError:
                return f"{entry.strip()!r} in line {number} under {name!r} is no number"
    return "its rows are not numbers with commas between"


def _read_npz(path: Path) -> Table:
    with zipfile.ZipFile(path) as packed:
        require_memory(
            f"what {path.name} holds",
            sum(member.file_size for member in packed.infolist()),
            UNPACKED,
            SHORTER,
        )
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


def _cannot_write(path: Path, error: Exception) -> OutputError:
    return OutputError(
        f"cannot write {path}: {getattr(error, 'strerror', None) or error}; choose another place"
    )
