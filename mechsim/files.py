"""Atomic writing and reading of files: motions as tables (`.csv`, `.npz`), numbers as JSON."""

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
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mechsim.errors import InputError, MechsimError, OutputError, several
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import require_memory
from mechsim.units import Unit, table_in_si

Table = dict[str, Array]
EXTENSIONS = (".csv", ".npz")


def is_table(text: str) -> bool:
    """Whether a text is the name of a file with a table."""
    return text.strip().lower().endswith(EXTENSIONS)


# memory in bytes per byte of a text file, and per byte of an unpacked table, whose numbers can have one byte
TEXT_MEMORY_FACTOR, TABLE_MEMORY_FACTOR = 10.0, 10.0
SHORTER = "give a shorter table"
# characters of a mechanism's name that are used in a file name
MAX_STEM_LENGTH = 100
# rows formatted together: enough for speed, few enough for the cache
ROWS = 4096


class Tabled(Protocol):
    """An object with columns, such as a motion."""

    def columns(self) -> Iterable[tuple[str, Array]]:
        """Return names and columns of equal length."""
        ...


def resolved_path(path: str | Path) -> Path:
    """Return the path at the end of symbolic links, if a file can be written there.

    Raises:
        OutputError: if no file can be written there, or an existing file must not be replaced.
    """
    path = Path(path)
    try:
        target = Path(os.path.realpath(path)) if path.is_symlink() else path
        if target.is_dir():
            raise OutputError(f"cannot write {path}: it is a directory; name a file in it")
        if not target.parent.is_dir():
            raise OutputError(f"cannot write {path}: there is no directory {target.parent}; create it first")
        if target.is_symlink():
            raise OutputError(f"cannot write {path}: its links form a circle; name another file")
        # root can write read-only files; they are protected nevertheless
        if target.exists() and not (target.stat().st_mode & 0o222 and os.access(target, os.W_OK)):
            raise OutputError(
                f"cannot write {path}: it is read-only; name another file, or change its permissions"
            )
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        raise _cannot_write(path, error) from error
    return target


def stem_of(name: str) -> str:
    """Return a name as the start of a file name, without characters that shells or paths interpret."""
    return re.sub(r"[^\w.+-]+", "_", name)[-MAX_STEM_LENGTH:].lstrip("-.") or "_"


def require_writable(path: str | Path) -> None:
    """Raise OutputError for a file that cannot be created or written, before there are results to write.

    Raises:
        OutputError: states the reason.
    """
    target = resolved_path(path)
    temporary = _temporary_path(target, target.parent)
    try:
        if not target.exists():
            _make(temporary)
        elif stat.S_ISCHR(target.stat().st_mode):
            # a device that accepts nothing also rejects an empty write
            with target.open("wb", buffering=0) as taker:
                taker.write(b"")
    except OSError as error:
        raise _cannot_write(Path(path), error) from error
    finally:
        temporary.unlink(missing_ok=True)


def _temporary_path(target: Path, folder: Path) -> Path:
    """Return the name of a temporary file, known before the file exists, so that a signal leaves none."""
    return folder / f".{target.stem[:32]}-{secrets.token_hex(4)}{target.suffix}"


def _make(path: Path) -> None:
    """Create an empty file that only its owner can read."""
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))


