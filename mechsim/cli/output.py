"""What commands print: one JSON object, or tables for people; progress on stderr."""

import json
import os
import sys
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import typer

from mechsim.files import plain

# between two lines of progress where there is no terminal
SECONDS = 10.0


def print_json(value: Any) -> None:
    """Print one JSON object; numbers that JSON does not have become null."""
    typer.echo(json.dumps(plain(value), indent=2, allow_nan=False))


def print_table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table that fits the terminal, or plain wide text where there is none."""
    from rich.console import Console
    from rich.table import Table

    told = sys.stdout.isatty() or "COLUMNS" in os.environ
    console = Console(width=None if told else 160)
    table = Table(title=title, title_justify="left", header_style="bold")
    for name in head:
        table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console.print(table, markup=False)


class Tick(Protocol):
    """Called after each piece of work, with what was done."""

    def __call__(self, done: str = "", /) -> None:
        """Advance by one."""
        ...


def _nothing(done: str = "") -> None:
    pass


def _lines(what: str, total: int | None) -> Tick:
    """Return a tick that prints a line when the last one is long past."""
    count, last = 0, time.monotonic()

    def tick(done: str = "") -> None:
        nonlocal count, last
        count += 1
        if time.monotonic() - last > SECONDS:
            last = time.monotonic()
            far = [] if total is None else [f"{count} of {total}"]
            typer.echo(f"{what}: {', '.join([*far, done])}", err=True)

    return tick


@contextmanager
def progress(what: str, total: int | None, *, quiet: bool = False) -> Generator[Tick]:
    """Show on stderr how far long work has come: a bar, or a line now and then where there is no terminal."""
    if quiet:
        yield _nothing
        return
    if not sys.stderr.isatty():
        yield _lines(what, total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    far = () if total is None else (MofNCompleteColumn(),)
    columns = (TextColumn("{task.description}"), BarColumn(), *far, TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)

        def tick(done: str = "") -> None:
            bar.update(task, advance=1, description=done or what)

        yield tick
