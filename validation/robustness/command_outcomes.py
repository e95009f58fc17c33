"""How a command may end: exit code, output, and files."""

import csv
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mechsim.cli import COMMANDS

PROGRESS = tuple(f"{word}: " for command in COMMANDS for word in command.split())


@dataclass(frozen=True)
class Case:
    """A command line and the files in its folder."""

    words: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)


def output_faults(code: int | None, output: str) -> Iterator[str]:
    """Yield what is wrong with an exit code and the output on stderr."""
    if code not in (0, 1, 2):
        yield f"exit code {code}"
    if "Traceback" in output:
        yield f"a traceback on stderr: {output[-300:]!r}"
    # a note precedes the execution of Python code, and lines of progress begin with the command
    lines = [line for line in output.splitlines() if line.strip() and not line.startswith(PROGRESS)]
    lines = [line for line in lines if not line.endswith("(a formula is Python code)")]
    if code == 2 and (len(lines) != 1 or not lines[0].startswith("mechsim: ")):
        yield f"exit code 2 with {len(lines)} lines: {output[:300]!r}"


def file_faults(folder: Path, case: Case, code: int | None) -> Iterator[str]:
    """Yield what is wrong with the files left in a folder."""
    for path in folder.rglob("*"):
        if path.name in case.files:
            continue
        # a report is a folder
        if not any(component in word for component in path.relative_to(folder).parts for word in case.words):
            yield f"left {path.name}"
        elif code == 2:
            yield f"rejected, but wrote {path.name}"
        elif (defect := file_defect(path)) is not None:
            yield f"{path.name} is incomplete: {defect}"


def file_defect(path: Path) -> str | None:
    """Return why a file is incomplete or invalid; None if it is valid."""
    try:
        if path.suffix.lower() == ".csv":
            text = path.read_text()
            widths = {len(row) for row in csv.reader(text.splitlines())}
            return None if len(widths) == 1 and text.endswith("\n") else "rows of different lengths"
        if path.suffix.lower() == ".npz":
            with np.load(path) as arrays:
                dict(arrays)
        elif path.suffix.lower() in (".xml", ".svg"):
            ET.parse(path)
        elif path.suffix.lower() == ".pdf" and not path.read_bytes().rstrip().endswith(b"%%EOF"):
            return "no end of file"
        elif path.suffix.lower() == ".png" and b"IEND" not in path.read_bytes()[-16:]:
            return "no end of image"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None
