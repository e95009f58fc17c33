"""Speed, size and error of generated solvers, in 64 and 32 bits, compared with the loop equations in numpy.

Each mechanism of the reference data is compiled by gcc and clang. The errors of points, their rates and drive
torques are relative to the largest value, against data of 30 digits; those in 32 bits are against the
analytic solution. The time is that of a configuration with rates and accelerations at steps of 5 degrees, the
best of several runs on one core; numpy solves 1,000 at once. The size is that of all functions, optimised for
size.

Run: python validation/speed/compiled_solver.py [NAME ...]
"""

import re
import subprocess
import sys
import tempfile
import timeit
from pathlib import Path

import numpy as np

import mechsim as ms
from mechsim.codegen.compiled import CompiledSolver
from mechsim.codegen.self_test import c_test, javascript_test
from mechsim.io import reference_data
from mechsim.kinematics.solvers import KinematicSolver

FLAGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
ROUNDS = 5
# limits of this study: relative error, and microseconds a configuration
ALLOWED = 1e-12
LIMITS = {"rssr": 1.5, "jansen": 6.0, "humanoid_ankle": 6.0, "stewart_gough": 15.0}
EXPORTS = """
#include "solver.h"
int solve(@state *s, const double *d) { return @start(s) + @solve(s, d, d, d); }
void links(const @state *s, @link *links) { @solve_links(s, links); }
"""


def run(*command: object) -> str:
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True).stdout


def reference_error(solver: CompiledSolver, name: str) -> float:
    """Return the largest relative error of points, rates and torques against the reference data."""
    table = reference_data.read(reference_data.folder(), name)
    motion = solver.solve(table.first, table.speed) if table.speed else solver.solve(t=table.first)
    errors = []
    for quantity in ("position", "velocity", "acceleration"):
        exact = np.array([getattr(point, quantity) for point in table.points.values()])
        computed = np.array([getattr(motion.points[point], quantity) for point in table.points])
        errors.append(np.abs(computed - exact).max() / np.abs(exact).max())
    joints = [motion.joints[driver] for driver in solver.drivers]
    drivers = [np.stack([getattr(j, q) for j in joints], 1) for q in ("value", "rate", "acceleration")]
    torques = solver.solve_drivers(*drivers).torques
    exact = np.array([table.drive_forces[driver] for driver in solver.drivers]).T
    return float(max(*errors, np.abs(torques - exact).max() / np.abs(exact).max()))


def printed_test(command: Path | str, *arguments: object) -> tuple[float, float]:
    """Return the error and the shortest time in microseconds that a test prints."""
    texts = [run(command, *arguments) for _ in range(ROUNDS)]
    matches = [re.search(r"error ([\d.e+-]+),.*; ([\d.]+) us", text) for text in texts]
    values = [(float(match[1]), float(match[2])) for match in matches if match]
    return values[0][0], min(seconds for _, seconds in values)


def code_size(solver: CompiledSolver, folder: Path) -> int:
    """Return the bytes of code and constants, optimised for size."""
    text = EXPORTS.replace("@", f"{solver.code.prefix}_")
    if solver.code.sizes["POINTS"]:
        text += "void points(const @state *s, @point *p) { @solve_points(s, p); }\n"
    if solver.code.inertias is not None:
        text += "void torques(const @state *s, double *t) { @solve_torques(s, @INERTIAS, @GRAVITY, t); }\n"
    (folder / "size.c").write_text(text.replace("@", f"{solver.code.prefix}_"))
    run("gcc", *FLAGS, "-Os", "-c", folder / "size.c", "-o", folder / "size.o")
    return int(run("size", folder / "size.o").splitlines()[1].split()[0])


def numpy_time(solver: CompiledSolver) -> float:
    """Return the microseconds a configuration that the loop equations take in numpy, 1,000 at once."""
    source = solver.code.assembly.source
    loops = KinematicSolver(source.mechanism, motion_laws=source.motion_laws)
    low, high = solver.code.assembly.interval or (0.0, min(source.period, 2.0 * np.pi))
    inset = 0.02 * (high - low)
    parameter = np.linspace(low + inset, high - inset, 1000)
    return 1e3 * min(timeit.repeat(lambda: loops.solve_along(parameter), number=1, repeat=ROUNDS))


def study(name: str, folder: Path) -> bool:
    """Print the row of a mechanism; return whether it satisfies the limits."""
    solver = ms.compile(reference_data.folder() / "mechanisms" / f"{name}.toml")
    (folder / "solver.h").write_text(solver.header)
    (folder / "test.c").write_text(c_test(solver.code, "solver.h"))
    (folder / "solver.js").write_text(solver.javascript)
    (folder / "test.js").write_text(javascript_test(solver.code, "solver.js"))
    times, single = [], 0.0
    for compiler, real in (("gcc", "double"), ("clang", "double"), ("gcc", "float")):
        command = (*FLAGS, "-O2", f"-DMECHSIM_REAL={real}", folder / "test.c", "-o", folder / "test", "-lm")
        run(compiler, *command)
        error, seconds = printed_test(folder / "test")
        if real == "float":
            single = error
        times.append(seconds)
    script = printed_test("node", folder / "test.js")[1]
    error, kibibytes = reference_error(solver, name), code_size(solver, folder) / 1024
    print(
        f"| {name} | {solver.code.sizes['UNKNOWNS']} | {times[0]:.2f} | {times[1]:.2f} | {times[2]:.2f} | "
        f"{script:.1f} | {numpy_time(solver):.1f} | {error:.1e} | {single:.1e} | {kibibytes:.1f} |",
        flush=True,
    )
    return error <= ALLOWED and min(times[:2]) <= LIMITS.get(name, np.inf)


def main() -> int:
    names = sys.argv[1:] or reference_data.names(reference_data.folder())
    print(
        "| mechanism | unknowns | gcc [µs] | clang [µs] | gcc, float [µs] | node [µs] | numpy [µs] |", end=""
    )
    print(" error | error of floats | size [KiB] |\n|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        passed = [study(name, Path(folder)) for name in names]
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
