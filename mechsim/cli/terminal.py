"""What the terminal shows: its width, colours where there is one, and lines that fit."""

import os
import shutil
import sys
import textwrap

import typer

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
