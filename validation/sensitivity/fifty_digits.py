"""Exact derivatives by dimensions against 50 digits: all of the catalogue and of the gallery.

The other road is that of `reference/`, which shares nothing with mechsim but the TOML files: vector loops in
absolute coordinates closed by Newton's method with mpmath, twists and their rates by the same matrix, drive
efforts by virtual power. A parameter of the file is moved to either side by 1e-26 of itself, mechanisms are
solved with 95 digits, and their difference is the derivative to 50.

Prints, for each mechanism, the largest error of places, velocities, accelerations and drive efforts by any
parameter, relative to the largest derivative of such quantities by that parameter; with --write, keeps some
for the tests.

Run: python validation/sensitivity/fifty_digits.py [NAME...] [--write]
"""

import re
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np
from mpmath import mp, mpf

HOUSE = Path(__file__).parents[2]
sys.path.insert(0, str(HOUSE / "reference"))
sys.path.insert(0, str(HOUSE))
import make  # noqa: E402
from exact.description import read  # noqa: E402
from exact.solving import followed, in_doubles, instant  # noqa: E402

import mechsim as ms  # noqa: E402
from mechsim.analytic import catalog  # noqa: E402

DIGITS, STEP = 95, "1e-26"
ROWS = (7, 33, 58)
# a derivative this small next to the largest by another parameter, in parts of both, is none
NONE = 1e-9
KEPT = HOUSE / "tests" / "studies" / "sensitivity" / "derivatives.csv"
# those whose test takes seconds; the knitting machine and klann take 40 each
KEEP = (*(name for name in catalog.DRIVES if name != "warp_knitter"), "humanoid_ankle")


