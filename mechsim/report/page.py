"""The report: one HTML page with its pictures inside, and the same numbers as JSON in the same folder."""

import base64
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from mechsim._version import __version__
from mechsim.compare.checks import Check
from mechsim.errors import OutputError, needs
from mechsim.files import plain, write_content, write_json
from mechsim.mechanism.finding import counted_findings
from mechsim.pictures import view
from mechsim.pictures.number_text import number, quantity_text

TEMPLATES = Path(__file__).parent / "templates"
# with the head of every page
VIEW_TEMPLATES = Path(view.__file__).parent / "templates"
NUMBERS = "validate.json"
LIBRARIES = ("mujoco", "numpy", "scipy", "matplotlib", "mediapy")
# a check that uses less of its tolerance is listed in the long table only
UNUSED = 1e-3
# what a finding says without a place or a remedy
NO_FINDING: Mapping[str, Any] = {"severity": "note", "file": "", "line": None, "remedy": ""}
# outcomes of a case in words
OUTCOMES = {
    "passed": "all checks passed",
    "failed": "a check failed",
    "diverged": "diverged",
    "changed assembly": "changed assembly",
    "cannot assemble": "cannot be assembled",
}
# method of a check -> what is compared with what
METHODS = {
    "": ("Model", "the given formula or table"),
    "formula": ("Formula", "loop equations"),
    "pose": ("Loop equations", "MuJoCo, solved poses"),
    "step": ("Loop equations", "MuJoCo, time-stepped"),
    "as published": ("Loop equations", "MuJoCo, the file's own settings"),
}


@dataclass(frozen=True, kw_only=True)
class Section:
    """The section of one mechanism.

    Attributes:
        name: as in the results.
        title: heading.
        about: one-sentence description.
        cause: the most likely cause of a failure; empty without one.
        facts: name of a property -> value, or list of lines.
        picture: one pose, WebP or PNG; None if it could not be drawn.
        view: name of the interactive 3-D page in the same folder; empty for none.
        plots: (caption, WebP, PNG or SVG bytes).
        checks: of the verdict.
        settings: settings and cost of the run.
    """

    name: str
    title: str = ""
    about: str = ""
    cause: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)
    picture: bytes | None = None
    view: str = ""
    plots: Sequence[tuple[str, bytes]] = ()
    checks: Sequence[Check] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)


def write_report(
    directory: str | Path,
    results: Mapping[str, Any],
    sections: Sequence[Section],
    *,
    notes: Sequence[str] = (),
) -> Path:
    """Write `index.html` and `validate.json` into a directory and return the page's path.

    Args:
        directory: existing directory, or one with an existing parent.
        results: in the format of `mechsim validate --json`; extra keys stay in the JSON.
        sections: mechanisms of the page, in order.
        notes: sentences on failed parts of the report; shown at the top.

    Raises:
        OutputError: where a file cannot be written.
    """
    directory, results = Path(directory), plain(results)
    try:
        directory.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write a report to {directory}: {error.strerror or error}") from error
    about = about_this_run()
    page, path = render(results, sections, about, notes), directory / "index.html"
    write_json(directory / NUMBERS, {**results, "notes": list(notes), "about": about})
    write_content(path, page)
    return path