@contextmanager
def atomic_path(path: str | Path) -> Generator[Path]:
    """Yield a temporary path next to `path`, and move it there when the block ends without an error.

    The temporary file keeps the extension, which some writers require. A reader sees the old file or the
    complete new one, and an error leaves no file behind. A symbolic link is kept and its target written. Into
    a device or a named pipe the file is copied.

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
            # a full disk may be reported only when the data reach it
            with temporary.open("rb") as whole:
                os.fsync(whole.fileno())
            # permissions of a new file; before, only its owner could read it
            temporary.chmod(stat.S_IMODE(target.stat().st_mode) if exists else 0o666 & ~_umask())
            temporary.replace(target)
    except OutputError:
        raise
    except OSError as error:
        raise _cannot_write(Path(path), error) from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path) -> Generator[Path]:
    """Yield an empty folder, and move its files into the folder `path` when the block ends without an error.

    It is `path/.unfinished`. Until the block ends, files of an earlier result stay as they were. A new folder
    is removed again after an error. A lock rejects a second process that writes into the same folder. What a
    killed process left is removed.

    Raises:
        OutputError: if the folder cannot be made or written, or another process writes into it.
    """
    path = os.fspath(path)
    folder = Path(path)
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise OutputError(f"cannot write into {path!r}: it is a file; name a folder")
    if not os.path.isdir(folder.parent):
        raise OutputError(
            f"cannot make the folder {path!r}: there is no folder {str(folder.parent)!r}; create it first"
        )
    is_new = not os.path.isdir(folder)
    unfinished = folder / ".unfinished"
    try:
        folder.mkdir(exist_ok=True)
        with _locked(folder):
            shutil.rmtree(unfinished, ignore_errors=True)
            unfinished.mkdir()
            try:
                yield unfinished
                for file in unfinished.iterdir():
                    file.replace(folder / file.name)
            finally:
                shutil.rmtree(unfinished, ignore_errors=True)
    except MechsimError:
        raise
    except (OSError, ValueError) as error:
        raise _cannot_write(folder, error) from error
    finally:
        if is_new:
            # only an empty folder can be removed
            with suppress(OSError, ValueError):
                folder.rmdir()


@contextmanager
def _locked(folder: Path) -> Generator[None]:
    """Hold a lock on a folder that ends with the process; systems without `flock` lock nothing.

    Raises:
        OutputError: if another process holds it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise OutputError(
            f"another process writes into {folder}; wait until it ends, or name another folder"
        ) from None
    finally:
        os.close(lock)


def json_names(record: type) -> dict[str, str]:
    """Return key in JSON -> field or property of a record: those listed in `JSON`, or its fields.

    An item of `JSON` is a name, or KEY=NAME if the key differs.
    """
    listed = getattr(record, "JSON", None) or [field.name for field in fields(record)]
    items = (item.partition("=") for item in listed)
    return {key: name or key for key, _, name in items}


def attributes(record: object, *names: str) -> dict[str, Any]:
    """Return some attributes of a record, for JSON."""
    return {name: getattr(record, name) for name in names}


def plain(value: Any) -> Any:
    """Return a value for JSON: records and mappings as objects, arrays as lists, NaN and infinity as None."""
    if is_dataclass(value):
        return {key: plain(getattr(value, name)) for key, name in json_names(type(value)).items()}
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
        OutputError: if the file cannot be written.
    """
    write_content(path, json.dumps(plain(value), indent=1, allow_nan=False) + "\n")


def write_content(path: str | Path, content: str | bytes) -> None:
    """Write text in UTF-8, or bytes.

    Raises:
        OutputError: if the file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def write(path: str | Path, motion: Tabled) -> None:
    """Write the columns of a motion (see `Motion.columns`) in SI.

    Args:
        path: ends in `.csv` (a header, then numbers that read back to the last bit) or `.npz`.
        motion: the motion.

    Raises:
        InputError: for another extension.
        OutputError: if the file cannot be written.
    """
    write_table(path, dict(motion.columns()))


def write_table(path: str | Path, table: Mapping[str, Array]) -> None:
    """Write columns of numbers as `.csv` or `.npz`, as `write`.

    Raises:
        InputError: for another extension.
        OutputError: if the file cannot be written.
    """
    if _kind(path) == ".csv":
        write_tables(path, [table])
        return
    with atomic_path(path) as temporary:
        np.savez_compressed(temporary, allow_pickle=False, **table)  # pyright: ignore[reportArgumentType]


