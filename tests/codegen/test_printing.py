"""The header under two compilers, warnings as errors, sanitizers and floats; the same in JavaScript."""

import ctypes
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from grids import grid
from model_files import model_text

import mechsim as ms
from mechsim.codegen.expressions import ExpressionTable
from mechsim.codegen.kinematics import identifiers
from mechsim.codegen.self_test import c_test, javascript_test
from mechsim.codegen.solver_code import STATUSES
from mechsim.kinematics.solvers import KinematicSolver

REFERENCE = Path(__file__).parents[2] / "reference" / "mechanisms"
WARNINGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
# a spinning coupler, planar dyads with points, balls and six drivers, a limited range, gears
# README's tests compile a planar, a spatial and an overconstrained mechanism
LARGEST = pytest.param("stewart_gough", marks=pytest.mark.slow)
NAMES = (
    pytest.param("rssr", marks=pytest.mark.slow),
    pytest.param("jansen", marks=pytest.mark.slow),
    LARGEST,
    "bricard",
    "planetary_gear",
)
# README's tests run JavaScript of one
IN_JAVASCRIPT = grid(("rssr", "jansen", "stewart_gough", "bricard", "planetary_gear"), ("rssr",))


def written(solver, folder, name="solver.h"):
    (folder / "solver.h").write_text(solver.header)
    (folder / "test.c").write_text(c_test(solver.code, name))
    return folder / "test.c"


def run(*command):
    return subprocess.run(
        [str(component) for component in command], capture_output=True, text=True, check=False
    )


def built(compiler, source, *flags):
    output = source.with_suffix(".out")
    result = run(compiler, *WARNINGS, *flags, source, "-o", output, "-lm")
    assert result.returncode == 0, result.stderr
    return output


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_code_compiles_without_warnings_and_passes_its_test(compiled, tmp_path, name):
    source = written(compiled(name), tmp_path)
    for compiler in ("gcc", "clang"):
        if not shutil.which(compiler) and compiler == "clang":
            continue  # gcc is required, clang only where it is installed
        result = run(built(compiler, source, "-O2"))
        assert result.returncode == 0, result.stdout
        assert "us a configuration" in result.stdout


@pytest.mark.long
@pytest.mark.parametrize("name", ["rssr", pytest.param("bricard", marks=pytest.mark.slow), LARGEST])
def test_sanitizers_find_no_undefined_behaviour(compiled, tmp_path, name):
    source = written(compiled(name), tmp_path)
    result = run(
        built("gcc", source, "-O1", "-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all")
    )
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_float_solver_agrees_to_single_precision(compiled, tmp_path):
    source = written(compiled("jansen"), tmp_path)
    result = run(built("gcc", source, "-DMECHSIM_REAL=float"))
    assert result.returncode == 0, result.stdout
    assert 1e-8 < float(result.stdout.split("error ")[1].split(",")[0]) < 1e-4


def test_the_self_test_rejects_a_changed_solver(compiled, tmp_path):
    solver = compiled("rssr")
    source = written(solver, tmp_path)
    right = "MECHSIM_C(-0.046)"
    assert right in solver.header
    (tmp_path / "solver.h").write_text(solver.header.replace(right, "MECHSIM_C(-0.0460000001)"))
    assert run(built("gcc", source)).returncode == 1


@pytest.mark.long
def test_the_self_test_rejects_a_missing_range_check(compiled, tmp_path):
    solver = compiled("bricard")
    source = written(solver, tmp_path)
    (tmp_path / "solver.h").write_text(
        solver.header.replace("return bricard_OUT_OF_RANGE;", "return bricard_SOLVED;")
    )
    result = run(built("gcc", source))
    assert result.returncode == 1
    assert "outside the range is not rejected" in result.stdout


# names that end a comment, that the code uses itself, and that differ only in special characters
ARM = model_text("printing_arm.toml")