class Exactly:
    """A mechanism of `reference/mechanisms` at some instants, with parameters moved."""

    def __init__(self, name):
        self.name, self.path = name, HOUSE / "reference" / "mechanisms" / f"{name}.toml"
        self.text = self.path.read_text(encoding="utf-8")
        given = tomllib.loads(self.text, parse_float=str).get("parameters", {})
        self.parameters = {item: str(value) for item, value in given.items() if _plain(str(value))}
        described = read(self.path)
        wanted = make.instants(described)
        self.drives = [wanted[row][1] for row in ROWS]
        path = [{item: float(at[0]) for item, at in drive.items()} for drive in self.drives]
        self.stood = followed(in_doubles(described), path)
        self.clock = np.array([float(wanted[row][0]) for row in ROWS])

    def columns(self, text):
        """Columns of a file with this text, by name: a number an instant."""
        with tempfile.NamedTemporaryFile("w", suffix=".toml", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            described = read(Path(file.name))
        rows = [
            make.columns(described, drive, instant(described, *stood, drive))
            for stood, drive in zip(self.stood, self.drives, strict=True)
        ]
        return {name: [row[name] for row in rows] for name in rows[0]}

    def slopes(self, parameter):
        """Derivatives of all columns by a parameter, per unit of the file."""
        value = mpf(self.parameters[parameter])
        step = mpf(STEP) * (abs(value) or 1)
        ahead, behind = (self.columns(self._moved(parameter, value + sign * step)) for sign in (1, -1))
        return {
            name: [(a - b) / (2 * step) for a, b in zip(ahead[name], behind[name], strict=True)]
            for name in ahead
        }

    def _moved(self, parameter, value):
        line = f'{parameter} = "{mp.nstr(value, DIGITS, min_fixed=-mp.inf, max_fixed=mp.inf)}"'
        text, count = re.subn(rf"(?m)^{parameter} = .*$", line, self.text, count=1)
        assert count == 1
        return text


def _plain(text):
    return re.fullmatch(r"[-+]?[0-9.]+(e[-+]?\d+)?", text) is not None


def kind(column):
    """What a column measures."""
    if ":" in column:
        return "drive"
    return {"v": "velocity", "a": "acceleration"}.get(column.rpartition(".")[2][0], "place")


# parameters of a file -> dimension of the catalogue and sign, where names differ
NAMED = {
    "rssr": {"x": "pivot.x", "y": "pivot.y", "z": "pivot.z", "gamma1": "gamma2", "gamma2": "gamma1"},
    "rrsrr": {"x": "pivot.x", "y": "pivot.y", "z": "pivot.z", "gamma1": "gamma2", "gamma2": "gamma1"},
    "bennett": {"ground": "length0", "twist_ground": "twist0", "twist_crank": "twist1"},
    "warp_knitter": {
        f"{place}_{axis}": f"{place}.{axis}"
        for place in ("pivot2", "pivot_rocker", "base_c", "base_k")
        for axis in "xy"
    },
}
# the looper's arm_angle is counted the other way in its file
REVERSED = {("looper", "arm_angle")}


class ByMechsim:
    """Derivatives by mechsim: of the file itself, or of the catalogue's mechanism of this name."""

    def __init__(self, item, model):
        speed = float(make.motions()["speeds"].get(item.name, make.motions()["speed"]))
        form = ms.load(model) if isinstance(model, str) else model
        if form.motion_laws.crank:
            subject = ms.moved(model, angles=item.clock, speed=speed)
        else:
            subject = ms.moved(model, t=item.clock)
        points = [
            f"{name}.{rate}{axis}"
            for name in subject.form.mechanism.points
            for rate in make.RATES
            for axis in make.AXES
        ]
        self.catalogued = model == item.name
        efforts = {} if self.catalogued else self._efforts(subject)
        names = {of: self._named(item, of)[0] for of in item.parameters}
        self.table = ms.sensitivity(subject, [*points, *efforts], [*dict.fromkeys(names.values())])
        self.forces, self.one = efforts, item

    def _efforts(self, subject):
        """Columns of drive efforts, and what the other method calls them."""
        form = subject.form
        if form.motion_laws.crank:
            return {"torque": f"torque:{form.mechanism.driver}"}
        slides = form.mechanism.straight
        drivers = form.motion_laws.drivers
        return {f"drive {name}": f"{'force' if name in slides else 'torque'}:{name}" for name in drivers}

    def _named(self, item, parameter):
        if not self.catalogued:
            return parameter, 1
        name = NAMED.get(item.name, {}).get(parameter, parameter)
        return name, -1 if (item.name, parameter) in REVERSED else 1

    def slopes(self, parameter):
        """Columns as the other method calls them -> derivatives, (n,) per SI."""
        name, sign = self._named(self.one, parameter)
        if name not in self.table.by:
            return {}
        return {self.forces.get(of, of): sign * item for of, item in self.table.by[name].items()}

    def factor(self, parameter):
        """What one unit of the file is in SI, exactly."""
        unit = self.table.dimensions[self._named(self.one, parameter)[0]].unit
        units = tomllib.loads(self.one.text).get("units", {})
        lengths = {"mm": mpf("1e-3"), "cm": mpf("1e-2")}
        if unit == "m":
            return lengths.get(units.get("length"), mpf(1))
        return mp.pi / 180 if unit == "rad" and units.get("angle") == "deg" else mpf(1)


def errors(item, result, exact):
    """Largest error of each kind of column by any parameter, by the largest derivative of that kind by it."""
    largest, worst = {}, {}
    for parameter, slopes in exact.items():
        ours = result.slopes(parameter)
        for column in ours:
            reported = [abs(float(value / result.factor(parameter))) for value in slopes[column]]
            at = parameter, kind(column)
            largest[at] = max(largest.get(at, 0.0), *reported)
    for parameter, slopes in exact.items():
        for column, values in result.slopes(parameter).items():
            of = kind(column)
            scale = largest[parameter, of]
            least = NONE * max(size for (_, other), size in largest.items() if other == of)
            if scale <= least:
                continue
            off = [
                abs(float(mpf(float(value)) - right / result.factor(parameter)))
                for value, right in zip(values, slopes[column], strict=True)
            ]
            if max(off) / scale > worst.get(of, (-1.0, ""))[0]:
                worst[of] = max(off) / scale, parameter
    return worst


def kept(item, result, exact):
    """Lines for the tests: the last point's place and velocity and the drive, at the first instant."""
    last = list(result.table.moved.solver.mechanism.points)[-1]
    for parameter, slopes in exact.items():
        for column, values in slopes.items():
            wanted = column.rpartition(".")[0] == last and kind(column) in ("place", "velocity")
            if (wanted or kind(column) == "drive") and column in result.slopes(parameter):
                value = values[0] / result.factor(parameter)
                yield f"{item.name},{float(item.clock[0])!r},{parameter},{column},{mp.nstr(value, 25)}"


def main(asked):
    write = "--write" in asked
    names = [item for item in asked if item != "--write"] or (KEEP if write else make.names())
    mp.dps = DIGITS
    lines, worst = ["mechanism,at,parameter,column,derivative"], 0.0
    for name in names:
        item = Exactly(name)
        if not item.parameters:
            print(f"{name:22s} has no parameters", flush=True)
            continue
        exact = {parameter: item.slopes(parameter) for parameter in item.parameters}
        for model in (str(item.path), *((name,) if name in catalog.DRIVES else ())):
            result = ByMechsim(item, model)
            reported = errors(item, result, exact)
            text = ", ".join(f"{of} {size:.1e} ({by})" for of, (size, by) in reported.items())
            print(
                f"{name:22s} {'catalogue' if model == name else 'file':9s} {len(exact):2d}: {text}",
                flush=True,
            )
            worst = max(worst, *(size for size, _ in reported.values()))
            if write and model != name:
                lines += kept(item, result, exact)
    print(f"largest of all: {worst:.1e}")
    if write:
        KEPT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert worst <= 1e-9


if __name__ == "__main__":
    main(sys.argv[1:])
