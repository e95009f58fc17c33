"""What commands print: one JSON object, or tables for people; progress on stderr."""

import json
import sys
import textwrap
import time
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from typing import Any, Protocol

import typer

from mechsim.cli.endings import tell
from mechsim.cli.terminal import in_bold, width, wrapped
from mechsim.cli.time_left import TimeLeft, in_words
from mechsim.files import plain

# before the first line of progress where there is no terminal, and between two
FIRST, SECONDS = 3.0, 10.0
# before each column of a table
GAP = "  "


def print_json(value: Any) -> None:
    """Print one JSON object; numbers that JSON does not have become null."""
    typer.echo(json.dumps(plain(value), indent=2, allow_nan=False))


def print_table(title: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a title, and rows in columns that fit the terminal; only the title where there are no rows."""
    for line in wrapped(title, "", "  "):
        typer.echo(in_bold(line))
    cells = [[" ".join(cell.split()) for cell in row] for row in rows]
    if not cells:
        return
    columns = [[name, *(row[i] for row in cells)] for i, name in enumerate(head)]
    widths = _column_widths(columns, width() - len(GAP) * len(columns))
    right = [all(_is_number(cell) for cell in column[1:] if cell) for column in columns]
    for i in range(len(cells) + 1):
        lines = [_in_lines(column[i], w) for column, w in zip(columns, widths, strict=True)]
        for parts in zip_longest(*lines, fillvalue=""):
            aligned = (
                f"{part:>{w}}" if r else f"{part:<{w}}"
                for part, w, r in zip(parts, widths, right, strict=True)
            )
            line = (GAP + GAP.join(aligned)).rstrip()
            typer.echo(line if i else in_bold(line))


def _column_widths(columns: Sequence[Sequence[str]], room: int) -> list[int]:
    """Return widths of columns with so much room for all: the widest are narrowed, no word is cut."""
    widths = [max(map(len, column)) for column in columns]
    least = [max((len(word) for cell in column for word in cell.split()), default=0) for column in columns]
    while sum(widths) > room:
        wide = [i for i in range(len(widths)) if widths[i] > least[i]]
        if not wide:
            break
        widths[max(wide, key=lambda i: widths[i])] -= 1
    return widths


def _in_lines(cell: str, columns: int) -> list[str]:
    return textwrap.wrap(cell, max(columns, 1), break_long_words=False, break_on_hyphens=False)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


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
