"""Command `mechsim compile`: a solver of a mechanism as a C header or a JavaScript file."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim.cli.command import Result, Without, command
from mechsim.cli.options import ModelOptions, require_other_drivers
from mechsim.cli.output_paths import output_file, writable
from mechsim.codegen.assembly import assembly
from mechsim.codegen.printing import c_header, javascript
from mechsim.codegen.self_test import c_test, javascript_test
from mechsim.codegen.solver_code import solver_code
from mechsim.errors import InputError
from mechsim.files import atomic_path
from mechsim.units import option


@command
def compile_solver(
    options: Annotated[ModelOptions, Without("duration", "track", "loops")],
    *,
    output: Annotated[str, output_file("Solver to write: .h for C99, .js for JavaScript.", ".h", ".js")],
    test: str | None = option(
        None, "Also write a test that checks and times the solver.", metavar="FILE.c|FILE.js"
    ),
) -> Result:
    """Write a solver without dependencies: a C99 header, or JavaScript.

    It solves positions, rates, accelerations and drive torques from the drivers, in one assembly.

    Examples:
    mechsim compile rssr -o rssr.h --test rssr_test.c
    mechsim compile leg.toml -o leg.js
    """
    path = Path(output)
    test_path = None if test is None else writable(test, ".c" if path.suffix == ".h" else ".js")
    if test_path is not None and test_path.resolve() == path.resolve():
        raise InputError(f"-o and --test both name {output!r}; give the test another name")
    require_other_drivers(options.model, options.sets, options)
    code = solver_code(assembly(options.load()))
    in_c = path.suffix.lower() == ".h"
    text = c_header(code) if in_c else javascript(code)
    _write(path, text)
    if test_path is not None:
        _write(test_path, (c_test if in_c else javascript_test)(code, path.name))
    limits = code.assembly.interval
    data: dict[str, Any] = {
        "output": output,
        "mechanism": code.assembly.mechanism.name,
        "drivers": [*code.assembly.drivers],
        "coordinates": [*code.formulas.coordinates],
        "range": None if limits is None else [float(limits[0]), float(limits[1])],
        "lines": len(text.splitlines()),
        "torques": code.inertias is not None,
        "test": test,
    }
    return Result(data, lambda: _print(data, code.prefix), files=(output, test))


def _write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _print(data: dict[str, Any], prefix: str) -> None:
    limits = data["range"]
    span = "any value" if limits is None else f"{limits[0]:.6g} to {limits[1]:.6g} rad"
    drivers = ", ".join(data["drivers"])
    typer.echo(f"{data['lines']} lines; {prefix}_start, then {prefix}_solve from {drivers} ({span})")
