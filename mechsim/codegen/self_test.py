"""A test of a generated solver in the same language: reference configurations, range, speed."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mechsim.codegen.solver_code import SolverCode, template
from mechsim.errors import InputError
from mechsim.kinematics.loops.motion import instants_of_laws
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


@dataclass(frozen=True)
class ReferenceConfigurations:
    """Reference values of a test.

    Attributes:
        kind: "point" or "link": the kind of the moving objects.
        index: indices of these objects in the solver.
        drivers: values, rates and accelerations of the drivers, (3, n, drivers).
        values: positions, velocities and accelerations, (n, points, 9).
        scales: largest value of each, [m], [m/s], [m/s2].
        tolerance: allowed error relative to the scales.
    """

    kind: str
    index: tuple[int, ...]
    drivers: Array
    values: Array
    scales: Array
    tolerance: float


def reference_configurations(code: SolverCode) -> ReferenceConfigurations:
    """Return configurations over the range from the analytic solution.

    Raises:
        InputError: if there are several drivers without motion laws.
    """
    assembly = code.assembly
    source, laws, start = assembly.source, assembly.source.motion_laws, assembly.mechanism.start
    if not laws.crank:
        parameter = np.linspace(0.0, laws.length, CONFIGURATIONS)
        motion = source.solve_along(parameter, laws.rate)
    else:
        if not assembly.mechanism.has_crank:
            raise InputError(
                f"{source.name}: a test needs to know how {', '.join(assembly.drivers)} move; give motion "
                "laws, as --drive NAME=LAW"
            )
        low, high = assembly.interval or (start - np.pi, start + np.pi)
        inset = INSET * (high - low)
        parameter = np.linspace(low + inset, high - inset, CONFIGURATIONS)
        motion = source.solve_along(parameter, SPEED, ACCELERATION)
    speed, acceleration = (SPEED, ACCELERATION) if laws.crank else (laws.rate, 0.0)
    unit = np.ones_like(parameter)
    instants = instants_of_laws(laws, parameter, speed * unit, acceleration * unit)
    kind, names = ("point", code.formulas.points) if motion.points else ("link", code.formulas.links)
    records = motion.points or motion.links
    compared = [name for name in names if name in records]
    motions = [records[name] for name in compared]
    values = np.stack(
        [np.concatenate([each.position, each.velocity, each.acceleration], 1) for each in motions], 1
    )
    scales = np.abs(values.reshape(CONFIGURATIONS, -1, 3, 3)).max((0, 1, 3))
    scales[0] = max(scales[0], assembly.mechanism.characteristic_length)
    tolerance = TOLERANCE
    if len(assembly.loops.unknown):
        smallest = float(assembly.solver.linearise(assembly.samples).singular_values[:, -1].min())
        tolerance *= max(1.0, (WELL_CONDITIONED / smallest) ** 2)
    return ReferenceConfigurations(
        kind,
        tuple(names.index(name) for name in compared),
        np.stack([instants.value.T, instants.rate.T, instants.second.T]),
        values,
        np.where(scales > 0.0, scales, 1.0),
        tolerance,
    )


def c_test(code: SolverCode, header: str) -> str:
    """Return a C99 program that checks and times a solver; `header` is the file name of its header."""
    return _test(code, header, "test.c", _c_array).replace("@", code.prefix + "_")


def javascript_test(code: SolverCode, file: str) -> str:
    """Return a script for Node.js that checks and times a solver; `file` is the name of its file."""

    def array(name: str, values: Array) -> Iterator[str]:
        yield f"const {name} = {json.dumps(values.ravel().tolist())};"

    return _test(code, file, "test.js", array)


def _test(code: SolverCode, file: str, name: str, array: Callable[[str, Array], Iterator[str]]) -> str:
    reference = reference_configurations(code)
    arrays = {
        "drivers": reference.drivers[0],
        "rates": reference.drivers[1],
        "accelerations": reference.drivers[2],
        "index": np.array(reference.index),
        "reference": reference.values,
        "scales": reference.scales,
    }
    data = "\n".join(line for name, values in arrays.items() for line in array(name, values))
    limits = code.assembly.interval
    text = template(name, {"LIMITED": limits is not None})
    replaced = {
        "HEADER": file,
        "DATA": data,
        "KIND": reference.kind,
        "NAMES": str(code.sizes[f"{reference.kind.upper()}S"]),
        "COUNT": str(len(reference.values)),
        "COMPARED": str(len(reference.index)),
        "TOLERANCE": f"{reference.tolerance:.3g}",
        "NAME": code.prefix,
        "@HIGH": f"({limits[1]!r})" if limits else "",
    }
    return re.sub("|".join(replaced), lambda match: replaced[match[0]], text) + "\n"


def _c_array(name: str, values: Array) -> Iterator[str]:
    of_drivers = name in ("drivers", "rates", "accelerations")
    number = "@real" if of_drivers else "int" if values.dtype.kind == "i" else "double"
    entries = [f"{'(@real)' * of_drivers}{value!r}" for value in values.ravel().tolist()]
    yield f"static const {number} {name}[{len(entries)}] = {{"
    width = NUMBERS if name == "reference" else 6
    for i in range(0, len(entries), width):
        yield f"  {', '.join(entries[i : i + width])},"
    yield "};"
