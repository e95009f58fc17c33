"""The report: one page that needs nothing but itself, and the same numbers as JSON beside it."""

import base64
import json
import math
import os
import platform
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from mechsim._version import __version__
from mechsim.errors import OutputError, needs
from mechsim.files import write_json, written_beside
from mechsim.pictures.number_text import number
from mechsim.verdict.checks import Check

TEMPLATES = Path(__file__).parent / "templates"
LIBRARIES = ("mujoco", "numpy", "scipy", "matplotlib", "mediapy")
KINDS = {
    ".mp4": "video/mp4",
    ".webm": "video/webm",
    ".gif": "image/gif",
}
# a check that uses less of its bound stands only in the long table
UNUSED = 1e-3
# points across; wider plots have several columns
WIDE = 450.0
# what a reader should know of each outcome, in a word or two
OUTCOMES = {
    "passed": "all checks passed",
    "failed": "a check failed",
    "diverged": "diverged",
    "changed assembly": "changed assembly",
    "cannot assemble": "cannot be assembled",
}


@dataclass(frozen=True, kw_only=True)
class Section:
    """What the page shows of one mechanism.

    Attributes:
        name: as in the results.
        title: heading.
        facts: what is known without a run: name of the fact -> value, or list of lines.
        still: PNG of one position.
        video: file to embed (mp4, webm or gif).
        turned: name of the page beside in which it is turned by hand; empty for none.
        plots: (caption, SVG or PNG bytes).
        checks: of the verdict.
        settings: how the run was made and what it cost.
    """

    name: str
    title: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    still: bytes | None = None
    video: Path | None = None
    turned: str = ""
    plots: Sequence[tuple[str, bytes]] = ()
    checks: Sequence[Check] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


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


def write_report(
    directory: str | Path,
    results: Mapping[str, Any],
    sections: Sequence[Section],
    *,
    command: str | None = None,
    notes: Sequence[str] = (),
    studies: Sequence[StudyPart] = (),
) -> Path:
    """Write `index.html` and `validate.json` into a directory and return the page's path.

    Args:
        directory: exists, or its parent does.
        results: as `mechsim validate --json` prints them; extra keys are kept in the JSON.
        sections: what to show of each mechanism, in this order.
        command: that makes this report again; None takes that of this process.
        notes: what could not be done, one sentence each; they stand at the top.
        studies: extremes and trades, after the mechanisms.

    Raises:
        OutputError: where a file cannot be written.
    """
    directory = Path(directory)
    try:
        directory.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write a report to {directory}: {error.strerror or error}") from error
    about = {
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command or _this_command(),
        "versions": versions(),
        "machine": machine(),
    }
    page = render(results, sections, about, notes, studies)
    write_json(directory / "validate.json", {**results, "notes": list(notes), "about": about})
    with written_beside(directory / "index.html") as beside:
        beside.write_text(page, encoding="utf-8")
    return directory / "index.html"


def render(
    results: Mapping[str, Any],
    sections: Sequence[Section],
    about: Mapping[str, Any],
    notes: Sequence[str] = (),
    studies: Sequence[StudyPart] = (),
) -> str:
    """Return the page as HTML text."""
    with needs("pictures"):
        import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {"number": number, "degrees": degrees, "instant": instant, "value": value}
    filters |= {"picture": picture, "film": film, "wide": wide}
    environment.filters.update(filters)
    shown = [_shown(section, results) for section in sections]
    return environment.get_template("report.html").render(
        passed=bool(results["passed"]),
        outcomes=OUTCOMES,
        mechanisms=shown,
        count_passed=sum(one["passed"] for one in shown),
        failures=[one for one in shown if not one["passed"]],
        notes=notes,
        studies=studies,
        about=about,
        film_is_picture=lambda path: Path(path).suffix == ".gif",
    )