def write_tables(path: str | Path, tables: Iterable[Mapping[str, Array]]) -> None:
    """Write consecutive tables with the same columns as one `.csv`, with at most one table in memory.

    Raises:
        OutputError: if the file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        for number, table in enumerate(tables):
            if number == 0:
                file.write(csv_head(table))
            file.writelines(csv_lines(table))


def read_text(path: str | Path, kind: str, largest: int | None = None) -> str:
    """Return the text of a file in UTF-8, with or without a byte-order mark.

    Args:
        path: of the file.
        kind: what it is, as in "a TOML file".
        largest: size in bytes.

    Raises:
        InputError: for a missing or too large file, or one that is no text.
    """
    require_file(path, kind, largest)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text in UTF-8; name {kind} in that encoding") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None


def require_file(path: str | Path, kind: str, largest: int | None = None) -> None:
    """Raise InputError for what is no regular file or exceeds a size in bytes; arguments of `read_text`."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name {kind}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path} is no regular file; name {kind}")
    if largest is not None and status.st_size > largest:
        raise InputError(f"{path} has {status.st_size} bytes; {kind} has {largest} at most")


def read_rows(path: str | Path, kind: str) -> list[list[str]]:
    """Return the entries of the rows of a `.csv` file that are not empty, without spaces around them.

    Raises:
        InputError: as `read_text`.
    """
    rows = csv.reader(io.StringIO(read_text(path, kind), newline=""))
    return [[entry.strip() for entry in row] for row in rows if any(row)]


def read(path: str | Path) -> Table:
    """Read a table back: column name -> (n,) numbers.

    Raises:
        InputError: for another extension, a missing file, one without a table of numbers, or one that exceeds
            the memory.
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
        raise InputError(f"{path} holds no table of numbers with a header: it is not text") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{path} holds no table of numbers with a header: {first_line}") from error
    except MemoryError:
        raise InputError(f"{path} needs more than the memory; give a shorter table") from None


def read_in_si(path: str | Path, units: Mapping[str, Unit] | None = None) -> Table:
    """Read a table whose headers may have units (`units.table_in_si`), as `read`."""
    return table_in_si(read(path), str(path), units)


def csv_head(names: Iterable[str]) -> str:
    """Return the first line of a table: names separated by commas, quoted if they contain a comma."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(names)
    return line.getvalue()


def csv_lines(table: Mapping[str, Array]) -> Iterator[str]:
    """Yield the rows of a table as text, many at a time, with numbers that read back to the last bit."""
    line = ",".join(["%.17g"] * len(table)) + "\n"
    columns = list(table.values())
    for start in range(0, len(columns[0]), ROWS):
        block = np.column_stack([column[start : start + ROWS] for column in columns])
        yield line * len(block) % tuple(block.ravel().tolist())


def _read_csv(path: Path) -> Table:
    require_memory(f"what {path.name} holds", path.stat().st_size, TEXT_MEMORY_FACTOR, SHORTER)
    # spreadsheets start text with a byte-order mark
    with path.open(encoding="utf-8-sig") as file:
        head, *lines = file.read().splitlines() or [""]
    if not any(line.strip() for line in lines):
        raise ValueError("it has no row of numbers")
    names = [name.strip() for name in next(csv.reader([head]), [])]
    try:
        rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    except ValueError:
        raise ValueError(_first_bad(names, lines)) from None
    if rows.shape[1] != len(names):
        raise ValueError(f"it has {len(names)} names for {rows.shape[1]} columns")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"it has column {twice!r} twice")
    return dict(zip(names, np.ascontiguousarray(rows.T), strict=True))


def _first_bad(names: list[str], lines: list[str]) -> str:
    """Return the error in the first row that does not have one number for each name."""
    for number, line in enumerate(lines, 2):
        entries = line.split(",")
        if len(entries) != len(names):
            return f"line {number} has {several(len(entries), 'value')} for {several(len(names), 'name')}"
        for name, entry in zip(names, entries, strict=True):
            try:
                float(entry)
            except ValueError:
                return f"{entry.strip()!r} in line {number} under {name!r} is no number"
    return "its rows are not numbers separated by commas"


def _read_npz(path: Path) -> Table:
    with zipfile.ZipFile(path) as packed:
        total = sum(member.file_size for member in packed.infolist())
        require_memory(f"what {path.name} holds", total, TABLE_MEMORY_FACTOR, SHORTER)
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
        f"cannot write {path}: {getattr(error, 'strerror', None) or error}; choose another path"
    )
