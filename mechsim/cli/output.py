"""What commands print: one JSON object, or tables for people; progress on stderr."""

import json
import os
import sys
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import typer

from mechsim.cli.endings import tell
from mechsim.cli.time_left import TimeLeft, in_words
from mechsim.files import plain

# before the first line of progress where there is no terminal, and between two
FIRST, SECONDS = 3.0, 10.0


def print_json(value: Any) -> None:
    """Print one JSON object; numbers that JSON does not have become null."""
    typer.echo(json.dumps(plain(value), indent=2, allow_nan=False))


def print_table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table that fits the terminal, or plain wide text where there is none."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    told = sys.stdout.isatty() or "COLUMNS" in os.environ
    console = Console(width=None if told else 160)
    # names may hold what the library would take for its own markup
    table = Table(title=Text(title), title_justify="left", header_style="bold")
    for name in head:
        table.add_column(Text(name), overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    console.print(table)


class Tick(Protocol):
    """Called after each piece of work, with what was done and what part of the whole that makes."""

    def __call__(self, done: str = "", part: float | None = None, /) -> None:
        """Advance to a part of the whole, 0 to 1; by one of the total where none is told."""
        ...


def _nothing(done: str = "", part: float | None = None) -> None:
    pass


def _lines(what: str, total: int | None, limit: str) -> Tick:
    """Return a tick that prints a line when the last one is long past."""
    count, begun = 0, time.monotonic()
    due, quiet = begun + FIRST, True
    counted, told = TimeLeft(begun), TimeLeft()

    def tick(done: str = "", part: float | None = None) -> None:
        nonlocal count, due, quiet
        count += 1
        now = time.monotonic()
        far = [f"{count} of {total}"] if part is None and total else []
        if part is not None:
            rest = in_words(told.update(part, now))
        else:
            rest = in_words(counted.update(count / total, now)) if total else ""
        if now < due:
            return
        rest = f"{rest}{limit}" if rest else ""
        # what is over in a moment needs no line
        if rest or not quiet or now > begun + SECONDS:
            tell(f"{what}: {', '.join(filter(None, [*far, done, rest]))}")
            due, quiet = now + SECONDS, False

    return tick


@contextmanager
def progress(what: str, total: int | None, *, quiet: bool = False, at_least: bool = False) -> Generator[Tick]:
    """Show on stderr how far long work has come: a bar, or a line now and then where there is no terminal.

    `at_least`: the parts told are the least that may be done, so that what is left is so much at the most.
    """
    if quiet:
        yield _nothing
        return
    if not sys.stderr.isatty():
        yield _lines(what, total, " at the most" if at_least else "")
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    far = () if total is None else (MofNCompleteColumn(),)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *far,
        TimeElapsedColumn(),
        TextColumn("{task.fields[rest]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total, rest="")
        count, counted, told = 0, TimeLeft(time.monotonic()), TimeLeft()

        def tick(done: str = "", part: float | None = None) -> None:
            nonlocal count
            count += 1
            now = time.monotonic()
            if part is None:
                rest = counted.update(count / total, now) if total else None
                bar.update(task, advance=1, description=done or what, rest=in_words(rest))
            else:
                rest = None if at_least else told.update(part, now)
                bar.update(task, total=1.0, completed=part, description=done or what, rest=in_words(rest))

        yield tick