def versions() -> dict[str, str]:
    """Return the versions of mechsim, Python and the libraries that results depend on."""
    found = {"mechsim": __version__, "python": platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, str]:
    """Return what the numbers were made on."""
    return {
        "system": platform.platform(terse=True),
        "processor": _processor(),
        "cores": str(os.cpu_count() or "unknown"),
    }


def degrees(x: Any) -> str:
    """Return an angle in [rad] as degrees."""
    return "" if x is None or not math.isfinite(x) else f"{math.degrees(x):.1f}°"


def instant(check: Check) -> str:
    """Return where the error of a check is worst: a crank angle, or a time under motion laws."""
    if check.at_unit == "rad":
        return degrees(check.at)
    return f"row {check.at:g}" if check.at_unit == "row" else f"{check.at:.4g} s"


def value(x: Any) -> list[str]:
    """Return a fact or setting as the lines that show it."""
    if isinstance(x, bool):
        return ["yes" if x else "no"]
    if isinstance(x, int | float) or hasattr(x, "item"):
        return [number(float(x))]
    if isinstance(x, Mapping):
        return [f"{key}: {', '.join(value(item))}" for key, item in x.items()]
    if isinstance(x, list | tuple):
        nested = any(isinstance(item, Mapping | list | tuple) for item in x)
        short = [", ".join(value(item)) for item in x]
        return short if nested or sum(map(len, short)) > 60 else [", ".join(short)]
    return [str(x)]


def picture(data: bytes) -> str:
    """Return a picture as a data URI."""
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        return _uri("image/png", data)
    return _uri("image/svg+xml", data)


def wide(data: bytes) -> bool:
    """Return whether a plot is too wide to be read on a telephone; its page then lets it be pushed along."""
    found = re.search(rb'<svg[^>]* width="([0-9.]+)pt"', data[:2000])
    return found is not None and float(found[1]) > WIDE


def film(path: Path) -> str:
    """Return a video file as a data URI.

    Raises:
        OutputError: where it cannot be read.
    """
    try:
        return _uri(KINDS[Path(path).suffix], Path(path).read_bytes())
    except (OSError, KeyError) as error:
        raise OutputError(f"cannot put the video {path} into the report: {error}") from error


def _shown(section: Section, results: Mapping[str, Any]) -> dict[str, Any]:
    result = results["mechanisms"].get(section.name, {})
    seconds = result.get("seconds")
    costs = {"steps": result.get("steps"), "whole case": None if seconds is None else f"{seconds:.3g} s"}
    used = [check for check in section.checks if check.fraction_of_tolerance is not None]
    return {
        "section": section,
        "name": section.name,
        "title": section.title or section.name,
        "passed": bool(result.get("passed", False)),
        "outcome": result.get("outcome", "failed"),
        "reason": result.get("reason", ""),
        "checks": section.checks,
        "tightest": _tightest(section.checks),
        "checks_passed": sum(check.passed for check in section.checks),
        "nearest": max(used, key=_share) if used else None,
        "seconds": seconds,
        "settings": {**section.settings, **{k: v for k, v in costs.items() if v is not None}},
    }


def _tightest(checks: Sequence[Check]) -> list[Check]:
    """Of each kind of quantity the check that comes nearest to its bound, and all that failed.

    What uses less than `UNUSED` of its bound is left out, unless nothing else is there.
    """
    found: dict[tuple[str, ...], Check] = {}
    for check in checks:
        kind = (check.variant, check.method, check.kind)
        best = found.get(kind)
        if not check.passed:
            found[*kind, check.subject] = check
        elif best is None or _share(check) > _share(best):
            found[kind] = check
    kept = list(found.values())
    return [check for check in kept if not check.passed or _share(check) >= UNUSED] or kept


def _share(check: Check) -> float:
    return check.fraction_of_tolerance or 0.0


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _this_command() -> str:
    name = Path(sys.argv[0]).name
    return " ".join(["mechsim" if name in ("__main__.py", "mechsim", "-c") else name, *sys.argv[1:]])


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


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
