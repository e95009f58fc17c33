"""Make the reference data: `python reference/make.py [NAME ...]`, or `forward/NAME` for a released motion.

Reads mechanisms/NAME.toml and motions.toml, writes data/NAME.csv; reads forward/NAME.toml and runs.toml,
writes forward/NAME.csv; and, where all are made, datapackage.json and checksums. Needs numpy and mpmath, and
nothing of mechsim. Everything is computed with 60 digits and again with 75, released motion with 36 and 42;
the second is written. A difference in the last digit written is an error.
"""

import csv
import hashlib
import json
import sys
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
from mpmath import mp, mpf

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER))  # run as a script or loaded as a file

from exact.description import Description, Reader, read  # noqa: E402
from exact.loops import State  # noqa: E402
from exact.motion import motion, read_release  # noqa: E402
from exact.solving import Instant, followed, in_doubles, instant  # noqa: E402

DIGITS = 30
PRECISIONS = (60, 75)
ROWS = 72
# of released motion; the order of the series is 1.15 for each digit, so a step is a seventh of the radius
FORWARD_DIGITS = 25
FORWARD_PRECISIONS = (36, 42)
# below this part of a column's largest value a number is zero by construction
ZERO = mpf(10) ** -38
AXES = "xyz"
RATES = ("", "v", "a")


def names() -> list[str]:
    """Return the mechanisms."""
    return sorted(path.stem for path in (FOLDER / "mechanisms").glob("*.toml"))


def motions() -> dict[str, Any]:
    """Return the motions of the drivers."""
    return tomllib.loads((FOLDER / "motions.toml").read_text(encoding="utf-8"))


def runs() -> dict[str, Any]:
    """Return the released motions: name -> duration, rows, restitution."""
    return tomllib.loads((FOLDER / "runs.toml").read_text(encoding="utf-8"))


def written(number: Any, digits: int = DIGITS) -> str:
    """Return a number as it is written: `DIGITS` digits."""
    return "0" if number == 0 else mp.nstr(number, digits, min_fixed=1, max_fixed=0, strip_zeros=False)


def released(name: str, digits: int) -> tuple[list[tuple[str, dict[str, Any]]], list[Any]]:
    """Return a released motion's rows, their time and numbers by column, and the times of impacts in [s].

    Args:
        name: of the motion.
        digits: to work with.
    """
    mp.dps = digits
    stated, path = runs()[name], FOLDER / "forward" / f"{name}.toml"
    described = read(path)
    release = read_release(Reader(path), described, mpf(stated.get("restitution", "0")))
    rows = stated["rows"]
    first_column = [written(mpf(stated["duration"]) * k / rows, FORWARD_DIGITS) for k in range(rows + 1)]
    times, impacts = [mpf(first) for first in first_column], list[Any]()
    motion_rows = motion(described, release, times, round(1.15 * digits), impacts)
    return list(zip(first_column, motion_rows, strict=True)), impacts


