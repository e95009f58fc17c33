"""Make the reference data: `python reference/make.py [NAME ...]`.

Reads mechanisms/NAME.toml and motions.toml, writes data/NAME.csv, and, where all are made, datapackage.json
and checksums. Needs numpy and mpmath, and nothing of mechsim. Everything is computed with 60 digits and again
with 75; the second is written. A difference in the last digit written is an error.
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

from exact.description import Description, read  # noqa: E402
from exact.loops import State  # noqa: E402
from exact.solving import Instant, followed, in_doubles, instant  # noqa: E402

DIGITS = 30
PRECISIONS = (60, 75)
ROWS = 72
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


def written(number: Any) -> str:
    """Return a number as it is written: `DIGITS` digits."""
    return "0" if number == 0 else mp.nstr(number, DIGITS, min_fixed=1, max_fixed=0, strip_zeros=False)


def instants(described: Description) -> list[tuple[str, dict[str, tuple[Any, Any, Any]]]]:
    """Return the first cell of every row, and value, rate and acceleration of the drivers there.

    The first cell, an angle in [rad] or a time in [s], is exact: all else is computed from it.
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
    """Return a mechanism's rows: their first cell, and numbers by column.

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
    path = FOLDER / "data" / f"{name}.csv"
    with path.open(encoding="utf-8", newline="") as file:
        head, *lines = csv.reader(file)
    described = read(FOLDER / "mechanisms" / f"{name}.toml")
    slides = [pair.name for pair in described.pairs if pair.kind == "prismatic"]
    speed = None if described.motion_laws else motions()["speeds"].get(name, motions()["speed"])
    data = path.read_bytes()
    return {
        "name": name.replace("_", "-"),
        "path": f"data/{name}.csv",
        "mechanism": f"mechanisms/{name}.toml",
        "crank_speed": None if speed is None else f"{speed} rad/s",
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
        "at 72 crank angles or instants, in SI, to 30 significant digits.",
        "licenses": [
            {
                "name": "CC-BY-4.0",
                "title": "Creative Commons Attribution 4.0 International",
                "path": "https://creativecommons.org/licenses/by/4.0/",
            }
        ],
        "contributors": [{"title": "The mechsim maintainers", "role": "author"}],
        "uncertainty": "One unit of the last digit written, of every number; a lone 0 is exact. The first "
        "column is exact as it is written.",
        "provenance": {
            "script": "make.py",
            "formulas": "vector loops in absolute coordinates, Newton's method, virtual power",
            "digits": list(PRECISIONS),
            "versions": {"mpmath": mpmath.__version__, "numpy": np.__version__},
        },
        "resources": [resource(name) for name in names()],
    }


def sealed() -> Iterator[str]:
    """Return lines of checksums, as `sha256sum -c` reads them."""
    kinds = ("mechanisms/*.toml", "data/*.csv", "motions.toml", "datapackage.json", "make.py", "exact/*.py")
    for kind in kinds:
        for path in sorted(FOLDER.glob(kind)):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            yield f"{digest}  {path.relative_to(FOLDER).as_posix()}\n"


def main(requested: Sequence[str]) -> None:
    """Make some tables, or all."""
    for name in requested or names():
        write_table(name)
        print(name, flush=True)
    if all((FOLDER / "data" / f"{name}.csv").is_file() for name in names()):
        stated = json.dumps(package(), indent=1, ensure_ascii=False) + "\n"
        (FOLDER / "datapackage.json").write_text(stated, encoding="utf-8")
        (FOLDER / "SHA256SUMS").write_text("".join(sealed()), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
