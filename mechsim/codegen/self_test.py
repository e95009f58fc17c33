"""A test of a generated solver in the same language: reference configurations, range, speed."""

import json
import re
from collections.abc import Callable, Iterator

import numpy as np

from mechsim.codegen.solver_code import SolverCode, c_array, template
from mechsim.errors import InputError
from mechsim.kinematics.loops.motion import instants_of_laws
from mechsim.kinematics.loops.path import Instants
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array

# number of test configurations: steps of 5 degrees over a revolution
CONFIGURATIONS = 72
# fraction of a limited range that is omitted at either end
INSET = 0.02
# speed and acceleration of the crank, in [rad/s] and [rad/s2]
SPEED, ACCELERATION = 1.0, 0.5
# allowed error relative to the largest value for well-conditioned configurations, and their least
# conditioning; the rounding error of accelerations grows with the inverse square of the distance from a
# singular configuration
TOLERANCE, WELL_CONDITIONED = 1e-12, 0.1
# number of values of a point: position, velocity, acceleration
NUMBERS = 9


def _reference_motion(code: SolverCode) -> tuple[Motion, Instants]:
    """Return the analytic solution at configurations over the range, and the motion of its drivers.

    Raises:
        InputError: if there are several drivers without motion laws.
    """
    assembly, start = code.assembly, code.assembly.mechanism.start
    source, laws = assembly.source, assembly.source.motion_laws
    low, high, inset, speed, acceleration = 0.0, laws.length, 0.0, laws.rate, 0.0
    if laws.crank:
        if not assembly.mechanism.has_crank:
            raise InputError(
                f"{source.name}: a test needs the motion of {', '.join(assembly.drivers)}; give motion laws, "
                "as --drive NAME=LAW"
            )
        low, high = assembly.interval or (start - np.pi, start + np.pi)
        inset, speed, acceleration = INSET * (high - low), SPEED, ACCELERATION
    parameter = np.linspace(low + inset, high - inset, CONFIGURATIONS)
    unit = np.ones_like(parameter)
    instants = instants_of_laws(laws, parameter, speed * unit, acceleration * unit)
    return source.solve_along(parameter, speed, acceleration), instants


def c_test(code: SolverCode, header: str) -> str:
    """Return a C99 program that checks and times a solver; `header` is the file name of its header."""
    return _test(code, header, "test.c", _c_array).replace("@", code.prefix + "_")


def javascript_test(code: SolverCode, file: str) -> str:
    """Return a script for Node.js that checks and times a solver; `file` is the name of its file."""

    def array(name: str, values: Array) -> Iterator[str]:
        yield f"const {name} = {json.dumps(values.ravel().tolist())};"

    return _test(code, file, "test.js", array)


def _test(code: SolverCode, file: str, name: str, array: Callable[[str, Array], Iterator[str]]) -> str:
    assembly, limits = code.assembly, code.assembly.interval
    motion, instants = _reference_motion(code)
    kind, names = ("point", code.formulas.points) if motion.points else ("link", code.formulas.links)
    records = {name: (motion.points or motion.links).get(name) for name in names}
    compared = {name: each for name, each in records.items() if each is not None}
    # position, velocity and acceleration of each point or link, (n, compared, 9)
    values = np.stack(
        [np.concatenate([x.position, x.velocity, x.acceleration], 1) for x in compared.values()], 1
    )
    # largest of each, in [m], [m/s], [m/s2]
    scales = np.abs(values.reshape(CONFIGURATIONS, -1, 3, 3)).max((0, 1, 3))
    scales[0] = max(scales[0], assembly.mechanism.characteristic_length)
    tolerance = TOLERANCE
    if len(assembly.loops.unknown):
        smallest = float(assembly.solver.linearise(assembly.samples).singular_values[:, -1].min())
        tolerance *= max(1.0, (WELL_CONDITIONED / smallest) ** 2)
    arrays = {
        "drivers": instants.value.T,
        "rates": instants.rate.T,
        "accelerations": instants.second.T,
        "index": np.array([names.index(name) for name in compared]),
        "reference": values,
        "scales": np.where(scales > 0.0, scales, 1.0),
    }
    data = "\n".join(line for name, values in arrays.items() for line in array(name, values))
    replaced = {
        "HEADER": file,
        "DATA": data,
        "KIND": kind,
        "NAMES": str(code.sizes[f"{kind.upper()}S"]),
        "COUNT": str(CONFIGURATIONS),
        "COMPARED": str(len(compared)),
        "TOLERANCE": f"{tolerance:.3g}",
        "NAME": code.prefix,
        "@HIGH": f"({limits[1]!r})" if limits else "",
    }
    text = template(name, {"LIMITED": limits is not None})
    return re.sub("|".join(replaced), lambda match: replaced[match[0]], text) + "\n"


def _c_array(name: str, values: Array) -> Iterator[str]:
    of_drivers = name in ("drivers", "rates", "accelerations")
    number = "@real" if of_drivers else "int" if values.dtype.kind == "i" else "double"
    entries = [f"{'(@real)' * of_drivers}{value!r}" for value in values.ravel().tolist()]
    return c_array(number, name, entries, NUMBERS if name == "reference" else 6)
