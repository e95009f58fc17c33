"""Exact derivatives by dimensions against 50 digits, for catalogue and gallery.

The other method is that of `reference/`, which shares only the TOML files with mechsim: vector loops in
absolute coordinates closed by Newton's method with mpmath, rates by the same matrix, drive efforts by virtual
power. A parameter changes by 1e-26 of itself to either side, both mechanisms are solved with 95 digits, and
the central difference is the derivative to 50 digits.

Prints, for each mechanism, the largest error of positions, velocities, accelerations and drive efforts by
any parameter, relative to the largest derivative of that kind by that parameter. --write stores a table for
the tests.

Run: python validation/sensitivity/fifty_digits.py [NAME...] [--write]
"""

import re
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np
from mpmath import mp, mpf

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "reference"))
sys.path.insert(0, str(ROOT))
import make  # noqa: E402
from exact.description import read  # noqa: E402
from exact.solving import followed, in_doubles, instant  # noqa: E402

import mechsim as ms  # noqa: E402
from mechsim import catalog  # noqa: E402

DIGITS, STEP = 95, "1e-26"
ROWS = (7, 33, 58)
# derivatives below this fraction of the largest by another parameter are not compared
NEGLIGIBLE = 1e-9
TABLE = ROOT / "tests" / "studies" / "sensitivity" / "derivatives.csv"
# mechanisms whose test takes seconds; warp_knitter and klann take 40 s each
TABLE_NAMES = (*(name for name in catalog.MECHANISMS if name != "warp_knitter"), "humanoid_ankle")


