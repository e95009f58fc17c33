"""Paths of files that commands write: options, and checks before any computation."""

import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from mechsim import files
from mechsim.errors import InputError, OutputError, require_extra


def output_file(contents: str, *suffixes: str, name: str = "--output", metavar: str = "FILE") -> Any:
    """Declare an option for a file to write; its help states the contents and the suffixes.

    The path, or each of a list, is checked before the command runs; without suffixes the command checks it.
    """

    def check(context: typer.Context, value: Any) -> Any:
        if suffixes and not context.resilient_parsing:
            for path in [value] if isinstance(value, str) else value or ():
                writable(path, *suffixes)
        return value

    names = ("-o", name) if name == "--output" else (name,)
    return typer.Option(*names, metavar=metavar, help=contents, callback=check)


TABLES, PLOTS = (".csv", ".npz"), (".svg", ".pdf", ".png")


def table_file(contents: str) -> Any:
    """Declare the option for a table to write, as `output_file`."""
    return output_file(f"{contents}: .csv or .npz.", *TABLES)


def plot_file(contents: str) -> Any:
    """Declare the option for a plot to write, as `output_file`."""
    return output_file(f"{contents}: .svg, .pdf or .png.", *PLOTS)


def table_or_plot_file(table: str, plot: str, tables: tuple[str, ...] = TABLES) -> Any:
    """Declare the option, to be given once or twice, for a table and a plot to write."""
    contents = f"{table}: {' or '.join(tables)}; or {plot}: .svg, .pdf or .png. Give it twice for both."
    return output_file(contents, *tables, *PLOTS)


def one_of_each(paths: Sequence[str] | None, *kinds: tuple[str, ...]) -> list[str | None]:
    """Return the path with a suffix of each kind, None without one.

    Raises:
        InputError: for two paths of one kind.
    """
    chosen: list[str | None] = []
    for suffixes in kinds:
        own = [path for path in paths or () if Path(path).suffix.lower() in suffixes]
        if len(own) > 1:
            raise InputError(f"-o names {' and '.join(map(repr, own))}; give one of each kind")
        chosen.append(own[0] if own else None)
    return chosen


def writable(path: str, *extensions: str) -> Path:
    """Return an output path, checked before any computation."""
    target = Path(path)
    if os.path.isdir(target):
        raise OutputError(f"cannot write {path!r}: it is a folder; give a file name")
    if extensions and target.suffix.lower() not in extensions:
        extensions_text = ", ".join(filter(None, extensions))
        raise InputError(f"{path!r} ends in {target.suffix or 'no suffix'}; choose from {extensions_text}")
    folder = target.parent
    if not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write {path!r}: {str(folder)!r} is not a writable folder; create it first")
    files.require_writable(target)
    return target


@contextmanager
def output_folder(path: str | None) -> Generator[Path | None]:
    """Yield a folder for the files of a report, which appear in `path` together; None without a path.

    Raises:
        OutputError: before any computation, as `files.atomic_folder`.
    """
    if path is None:
        yield None
        return
    require_extra("pictures", "jinja2", "matplotlib", "mediapy")
    with files.atomic_folder(path) as unfinished:
        yield unfinished