@cache
def environment() -> Any:
    """Return what fills the templates, with those already read."""
    with needs("pictures"):
        import jinja2

    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader([TEMPLATES, VIEW_TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters: dict[str, Any] = {text.__name__: text for text in (quantity, instant, value, percent, data_uri)}
    made.filters.update(filters)
    return made


def about_this_run() -> dict[str, Any]:
    """Return time, command, versions and computer."""
    name = Path(sys.argv[0]).name
    name = "mechsim" if name in ("__main__.py", "-c") else name
    return {
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": " ".join([name, *sys.argv[1:]]),
        "versions": versions(),
        "machine": computer(),
    }


def render(
    results: Mapping[str, Any],
    sections: Sequence[Section],
    about: Mapping[str, Any],
    notes: Sequence[str] = (),
) -> str:
    """Return the page as HTML text; mechanisms that failed come first."""
    shown = sorted((_shown(section, results) for section in sections), key=lambda case: case["passed"])
    stepless = {name for name, case in results["mechanisms"].items() if case.get("steps") == 0}
    template = environment().get_template("report.html")
    return template.render(
        passed=bool(results["passed"]),
        warnings=counted_findings(sum(case["warnings"] for case in shown)),
        outcomes=OUTCOMES,
        mechanisms=shown,
        check_count=sum(len(case["checks"]) for case in shown),
        failed_count=sum(len(case["checks"]) - case["checks_passed"] for case in shown),
        failures=[case for case in shown if not case["passed"]],
        methods=method_rows(shown),
        unstepped=[case["name"] for case in shown if case["name"] in stepless],
        notes=notes,
        about=about,
    )


def method_rows(cases: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per method: mechanisms, checks, and the largest error / tolerance."""
    rows: list[dict[str, Any]] = []
    used = dict.fromkeys(check.method for case in cases for check in case["checks"])
    for method in sorted(used, key=[*METHODS, *used].index):
        checks = [(case, check) for case in cases for check in case["checks"] if check.method == method]
        worst_case, worst = max(checks, key=lambda pair: pair[1].severity)
        compared, against = METHODS.get(method, (method, "the analytic solution"))
        rows.append(
            {
                "compared": compared,
                "against": against,
                "mechanisms": len({case["name"] for case, _ in checks}),
                "checks": len(checks),
                "failed": sum(not check.passed for _, check in checks),
                "worst": worst.fraction_of_tolerance,
                "name": worst_case["name"],
            }
        )
    return rows


def versions() -> dict[str, str]:
    """Return the versions of mechsim, Python and the libraries that affect results."""
    installed = {"mechsim": __version__, "python": platform.python_version()}
    for library in LIBRARIES:
        with suppress(metadata.PackageNotFoundError):
            installed[library] = metadata.version(library)
    return installed


def computer() -> dict[str, str]:
    """Return a description of the computer."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "system": platform.platform(terse=True),
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": str(os.cpu_count() or "unknown"),
    }


def instant(check: Check) -> str:
    """Return the instant of the largest error of a check: a crank angle, or a time under motion laws."""
    if check.at_unit == "rad":
        return f"{math.degrees(check.instant):.1f}°" if math.isfinite(check.instant) else ""
    return f"row {check.instant:g}" if check.at_unit == "row" else f"{check.instant:.4g} s"


def value(x: Any) -> list[str]:
    """Return a property or setting as lines of text."""
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


def quantity(value: float | None, unit: str) -> str:
    """Return a quantity as in the terminal: 1.05 mm; very small ones with a power of ten."""
    if value is None or not math.isfinite(value):
        return "not a number"
    unit = unit.replace("s2", "s²")
    return quantity_text(value, unit) if value >= 1e-9 else f"{number(value)} {unit}"


def percent(fraction: float | None) -> str:
    """Return error / tolerance as a percentage."""
    if fraction is None:
        return "none"
    if fraction >= 10.0:
        return f"{number(float(f'{fraction:.2g}'))} times"
    return "<0.1 %" if 0.0 < fraction < 1e-3 else f"{100.0 * fraction:.1f} %"


def data_uri(data: bytes) -> str:
    """Return a picture, PNG, WebP or SVG, as a data URI."""
    kind = "png" if data[:4] == b"\x89PNG" else "webp" if data[8:12] == b"WEBP" else "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _shown(section: Section, results: Mapping[str, Any]) -> dict[str, Any]:
    result = results["mechanisms"].get(section.name, {})
    seconds = result.get("seconds")
    costs = {"steps": result.get("steps"), "whole case": None if seconds is None else f"{seconds:.3g} s"}
    findings = [NO_FINDING | finding for finding in result.get("findings") or ()]
    cause = section.cause or next((finding["message"] for finding in findings), "")
    passed = bool(result.get("passed", False))
    warnings = sum(finding["severity"] != "note" for finding in findings) if passed else 0
    return {
        "section": section,
        "name": section.name,
        "title": section.title or section.name,
        "passed": passed,
        "warnings": warnings,
        "outcome": result.get("outcome", "failed") + counted_findings(warnings),
        "findings": findings,
        "reason": result.get("reason", ""),
        # the reason of a failure of the file's own settings contains the finding
        "cause": "" if cause in result.get("reason", "") else cause,
        "checks": section.checks,
        "methods": [METHODS.get(m, (m, m))[1] for m in dict.fromkeys(c.method for c in section.checks)],
        "rows": list(enumerate(section.checks)),
        "tightest": tightest(section.checks),
        "checks_passed": sum(check.passed for check in section.checks),
        "worst": max(section.checks, key=lambda check: check.severity, default=None),
        "seconds": seconds,
        "settings": {**section.settings, **{k: v for k, v in costs.items() if v is not None}},
    }


def tightest(checks: Sequence[Check]) -> list[tuple[int, Check]]:
    """Return the check with the largest error / tolerance of each kind, and all failed ones, with their rows.

    Checks that use less than `UNUSED` of their tolerance are left out, unless nothing else is there.
    """
    worst: dict[tuple[str, ...], tuple[int, Check]] = {}
    for row, check in enumerate(checks):
        kind = (check.variant, check.method, check.kind)
        if not check.passed:
            worst[*kind, check.subject] = row, check
        elif kind not in worst or check.severity > worst[kind][1].severity:
            worst[kind] = row, check
    selected = list(worst.values())
    return [pair for pair in selected if not pair[1].passed or pair[1].severity >= UNUSED] or selected
