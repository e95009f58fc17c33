"""Output of commands: one JSON object, or text and tables that fit the terminal."""

import json
import os
import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim import units
from mechsim.errors import InputError, several
from mechsim.files import plain

if TYPE_CHECKING:
    from mechsim.kinematics.solvers import KinematicSolver

Units = Annotated[
    str | None,
    typer.Option(
        metavar="UNITS",
        help="Units of lengths and angles in tables, and columns labelled with them: mm, deg, mm,deg, SI, or "
        "file for those that the file declares. JSON is in SI.",
    ),
]


@dataclass(frozen=True, slots=True)
class OutputUnits:
    """Units of lengths and angles in tables; all other quantities are in SI.

    Attributes:
        length: unit of lengths, as text.
        angle: unit of angles, as text.
    """

    length: str
    angle: str

    def converted(self, unit: str) -> tuple[float, str]:
        """Return the divisor of values in an SI unit, and the resulting unit."""
        unit = unit.replace("s2", "s^2").replace("m2", "m^2")
        base, slash, rest = unit.partition("/")
        own = {"m": self.length, "rad": self.angle}.get(base)
        # a quantity per length, such as a stiffness or an inertia, is not a length
        if own is None or rest not in ("", "s", "s^2"):
            return 1.0, unit
        return units.in_si(1.0, own, "m" if base == "m" else "rad"), own + slash + rest

    def label(self, name: str, unit: str) -> str:
        """Return the heading of a column of quantities in an SI unit."""
        return f"{name} [{self.converted(unit)[1] or '1'}]"


SI_UNITS = OutputUnits("m", "rad")
# units of tables that are printed for reading
DEGREES = OutputUnits("m", "deg")
# last line of a command of dynamics without -o
DRAWN = "-o FILE.svg draws it"


def output_units(text: str | None, solver: "KinematicSolver") -> OutputUnits | None:
    """Return the units of `--units`; None without it.

    Raises:
        InputError: if the text is none of the known words and no units of length and angle.
    """
    if text is None:
        return None
    declared = solver.written
    if text == "file":
        return OutputUnits(declared.length, declared.angle)
    units_of = {"m": "m", "rad": "rad"}
    for item in [] if text.lower() == "si" else map(str.strip, text.split(",")):
        kind = next((unit for unit in units_of if _measures(item, unit)), None)
        if kind is None:
            raise InputError(
                f"--units {text!r} names {item!r}, which measures no length and no angle; give mm, "
                "deg, both as mm,deg, SI, or file"
            )
        units_of[kind] = item
    return OutputUnits(units_of["m"], units_of["rad"])


def _measures(written: str, unit: str) -> bool:
    try:
        return bool(written) and units.in_si(1.0, written, "m" if unit == "m" else "rad") > 0.0
    except InputError:
        return False


# text width without a terminal and without COLUMNS, and the minimum text width
DEFAULT_WIDTH, MINIMUM_WIDTH = 80, 40
# space before each column of a table
GAP = "  "
# significant digits of a number in text
DIGITS = 4
# a value below this fraction of the largest in its column is rounding noise
NOISE = 1e-12

Value = str | float | bool | None


def width() -> int:
    """Return the width of the terminal, or the value of COLUMNS."""
    return max(MINIMUM_WIDTH, shutil.get_terminal_size((DEFAULT_WIDTH, 24)).columns)


def in_colour(text: str, colour: str | None = None) -> str:
    """Return text in bold, and in a colour, if stdout is a terminal and NO_COLOR is not set."""
    coloured = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    return typer.style(text, fg=colour, bold=True) if coloured else text


def pass_or_fail(passed: bool, findings: int = 0) -> str:
    """Return the word PASS or FAIL, green or red in a terminal, or "PASS, n findings", yellow."""
    if not passed:
        return in_colour("FAIL", "red")
    remark = f", {several(findings, 'finding')}" if findings else ""
    return in_colour(f"PASS{remark}", "yellow" if findings else "green")


def wrapped(text: str, indent: str = "  ", hanging: str = "    ") -> list[str]:
    """Return text in lines that fit the terminal; words are not split."""
    return textwrap.wrap(
        text,
        width(),
        initial_indent=indent,
        subsequent_indent=hanging,
        break_on_hyphens=False,
        break_long_words=False,
    )


def labelled(label: str, text: str, label_width: int) -> list[str]:
    """Return a label and its text; further lines are aligned with the first."""
    return wrapped(text, f"  {label:<{label_width}}  ", " " * (label_width + 4))


def print_text(text: str) -> None:
    """Print a text in lines that fit the terminal."""
    for line in wrapped(text, "", "  "):
        typer.echo(line)


def print_json(value: Any) -> None:
    """Print one JSON object; numbers that JSON does not have become null."""
    typer.echo(json.dumps(plain(value), indent=2, allow_nan=False))


def number(value: float, digits: int = DIGITS) -> str:
    """Return a number with a number of significant digits, as text."""
    return f"{value + 0.0:.{digits}g}"


def without_noise(values: Sequence[float]) -> list[float]:
    """Return the values, with those below `NOISE` times the largest replaced by 0."""
    scale = max(map(abs, values), default=0.0)
    return [0.0 if abs(value) < NOISE * scale else value for value in values]


def print_table(title: str, head: Sequence[str], rows: Iterable[Sequence[Value]]) -> None:
    """Print a title, and rows in columns that fit the terminal; print nothing without rows.

    Args:
        title: printed in bold in a terminal, like the head; empty for none.
        head: heading of each column.
        rows: values: text, a number, None for an empty cell, True for PASS and False for FAIL.
    """
    texts = [[_text(value) for value in row] for row in rows]
    if not texts:
        return
    for line in wrapped(title, "", "  "):
        typer.echo(in_colour(line))
    columns = [[name, *(row[i] for row in texts)] for i, name in enumerate(head)]
    widths = _column_widths(columns, width() - len(GAP) * len(columns))
    right = [all(plain_number(text) is not None for text in column[1:] if text) for column in columns]
    pads = [str.rjust if r else str.ljust for r in right]
    for i in range(len(texts) + 1):
        lines = [
            [column[i]]
            if len(column[i]) <= w
            else textwrap.wrap(column[i], max(w, 1), break_long_words=False, break_on_hyphens=False)
            for column, w in zip(columns, widths, strict=True)
        ]
        for line_texts in zip_longest(*lines, fillvalue=""):
            aligned = (pad(text, w) for pad, text, w in zip(pads, line_texts, widths, strict=True))
            line = (GAP + GAP.join(aligned)).rstrip()
            for word, passed in (("PASS", True), ("FAIL", False)):
                line = line.replace(word, pass_or_fail(passed)) if i else line
            typer.echo(line if i else in_colour(line))


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return "PASS" if value else "FAIL"
    if isinstance(value, float):
        return number(value)
    return "" if value is None else " ".join(str(value).split())


def _column_widths(columns: Sequence[Sequence[str]], available: int) -> list[int]:
    """Return column widths whose sum is at most `available`: the widest are narrowed, no word is split."""
    widths = [max(map(len, column)) for column in columns]
    least = [max((len(word) for text in column for word in text.split()), default=0) for column in columns]
    while sum(widths) > available and (wide := [i for i, w in enumerate(widths) if w > least[i]]):
        widths[max(wide, key=widths.__getitem__)] -= 1
    return widths


def plain_number(text: str) -> float | None:
    """Return a number without a unit; None for anything else."""
    try:
        return float(text)
    except ValueError:
        return None