@pytest.mark.long
def test_invalid_identifiers_are_renamed(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    solver = ms.compile(tmp_path / "arm.toml")
    (tmp_path / "DATA.h").write_text(solver.header)
    for compiler in filter(shutil.which, ("gcc", "clang")):
        result = run(built(compiler, written(solver, tmp_path, "DATA.h")))
        assert result.returncode == 0, result.stdout
    assert solver.header.count("*/") == solver.header.count("/*")
    (tmp_path / "solver.js").write_text(solver.javascript)
    (tmp_path / "test.js").write_text(javascript_test(solver.code, "solver.js"))
    assert node(tmp_path / "test.js").returncode == 0
    names = ["a", "a_2", "a!"]
    assert len({*identifiers(names).values()}) == len(names)


def library(solver, name, text, folder):
    """Return a library of C code, whose `@` stand for the name of a solver."""
    written(solver, folder)
    (folder / "library.c").write_text(text.replace("@", f"{name}_"))
    return ctypes.CDLL(str(built("gcc", folder / "library.c", "-shared", "-fPIC")))


JOINTS = """#include "solver.h"
int joints_at(double angle, double speed, double acceleration, double *out) {
  @state s;
  @joint joints[@JOINTS];
  int status = @start(&s) + @solve(&s, &angle, &speed, &acceleration);
  @solve_joints(&s, joints);
  for (int i = 0; i < 3 * @JOINTS; i++) { out[i] = joints[i / 3].motion[i % 3]; }
  return status;
}
"""


@pytest.mark.parametrize(
    "name", ["slider_crank", "jansen", pytest.param("oldham_coupling", marks=pytest.mark.slow)]
)
def test_cut_joints_have_values_and_rates(compiled, tmp_path, name):
    solver = compiled(name)
    function = library(solver, name, JOINTS, tmp_path).joints_at
    names = solver.code.formulas.joints
    out = (ctypes.c_double * (3 * len(names)))()
    assert function(ctypes.c_double(1.1), ctypes.c_double(2.0), ctypes.c_double(3.0), out) == 0
    exact = KinematicSolver(solver.code.assembly.source.mechanism).solve([1.1], 2.0, 3.0).joints
    for i, joint in enumerate(names):
        expected = [exact[joint].value[0], exact[joint].rate[0], exact[joint].acceleration[0]]
        assert out[3 * i : 3 * i + 3] == pytest.approx(expected, abs=1e-12)


GARBAGE = """#include "solver.h"
int after_garbage(double angle, double rate, double garbage) {
  @state s;
  @configuration c;
  const double zero = 0;
  int status = @start(&s);
  @save(&s, &c);
  c.coordinates[1] = garbage;
  const int restored = @restore(&s, &c);
  status = @solve(&s, &angle, &rate, &zero);
  return 10 * restored + status;
}
"""


def test_invalid_states_and_nonfinite_numbers_are_rejected(compiled, tmp_path):
    solver = compiled("jansen")
    function = library(solver, "jansen", GARBAGE, tmp_path).after_garbage
    start = solver.code.assembly.start.values[1, 0]

    def statuses(angle, rate, coordinate):
        return divmod(function(*map(ctypes.c_double, (angle, rate, coordinate))), 10)

    solved, out_of_range, too_far = (STATUSES.index(name) for name in ("SOLVED", "OUT_OF_RANGE", "TOO_FAR"))
    assert statuses(0.1, 1.0, start) == (solved, solved)
    for rate in (np.nan, np.inf):
        assert statuses(0.1, rate, start) == (solved, out_of_range)
    assert statuses(np.nan, 1.0, start) == (solved, too_far)
    for garbage in (start + 0.3, np.nan, 1e300):
        assert solved not in statuses(0.1, 1.0, garbage)


def node(*arguments):
    path = shutil.which("node")
    assert path, "JavaScript is tested by node; apt-get install nodejs brings it"
    return run(path, *arguments)


@pytest.mark.parametrize("name", IN_JAVASCRIPT)
def test_javascript_passes_its_self_test(compiled, tmp_path, name):
    solver = compiled(name)
    (tmp_path / "solver.js").write_text(solver.javascript)
    (tmp_path / "test.js").write_text(javascript_test(solver.code, "solver.js"))
    result = node(tmp_path / "test.js")
    assert result.returncode == 0, result.stdout + result.stderr
    sign = solver.code.sizes["SIGN"]
    (tmp_path / "solver.js").write_text(
        solver.javascript.replace(f"const SIGN = {sign};", f"const SIGN = {-sign};")
    )
    assert node(tmp_path / "test.js").returncode == 1


@pytest.mark.long
def test_the_command_writes_solver_and_self_test(tmp_path, mechsim):
    header, test = tmp_path / "leg.h", tmp_path / "leg.c"
    code, out, _ = mechsim("compile", REFERENCE / "bricard.toml", "-o", header, "--test", test, "--json")
    data = json.loads(out)
    assert code == 0
    assert data["drivers"] == ["crank"]
    assert data["range"][0] == pytest.approx(-0.5235988)
    assert run(built("gcc", test)).returncode == 0
    code, out, _ = mechsim("compile", "slider_crank", "-o", tmp_path / "a.js", "--test", tmp_path / "b.js")
    assert code == 0
    assert "slider_crank_solve from crank (any value)" in out
    assert node(tmp_path / "b.js").returncode == 0


def test_constants_are_folded():
    table = ExpressionTable()
    x, y = table.symbol("x"), table.symbol("y")
    assert x + 0.0 is x
    assert 0.0 + x is x
    assert x * 1.0 is x
    assert x - 0.0 is x
    assert (x * 0.0).number == 0.0
    assert (x - x).number == 0.0
    assert (x * 6e-17).number == 0.0
    negative = -x
    assert -negative is x
    assert (-x) * (-y) is x * y
    assert x - (-y) is x + y
    assert 2.0 * (3.0 * x) is 6.0 * x
    assert (table.expression(2.0) * table.expression(0.25)).number == 0.5