class ExactDerivatives:
    """A mechanism of `reference/mechanisms` at some instants, with changed parameters."""

    def __init__(self, name):
        self.name, self.path = name, ROOT / "reference" / "mechanisms" / f"{name}.toml"
        self.text = self.path.read_text(encoding="utf-8")
        parameters = tomllib.loads(self.text, parse_float=str).get("parameters", {})
        self.parameters = {item: str(value) for item, value in parameters.items() if is_number(str(value))}
        description = read(self.path)
        instants = make.instants(description)
        self.drives = [instants[row][1] for row in ROWS]
        path = [{item: float(state[0]) for item, state in laws.items()} for laws in self.drives]
        self.states = followed(in_doubles(description), path)
        self.times = np.array([float(instants[row][0]) for row in ROWS])

    def columns(self, text):
        """Return the columns of a file with this text, by name: one number an instant."""
        with tempfile.NamedTemporaryFile("w", suffix=".toml", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            description = read(Path(file.name))
        rows = [
            make.columns(description, drivers, instant(description, *state, drivers))
            for state, drivers in zip(self.states, self.drives, strict=True)
        ]
        return {name: [row[name] for row in rows] for name in rows[0]}

    def derivatives(self, parameter):
        """Return the derivatives of all columns by a parameter, per unit of the file."""
        value = mpf(self.parameters[parameter])
        step = mpf(STEP) * (abs(value) or 1)
        forward, backward = (self.columns(self._moved(parameter, value + sign * step)) for sign in (1, -1))
        return {
            name: [(a - b) / (2 * step) for a, b in zip(forward[name], backward[name], strict=True)]
            for name in forward
        }

    def _moved(self, parameter, value):
        line = f'{parameter} = "{mp.nstr(value, DIGITS, min_fixed=-mp.inf, max_fixed=mp.inf)}"'
        text, count = re.subn(rf"(?m)^{parameter} = .*$", line, self.text, count=1)
        assert count == 1
        return text


def is_number(text):
    return re.fullmatch(r"[-+]?[0-9.]+(e[-+]?\d+)?", text) is not None


def kind_of(column):
    """Return the kind of quantity of a column."""
    if ":" in column:
        return "drive"
    return {"v": "velocity", "a": "acceleration"}.get(column.rpartition(".")[2][0], "position")


# parameter of a file -> dimension of the catalogue, where names differ
RENAMED = {
    "rssr": {"x": "pivot.x", "y": "pivot.y", "z": "pivot.z", "gamma1": "gamma2", "gamma2": "gamma1"},
    "rrsrr": {"x": "pivot.x", "y": "pivot.y", "z": "pivot.z", "gamma1": "gamma2", "gamma2": "gamma1"},
    "bennett": {"ground": "length0", "twist_ground": "twist0", "twist_crank": "twist1"},
    "warp_knitter": {
        f"{pivot}_{axis}": f"{pivot}.{axis}"
        for pivot in ("pivot2", "pivot_rocker", "base_c", "base_k")
        for axis in "xy"
    },
}
# the arm_angle of the looper has the opposite sign in its file
REVERSED = {("looper", "arm_angle")}


class MechsimDerivatives:
    """Derivatives by mechsim, from the file or from the catalogue's mechanism of this name."""

    def __init__(self, item, model):
        speed = float(make.motions()["speeds"].get(item.name, make.motions()["speed"]))
        solver = ms.load(model) if isinstance(model, str) else model
        if solver.motion_laws.crank:
            subject = ms.moved(model, angles=item.times, speed=speed)
        else:
            subject = ms.moved(model, t=item.times)
        points = [
            f"{name}.{order}{axis}"
            for name in subject.solver.mechanism.points
            for order in make.RATES
            for axis in make.AXES
        ]
        self.from_catalogue = model == item.name
        forces = {} if self.from_catalogue else self._forces(subject)
        names = {parameter: self._named(item, parameter)[0] for parameter in item.parameters}
        self.table = ms.sensitivity(subject, [*points, *forces], [*dict.fromkeys(names.values())])
        self.effort_names, self.exact_model = forces, item

    def _forces(self, subject):
        """Return the columns of drive efforts, and their names in the reference."""
        solver = subject.solver
        if solver.motion_laws.crank:
            return {"torque": f"torque:{solver.mechanism.driver}"}
        sliding = solver.mechanism.straight
        drivers = solver.motion_laws.drivers
        return {f"drive {name}": f"{'force' if name in sliding else 'torque'}:{name}" for name in drivers}

    def _named(self, item, parameter):
        if not self.from_catalogue:
            return parameter, 1
        name = RENAMED.get(item.name, {}).get(parameter, parameter)
        return name, -1 if (item.name, parameter) in REVERSED else 1

    def derivatives(self, parameter):
        """Return columns, as the reference names them -> derivatives (n,) in SI units."""
        name, sign = self._named(self.exact_model, parameter)
        if name not in self.table.by:
            return {}
        return {
            self.effort_names.get(column, column): sign * item for column, item in self.table.by[name].items()
        }

    def factor(self, parameter):
        """Return the unit of a parameter of the file in SI units, exactly."""
        unit = self.table.dimensions[self._named(self.exact_model, parameter)[0]].unit
        units = tomllib.loads(self.exact_model.text).get("units", {})
        lengths = {"mm": mpf("1e-3"), "cm": mpf("1e-2")}
        if unit == "m":
            return lengths.get(units.get("length"), mpf(1))
        return mp.pi / 180 if unit == "rad" and units.get("angle") == "deg" else mpf(1)


def errors(item, result, exact):
    """Return the largest error of each kind of column, relative to the largest derivative of that kind."""
    largest, worst = {}, {}
    for parameter, exact_columns in exact.items():
        computed = result.derivatives(parameter)
        for column in computed:
            sizes = [abs(float(value / result.factor(parameter))) for value in exact_columns[column]]
            key = parameter, kind_of(column)
            largest[key] = max(largest.get(key, 0.0), *sizes)
    for parameter, exact_columns in exact.items():
        for column, values in result.derivatives(parameter).items():
            column_kind = kind_of(column)
            scale = largest[parameter, column_kind]
            threshold = NEGLIGIBLE * max(
                largest_error for (_, other), largest_error in largest.items() if other == column_kind
            )
            if scale <= threshold:
                continue
            deviations = [
                abs(float(mpf(float(value)) - exact_value / result.factor(parameter)))
                for value, exact_value in zip(values, exact_columns[column], strict=True)
            ]
            if max(deviations) / scale > worst.get(column_kind, (-1.0, ""))[0]:
                worst[column_kind] = max(deviations) / scale, parameter
    return worst


def table_rows(item, result, exact):
    """Yield test rows: position and velocity of the last point, and the drive, at the first instant."""
    last_point = list(result.table.moved.solver.mechanism.points)[-1]
    for parameter, exact_columns in exact.items():
        for column, values in exact_columns.items():
            selected = column.rpartition(".")[0] == last_point and kind_of(column) in ("position", "velocity")
            if (selected or kind_of(column) == "drive") and column in result.derivatives(parameter):
                value = values[0] / result.factor(parameter)
                yield f"{item.name},{float(item.times[0])!r},{parameter},{column},{mp.nstr(value, 25)}"


def main(arguments):
    write = "--write" in arguments
    names = [item for item in arguments if item != "--write"] or (TABLE_NAMES if write else make.names())
    mp.dps = DIGITS
    lines, worst = ["mechanism,at,parameter,column,derivative"], 0.0
    for name in names:
        item = ExactDerivatives(name)
        if not item.parameters:
            print(f"{name:22s} has no parameters", flush=True)
            continue
        exact = {parameter: item.derivatives(parameter) for parameter in item.parameters}
        for model in (str(item.path), *((name,) if name in catalog.MECHANISMS else ())):
            result = MechsimDerivatives(item, model)
            largest = errors(item, result, exact)
            text = ", ".join(
                f"{label} {largest_error:.1e} ({cause})" for label, (largest_error, cause) in largest.items()
            )
            print(
                f"{name:22s} {'catalogue' if model == name else 'file':9s} {len(exact):2d}: {text}",
                flush=True,
            )
            worst = max(worst, *(largest_error for largest_error, _ in largest.values()))
            if write and model != name:
                lines += table_rows(item, result, exact)
    print(f"largest of all: {worst:.1e}")
    if write:
        TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert worst <= 1e-9


if __name__ == "__main__":
    main(sys.argv[1:])
