"""What commands print: one JSON object, or tables for people; progress on stderr."""

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import Any

import typer

from mechsim.files import plain

# columns where stdout is no terminal and COLUMNS is not set
DEFAULT_WIDTH = 80
# narrower terminals are taken for this many columns
MINIMUM_WIDTH = 40


def width() -> int:
    """Return the columns of the terminal, or of COLUMNS."""
    return max(MINIMUM_WIDTH, shutil.get_terminal_size((DEFAULT_WIDTH, 24)).columns)


def in_colour(text: str, colour: str) -> str:
    """Return text in bold colour where stdout is a terminal and NO_COLOR is not set."""
    return typer.style(text, fg=colour, bold=True) if _has_colour() else text


def in_bold(text: str) -> str:
    """Return text in bold where stdout is a terminal and NO_COLOR is not set."""
    return typer.style(text, bold=True) if _has_colour() else text


def _has_colour() -> bool:
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")


def pass_or_fail(passed: bool) -> str:
    """Return the word PASS or FAIL, green or red in a terminal."""
    return in_colour("PASS", "green") if passed else in_colour("FAIL", "red")


def wrapped(text: str, indent: str = "  ", hanging: str = "    ") -> list[str]:
    """Return text in lines that fit the terminal; words are never cut."""
    return textwrap.wrap(
        text,
        width(),
        initial_indent=indent,
        subsequent_indent=hanging,
        break_on_hyphens=False,
        break_long_words=False,
    )


def labelled(label: str, text: str, label_width: int) -> list[str]:
    """Return a label and its text, whose further lines start below the first."""
    return wrapped(text, f"  {label:<{label_width}}  ", " " * (label_width + 4))


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
