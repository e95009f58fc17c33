"""Make the reference data: `python reference/make.py [NAME ...]`.

Reads mechanisms/NAME.toml and motions.toml, writes data/NAME.csv, and, where all are made, datapackage.json
and checksums. Needs numpy and mpmath, and nothing of mechsim. Everything is computed with 60 digits and again
with 75; what is written is the second, and what both do not agree on to the last digit written is refused.
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

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))  # run as a script or loaded as a file

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
    return sorted(path.stem for path in (HERE / "mechanisms").glob("*.toml"))


def motions() -> dict[str, Any]:
    """Return how the drivers go."""
    return tomllib.loads((HERE / "motions.toml").read_text(encoding="utf-8"))


def written(number: Any) -> str:
    """Return a number as it is written: `DIGITS` digits."""
    return "0" if number == 0 else mp.nstr(number, DIGITS, min_fixed=1, max_fixed=0, strip_zeros=False)


def instants(described: Description) -> list[tuple[str, dict[str, tuple[Any, Any, Any]]]]:
    """Return the first cell of every row, and how the drivers stand there: value, rate, acceleration.

    What stands in the first cell, angle in [rad] or time in [s], is exact: all else is computed from it.
    """
    told = motions()
    if described.name in told["by_program"]:
        cells = [written(mpf(k) / ROWS) for k in range(ROWS)]
        return [
            (cell, {name: _states(go, mpf(cell)) for name, go in described.programs.items()})
            for cell in cells
        ]
    arc = told["arcs"].get(described.name, told["turn"])
    speed = mpf(told["speeds"].get(described.name, told["speed"]))
    cells = [written((mpf(arc["first"]) + k * mpf(arc["step"])) * mp.pi / 180) for k in range(ROWS)]
    crank = described.drivers[0]
    return [(cell, {crank: (mpf(cell), speed, mpf(0))}) for cell in cells]


def _states(go: Any, t: Any) -> tuple[Any, Any, Any]:
    value, rate, half = mp.taylor(go, t, 2)
    return value, rate, 2 * half


@cache
def roughly_stood(name: str) -> list[tuple[State, dict[str, float]]]:
    """Return where a mechanism stands at all rows, in doubles, and its coordinates there."""
    described = read(HERE / "mechanisms" / f"{name}.toml")
    path = [{one: float(at[0]) for one, at in drive.items()} for _, drive in instants(described)]
    return followed(in_doubles(described), path)


def solved(name: str, digits: int, only: Sequence[int] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Return a mechanism's rows: their first cell, and numbers by column.

    Args:
        name: of the mechanism.
        digits: to work with.
        only: places of the rows wanted; all if left out.
    """
    mp.dps = digits
    described = read(HERE / "mechanisms" / f"{name}.toml")
    wanted = instants(described)
    stood = roughly_stood(name)
    for k in only or range(len(wanted)):
        cell, drive = wanted[k]
        yield cell, columns(described, drive, instant(described, *stood[k], drive))


def columns(described: Description, drive: dict[str, Any], found: Instant) -> dict[str, Any]:
    """Return a row's numbers by column."""
    row: dict[str, Any] = {}
    if described.programs:
        for name, states in drive.items():
            row |= {f"{name}.{'qva'[i]}": one for i, one in enumerate(states)}
    for name, states in found.points.items():
        row |= {
            f"{name}.{rate}{axis}": one
            for rate, state in zip(RATES, states, strict=True)
            for axis, one in zip(AXES, state, strict=True)
        }
    slides = {pair.name for pair in described.pairs if pair.kind == "prismatic"}
    for name, effort in found.efforts.items():
        row[f"{'force' if name in slides else 'torque'}:{name}"] = effort
    return row


def table(name: str) -> tuple[list[str], list[list[str]]]:
    """Return a mechanism's table as text, refusing digits of which it is not sure."""
    rough, fine = (list(solved(name, digits)) for digits in PRECISIONS)
    largest = {key: max(abs(row[key]) for _, row in fine) for key in fine[0][1]}
    lines: list[list[str]] = []
    for (cell, one), (_, other) in zip(rough, fine, strict=True):
        line = [cell]
        for key, number in other.items():
            # of a column that is zero everywhere the unit itself is the scale
            kept = mpf(0) if abs(number) <= ZERO * max(largest[key], mpf(10) ** -3) else number
            if abs(one[key] - number) > abs(kept) * mpf(10) ** -(DIGITS + 2) + ZERO:
                raise ArithmeticError(f"{name}: {key} is {written(one[key])} and {written(number)}")
            line.append(written(kept))
        lines.append(line)
    first = "t" if name in motions()["by_program"] else "angle"
    return [first, *fine[0][1]], lines


def write_table(name: str) -> None:
    """Write data/NAME.csv."""
    head, lines = table(name)
    path = HERE / "data" / f"{name}.csv"
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
    """Return what datapackage.json says of one table."""
    path = HERE / "data" / f"{name}.csv"
    with path.open(encoding="utf-8", newline="") as file:
        head, *lines = csv.reader(file)
    described = read(HERE / "mechanisms" / f"{name}.toml")
    slides = [pair.name for pair in described.pairs if pair.kind == "prismatic"]
    speed = None if described.programs else motions()["speeds"].get(name, motions()["speed"])
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
            "fields": [{"name": one, "type": "number", "unit": unit_of(one, slides)} for one in head],
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
        for path in sorted(HERE.glob(kind)):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            yield f"{digest}  {path.relative_to(HERE).as_posix()}\n"


def main(wanted: Sequence[str]) -> None:
    """Make what is wanted, or all."""
    for name in wanted or names():
        write_table(name)
        print(name, flush=True)
    if all((HERE / "data" / f"{name}.csv").is_file() for name in names()):
        told = json.dumps(package(), indent=1, ensure_ascii=False) + "\n"
        (HERE / "datapackage.json").write_text(told, encoding="utf-8")
        (HERE / "SHA256SUMS").write_text("".join(sealed()), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