def write_released(name: str) -> None:
    """Write forward/NAME.csv, with impacts NAME.impacts.json; ArithmeticError if precisions differ."""
    (coarse, _), (fine, impacts) = (released(name, digits) for digits in FORWARD_PRECISIONS)
    keys = list(fine[0][1])
    largest = {key: max(abs(row[key]) for _, row in fine) for key in keys}
    lines = [["t", *keys]]
    for (first, row), (_, other) in zip(fine, coarse, strict=True):
        line = [first]
        for key in keys:
            unit = max(largest[key], mpf("1e-3")) * mpf(10) ** -FORWARD_DIGITS
            if abs(row[key] - other[key]) > unit / 2:
                raise ArithmeticError(f"{name}: {key} is {written(row[key])} and {written(other[key])}")
            line.append("0" if abs(row[key]) < unit else written(row[key], FORWARD_DIGITS))
        lines.append(line)
    with (FOLDER / "forward" / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    if impacts:
        stated = json.dumps([written(time, FORWARD_DIGITS) for time in impacts], indent=1)
        (FOLDER / "forward" / f"{name}.impacts.json").write_text(stated + "\n", encoding="utf-8")


def instants(described: Description) -> list[tuple[str, dict[str, tuple[Any, Any, Any]]]]:
    """Return the first first of every row, and value, rate and acceleration of the drivers there.

    The first first, an angle in [rad] or a time in [s], is exact: all else is computed from it.
    """
    stated = motions()
    if described.name in stated["by_program"]:
        first_column = [written(mpf(k) / ROWS) for k in range(ROWS)]
        return [
            (first, {name: _states(go, mpf(first)) for name, go in described.motion_laws.items()})
            for first in first_column
        ]
    arc = stated["arcs"].get(described.name, stated["turn"])
    speed = mpf(stated["speeds"].get(described.name, stated["speed"]))
    first_column = [written((mpf(arc["first"]) + k * mpf(arc["step"])) * mp.pi / 180) for k in range(ROWS)]
    crank = described.drivers[0]
    return [(first, {crank: (mpf(first), speed, mpf(0))}) for first in first_column]


def _states(go: Any, t: Any) -> tuple[Any, Any, Any]:
    value, rate, half = mp.taylor(go, t, 2)
    return value, rate, 2 * half


@cache
def roughly_stood(name: str) -> list[tuple[State, dict[str, float]]]:
    """Return the state of a mechanism at all rows, in doubles, and its coordinates there."""
    described = read(FOLDER / "mechanisms" / f"{name}.toml")
    path = [
        {item: float(prescribed[0]) for item, prescribed in motion.items()}
        for _, motion in instants(described)
    ]
    return followed(in_doubles(described), path)


def solved(name: str, digits: int, only: Sequence[int] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Return a mechanism's rows: their first first, and numbers by column.

    Args:
        name: of the mechanism.
        digits: to work with.
        only: numbers of the rows; empty for all.
    """
    mp.dps = digits
    described = read(FOLDER / "mechanisms" / f"{name}.toml")
    requested = instants(described)
    stood = roughly_stood(name)
    for k in only or range(len(requested)):
        first, motion = requested[k]
        yield first, columns(described, motion, instant(described, *stood[k], motion))


def columns(described: Description, motion: dict[str, Any], equations: Instant) -> dict[str, Any]:
    """Return a row's numbers by column."""
    row: dict[str, Any] = {}
    if described.motion_laws:
        for name, states in motion.items():
            row |= {f"{name}.{'qva'[i]}": item for i, item in enumerate(states)}
    for name, states in equations.points.items():
        row |= {
            f"{name}.{rate}{axis}": item
            for rate, state in zip(RATES, states, strict=True)
            for axis, item in zip(AXES, state, strict=True)
        }
    slides = {pair.name for pair in described.pairs if pair.kind == "prismatic"}
    for name, effort in equations.drive_forces.items():
        row[f"{'force' if name in slides else 'torque'}:{name}"] = effort
    return row


def table(name: str) -> tuple[list[str], list[list[str]]]:
    """Return a mechanism's table as text; ArithmeticError if both precisions differ."""
    doubles, fine = (list(solved(name, digits)) for digits in PRECISIONS)
    largest = {key: max(abs(row[key]) for _, row in fine) for key in fine[0][1]}
    lines: list[list[str]] = []
    for (first, item), (_, other) in zip(doubles, fine, strict=True):
        line = [first]
        for key, number in other.items():
            # of a column that is zero everywhere the unit itself is the scale
            results = mpf(0) if abs(number) <= ZERO * max(largest[key], mpf(10) ** -3) else number
            if abs(item[key] - number) > abs(results) * mpf(10) ** -(DIGITS + 2) + ZERO:
                raise ArithmeticError(f"{name}: {key} is {written(item[key])} and {written(number)}")
            line.append(written(results))
        lines.append(line)
    first = "t" if name in motions()["by_program"] else "angle"
    return [first, *fine[0][1]], lines


def write_table(name: str) -> None:
    """Write data/NAME.csv."""
    head, lines = table(name)
    path = FOLDER / "data" / f"{name}.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *lines])


def unit_of(column: str, slides: Sequence[str] = ()) -> str:
    """Return a column's unit."""
    if column in ("t", "angle"):
        return "s" if column == "t" else "rad"
    if ":" in column:
        return "N" if column.startswith("force") else "N m"
    name, what = column.rsplit(".", 1)
    order = {"q": 0, "v": 1, "a": 2}.get(what, len(what) - 1 and "va".index(what[0]) + 1)
    base = "m" if what not in ("q", "v", "a") or name in slides else "rad"
    return base + ("", "/s", "/s2")[order]


def resource(name: str) -> dict[str, Any]:
    """Return the entry of datapackage.json for one table."""
    described = read(FOLDER / "mechanisms" / f"{name}.toml")
    speed = None if described.motion_laws else motions()["speeds"].get(name, motions()["speed"])
    return {
        "name": name.replace("_", "-"),
        "path": f"data/{name}.csv",
        "mechanism": f"mechanisms/{name}.toml",
        "crank_speed": None if speed is None else f"{speed} rad/s",
    } | contents(described, f"data/{name}.csv")


def forward_resource(name: str) -> dict[str, Any]:
    """Return the entry of datapackage.json for one released motion."""
    described = read(FOLDER / "forward" / f"{name}.toml")
    impacts = FOLDER / "forward" / f"{name}.impacts.json"
    return {
        "name": f"forward-{name.replace('_', '-')}",
        "path": f"forward/{name}.csv",
        "mechanism": f"forward/{name}.toml",
        "crank_speed": None,
        "restitution": runs()[name].get("restitution"),
        "impacts": json.loads(impacts.read_text(encoding="utf-8")) if impacts.is_file() else [],
    } | contents(described, f"forward/{name}.csv")


def contents(described: Description, path: str) -> dict[str, Any]:
    """Return what datapackage.json states of a file: size, checksum, columns."""
    data = (FOLDER / path).read_bytes()
    head, *lines = csv.reader(data.decode("utf-8").splitlines())
    slides = [pair.name for pair in described.pairs if pair.kind == "prismatic"]
    return {
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8",
        "bytes": len(data),
        "hash": f"sha256:{hashlib.sha256(data).hexdigest()}",
        "rows": len(lines),
        "schema": {
            "fields": [{"name": item, "type": "number", "unit": unit_of(item, slides)} for item in head],
            "primaryKey": head[0],
        },
    }


def package() -> dict[str, Any]:
    """Return datapackage.json."""
    return {
        "profile": "tabular-data-package",
        "name": "mechsim-reference",
        "title": "Motion and drive torque of linkages to 30 digits",
        "version": "1.0.0",
        "description": "Position, velocity and acceleration of points and drive torque of known mechanisms "
        "at 72 crank angles or instants, in SI, to 30 significant digits; motion released under forces, to "
        "25 digits of each column's largest value.",
        "licenses": [
            {
                "name": "CC-BY-4.0",
                "title": "Creative Commons Attribution 4.0 International",
                "path": "https://creativecommons.org/licenses/by/4.0/",
            }
        ],
        "contributors": [{"title": "The mechsim maintainers", "role": "author"}],
        "uncertainty": "One unit of the last digit written, of every number; a lone 0 is exact. The first "
        "column is exact as it is written. Of released motion: 1e-25 of a column's largest value.",
        "provenance": {
            "script": "make.py",
            "formulas": "vector loops in absolute coordinates, Newton's method, virtual power; Taylor series",
            "digits": list(PRECISIONS),
            "digits_of_released_motion": list(FORWARD_PRECISIONS),
            "versions": {"mpmath": mpmath.__version__, "numpy": np.__version__},
        },
        "resources": [*(resource(name) for name in names()), *(forward_resource(name) for name in runs())],
    }


def sealed() -> Iterator[str]:
    """Return lines of checksums, as `sha256sum -c` reads them."""
    kinds = (
        *("mechanisms/*.toml", "data/*.csv", "motions.toml", "datapackage.json", "make.py", "exact/*.py"),
        *("runs.toml", "forward/*.toml", "forward/*.csv", "models/*.*", "models/driven/*"),
    )
    for kind in kinds:
        for path in sorted(FOLDER.glob(kind)):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            yield f"{digest}  {path.relative_to(FOLDER).as_posix()}\n"


def main(requested: Sequence[str]) -> None:
    """Make some tables, or all."""
    every = [*names(), *(f"forward/{name}" for name in runs())]
    for name in requested or every:
        if name.startswith("forward/"):
            write_released(name.removeprefix("forward/"))
        else:
            write_table(name)
        print(name, flush=True)
    tables = (FOLDER / (name if "/" in name else f"data/{name}") for name in every)
    if all(path.with_suffix(".csv").is_file() for path in tables):
        stated = json.dumps(package(), indent=1, ensure_ascii=False) + "\n"
        (FOLDER / "datapackage.json").write_text(stated, encoding="utf-8")
        (FOLDER / "SHA256SUMS").write_text("".join(sealed()), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
