"""A test of a generated solver in the same language: reference configurations, range, speed."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.loops.motion import instants_of_laws
from mechsim.codegen.solver_code import SolverCode, chosen
from mechsim.errors import InputError
from mechsim.model.motion import Motion
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

C_TEST = """
/* Checks @solver against the analytic solution, and times it. */
#include <stdio.h>
#include <time.h>
#include "HEADER"

DATA

int main(void) {
  @state s;
  @KIND values[NAMES];
  double worst = 0;
  const double allowed = TOLERANCE * (double)@EPSILON / DBL_EPSILON;
  if (@start(&s) != @SOLVED) { printf("start fails\\n"); return 1; }
  for (int k = 0; k < COUNT; k++) {
    const int d = k * @DRIVERS;
    const int status = @solve(&s, drivers + d, rates + d, accelerations + d);
    if (status != @SOLVED) { printf("configuration %d: status %d\\n", k, status); return 1; }
    @solve_KINDs(&s, values);
    for (int i = 0; i < COMPARED; i++) {
      const double *expected = reference + (k * COMPARED + i) * 9;
      for (int j = 0; j < 3; j++) {
        const double errors[3] = {
          fabs((double)values[index[i]].position[j] - expected[j]) / scales[0],
          fabs((double)values[index[i]].velocity[j] - expected[3 + j]) / scales[1],
          fabs((double)values[index[i]].acceleration[j] - expected[6 + j]) / scales[2],
        };
        for (int e = 0; e < 3; e++) { if (!(errors[e] <= worst)) { worst = errors[e]; } }
      }
    }
  }
#if LIMITED
  {
    const @real outside[1] = { @HIGH + 1 };
    const @real before = s.coordinates[0];
    if (@solve(&s, outside, rates, accelerations) == @SOLVED || s.coordinates[0] != before) {
      printf("a configuration outside the range is not rejected\\n");
      return 1;
    }
  }
#endif
  long solved = 0;
  const clock_t begin = clock();
  while (clock() - begin < CLOCKS_PER_SEC / 5) {
    for (int k = 0; k < 2 * COUNT; k++) {
      const int d = (k < COUNT ? k : 2 * COUNT - 1 - k) * @DRIVERS;
      solved += @solve(&s, drivers + d, rates + d, accelerations + d) == @SOLVED;
    }
  }
  printf("NAME: largest relative error %.2g, allowed %.2g; %.3f us a configuration\\n", worst, allowed,
         1e6 * (double)(clock() - begin) / CLOCKS_PER_SEC / (double)solved);
  return !(worst <= allowed);
}
"""
JS_TEST = """
// Checks the solver against the analytic solution, and times it.
"use strict";
const solver = require("./HEADER");
DATA
const s = solver.state();
const values = solver.KINDs.map(() => solver.KIND());
const at = (list, k) => list.slice(k * solver.drivers.length, (k + 1) * solver.drivers.length);
const solve = (k) => solver.solve(s, at(drivers, k), at(rates, k), at(accelerations, k));
let worst = solver.start(s) === solver.SOLVED ? 0 : Infinity;
for (let k = 0; k < COUNT; k++) {
  if (solve(k) !== solver.SOLVED) { worst = Infinity; break; }
  solver.solve_KINDs(s, values);
  for (let i = 0; i < COMPARED; i++) {
    ["position", "velocity", "acceleration"].forEach((quantity, e) => {
      for (let j = 0; j < 3; j++) {
        const expected = reference[(k * COMPARED + i) * 9 + 3 * e + j];
        const error = Math.abs(values[index[i]][quantity][j] - expected) / scales[e];
        if (!(error <= worst)) { worst = error; }
      }
    });
  }
}
#if LIMITED
if (solver.solve(s, [@HIGH + 1], [0], [0]) === solver.SOLVED) { worst = Infinity; }
#endif
let us = 0;
for (const seconds of [0.5, 0.5]) { // the first round is for node to compile the code
  const begin = process.hrtime.bigint();
  let solved = 0;
  for (; Number(process.hrtime.bigint() - begin) < 1e9 * seconds; solved += 2 * COUNT) {
    for (let k = 0; k < 2 * COUNT; k++) { solve(k < COUNT ? k : 2 * COUNT - 1 - k); }
  }
  us = Number(process.hrtime.bigint() - begin) / 1e3 / solved;
}
console.log(`NAME: largest relative error ${worst}, allowed TOLERANCE; ${us.toFixed(3)} us a configuration`);
process.exitCode = worst <= TOLERANCE ? 0 : 1;
"""


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
    unit = np.ones_like(parameter)
    rate, second = (laws.rate * unit, 0.0 * unit) if not laws.crank else (SPEED * unit, ACCELERATION * unit)
    instants = instants_of_laws(laws, parameter, rate, second)
    kind, names = ("point", code.formulas.points) if motion.points else ("link", code.formulas.links)
    compared = [name for name in names if name in motion.points or (kind == "link" and name in motion.links)]
    values = np.stack([_motion_of(motion, kind, name) for name in compared], 1)
    scales = np.abs(values.reshape(CONFIGURATIONS, -1, 3, 3)).max((0, 1, 3))
    scales[0] = max(scales[0], assembly.mechanism.characteristic_length)
    return ReferenceConfigurations(
        kind,
        tuple(names.index(name) for name in compared),
        np.stack([instants.value.T, instants.rate.T, instants.second.T]),
        values,
        np.where(scales > 0.0, scales, 1.0),
        _tolerance(code),
    )


def _motion_of(motion: Motion, kind: str, name: str) -> Array:
    record = motion.points[name] if kind == "point" else motion.links[name]
    return np.concatenate([record.position, record.velocity, record.acceleration], 1)


def _tolerance(code: SolverCode) -> float:
    solver, q = code.assembly.solver, code.assembly.samples
    if not len(code.assembly.loops.unknown):
        return TOLERANCE
    smallest = float(solver.linearise(q).singular_values[:, -1].min())
    return TOLERANCE * max(1.0, (WELL_CONDITIONED / smallest) ** 2)


def c_test(code: SolverCode, header: str) -> str:
    """Return a C99 program that checks and times a solver; `header` is the file name of its header."""
    return _test(code, header, C_TEST, _c_array).replace("@", code.prefix + "_")


def javascript_test(code: SolverCode, file: str) -> str:
    """Return a script for Node.js that checks and times a solver; `file` is the name of its file."""

    def array(name: str, values: Array) -> Iterator[str]:
        yield f"const {name} = {json.dumps(values.ravel().tolist())};"

    return _test(code, file, JS_TEST, array)


def _test(code: SolverCode, file: str, template: str, array: object) -> str:
    reference = reference_configurations(code)
    arrays = {
        "drivers": reference.drivers[0],
        "rates": reference.drivers[1],
        "accelerations": reference.drivers[2],
        "index": np.array(reference.index),
        "reference": reference.values,
        "scales": reference.scales,
    }
    data = "\n".join(line for name, values in arrays.items() for line in array(name, values))  # type: ignore[operator]
    limits = code.assembly.interval
    text = chosen(template.strip(), {"LIMITED": limits is not None})
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
    number = (
        "int"
        if values.dtype.kind == "i"
        else "@real"
        if name in ("drivers", "rates", "accelerations")
        else "double"
    )
    entries = [repr(value) for value in values.ravel().tolist()]
    yield f"static const {number} {name}[{len(entries)}] = {{"
    width = NUMBERS if name == "reference" else 6
    for i in range(0, len(entries), width):
        cast = "(@real)" if number == "@real" else ""
        yield "  " + ", ".join(cast + entry for entry in entries[i : i + width]) + ","
    yield "};"
