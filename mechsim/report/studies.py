"""Studies that lie in a report's folder from runs before: extremes and trades, as parts of its page."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mechsim.errors import OutputError


@dataclass(frozen=True, kw_only=True)
class StudyPart:
    """What the page shows of a study.

    Attributes:
        name: anchor on the page.
        title: heading.
        about: what was done, and by which command.
        plots: (caption, SVG bytes).
        head: of a table.
        rows: of that table.
    """

    name: str
    title: str
    about: str
    plots: tuple[tuple[str, bytes], ...]
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def studies_in(folder: Path) -> list[StudyPart]:
    """Return the studies that `mechsim extremes --report` and `mechsim tradeoff --plot` left in a folder.

    Raises:
        OutputError: where a file is there but cannot be read as what it should be.
    """
    try:
        return [*_extremes(folder), *_trades(folder)]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(
            f"a study in {folder} cannot be read ({error}); run it again or remove extremes.* and tradeoff_*"
        ) from error


def _extremes(folder: Path) -> list[StudyPart]:
    drawing, numbers = folder / "extremes.svg", folder / "extremes.json"
    if not (drawing.is_file() and numbers.is_file()):
        return []
    found: Mapping[str, Any] = json.loads(numbers.read_text(encoding="utf-8"))
    good = sum(bool(trial["passed"]) for trial in found["trials"])
    about = (
        f"{good} of {len(found['trials'])} runs, pushed until something breaks, ended as the closed form "
        "says they must. Made before by mechsim extremes; its borders are below."
    )
    rows = [
        (
            str(border["axis"]),
            str(border["mechanism"]),
            f"{border['inside']:.2g}: {border['before']}",
            f"{border['outside']:.2g}: {border['after']}",
        )
        for border in found["borders"]
    ]
    part = StudyPart(
        name="extremes",
        title="Extremes",
        about=about,
        plots=(("error along every axis, and how each run ended", drawing.read_bytes()),),
        head=("Axis", "Mechanism", "Up to", "From"),
        rows=tuple(rows),
    )
    return [part]


def _trades(folder: Path) -> list[StudyPart]:
    drawings = sorted(folder.glob("tradeoff_*.svg"))
    if not drawings:
        return []
    part = StudyPart(
        name="tradeoff",
        title="Speed against accuracy",
        about="Error over cost of every way of stepping, measured before by mechsim tradeoff.",
        plots=tuple((path.stem.removeprefix("tradeoff_"), path.read_bytes()) for path in drawings),
    )
    return [part]
