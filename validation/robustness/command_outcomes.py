"""How a command may end: exit code, what it says, and the files it leaves."""

import csv
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mechsim import files as tables


@dataclass(frozen=True)
class Case:
    """What is typed, and the files that lie there."""

    words: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)


def unclear(code: int | None, output: str) -> Iterator[str]:
    if code not in (0, 1, 2):
        yield f"exit code {code}"
    if "Traceback" in output:
        yield f"a traceback on stderr: {output[-300:]!r}"
    # that code is run is said before it is
    lines = [
        line
        for line in output.splitlines()
        if line.strip() and not line.endswith("(a formula is Python code)")
    ]
    if code == 2 and (len(lines) != 1 or not lines[0].startswith("mechsim: ")):
        yield f"exit code 2 with {len(lines)} lines: {output[:300]!r}"


def untidy(place: Path, case: Case, code: int | None) -> Iterator[str]:
    """Yield what is wrong with the files left in a folder."""
    for path in place.rglob("*"):
        # the parts of a sweep that was stopped are there to go on with
        if path.name in case.files or any(part.endswith(".parts") for part in path.parts):
            continue
        # a report is a folder of files
        if not any(part in word for part in path.relative_to(place).parts for word in case.words):
            yield f"left {path.name}"
        elif code == 2:
            yield f"refused, but wrote {path.name}"
        elif (why := broken(path)) is not None:
            yield f"{path.name} is not whole: {why}"


def broken(path: Path) -> str | None:
    """Return why a file is not a whole one of its kind; None if it is."""
    try:
        if path.suffix.lower() == ".csv":
            text = path.read_text()
            widths = {len(row) for row in csv.reader(text.splitlines())}
            return None if len(widths) == 1 and text.endswith("\n") else "rows of several lengths"
        if path.suffix.lower() == ".npz":
            tables.read(path)
        elif path.suffix.lower() in (".xml", ".svg"):
            ET.parse(path)
        elif path.suffix.lower() == ".pdf" and not path.read_bytes().rstrip().endswith(b"%%EOF"):
            return "no end of file"
        elif path.suffix.lower() == ".png" and b"IEND" not in path.read_bytes()[-16:]:
            return "no end of image"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None
