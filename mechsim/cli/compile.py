"""Command `mechsim compile`: a solver of a mechanism as a C header or a JavaScript file, or an FMU."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim.cli.command import Result, Stated, Without, command, output_file, writable
from mechsim.cli.exit_codes import print_stderr
from mechsim.cli.load_options import InitialOptions, released_model
from mechsim.cli.options import ModelOptions
from mechsim.cli.output import print_text
from mechsim.codegen.assembly import assembly
from mechsim.codegen.dynamics_header import dynamics_header, dynamics_test
from mechsim.codegen.fmu import FmuModel, Standard, fmu_archive
from mechsim.codegen.fmu_dynamics import dynamic_fmu
from mechsim.codegen.fmu_kinematics import kinematic_fmu
from mechsim.codegen.self_test import c_test, javascript_test
from mechsim.codegen.solver_code import SolverCode, c_header, javascript, solver_code
from mechsim.errors import InputError, several
from mechsim.files import write_content
from mechsim.kinetics.dynamic_run import Initial
from mechsim.kinetics.gaps import released
from mechsim.kinetics.model import DynamicModel
from mechsim.mechanism.forces import forces_of
from mechsim.units import option

# forces of a prescribed motion that the torques of generated solvers leave out
NOT_IN_TORQUES = (
    *("friction", "springs", "joint_springs", "nonlinear_springs", "bushings", "loads", "couples"),
    *("crank_torque", "flywheel", "actuators"),
)


@command
def compile_solver(
    options: Annotated[ModelOptions, Without("duration", "track", "loops")],
    initial: Annotated[InitialOptions, Without("until")],
    stated: Stated,
    *,
    output: Annotated[
        str,
        output_file(
            "Solver to write: .h for C99, .js for JavaScript, .fmu for other simulators.", ".h", ".js", ".fmu"
        ),
    ],
    test: str | None = option(
        None, "Also write a test that checks and times the solver.", metavar="FILE.c|FILE.js"
    ),
    dynamics: bool = option(
        False,
        "Write the motion under forces, as C99 or an FMU: efforts on the joints are its inputs, not the "
        "drivers.",
    ),
    fmi: str | None = option(None, "Version of the standard of an FMU. Default: 3.", metavar="2|3"),
) -> Result:
    """Write a solver without dependencies: a C99 header, JavaScript, or an FMU.

    It solves positions, rates, accelerations and drive torques from the drivers, in one assembly.
    An FMU holds the solver with its C code for Model Exchange and Co-Simulation.

    Examples:
    mechsim compile rssr -o rssr.h --test rssr_test.c
    mechsim compile leg.toml -o leg.js
    mechsim compile four_bar --dynamics --initial crank.q=30deg -o four_bar.fmu
    mechsim compile four_bar --dynamics -o four_bar.h --test four_bar_test.c
    """
    path = Path(output)
    suffix = path.suffix.lower()
    in_c, is_fmu = suffix == ".h", suffix == ".fmu"
    stated.exclude(["test"], "on an FMU", is_fmu)
    stated.exclude(["fmi"], "on a solver that is no FMU", not is_fmu)
    stated.exclude(["dynamics"], "on JavaScript", suffix == ".js")
    stated.exclude(["initial"], "without --dynamics", not dynamics)
    stated.exclude(["drive"], "with --dynamics, where efforts on the joints are inputs", dynamics)
    if is_fmu:
        if fmi not in (None, "2", "3"):
            raise InputError(f"--fmi is {fmi!r}; it can be 2 or 3")
        return _fmu(options, initial if dynamics else None, output, 2 if fmi == "2" else 3)
    test_path = None if test is None else writable(test, ".c" if in_c else ".js")
    if test_path is not None and test_path.resolve() == path.resolve():
        raise InputError(f"-o and --test both name {output!r}; give the test another name")
    if dynamics:
        return _dynamics(released_model(options), dict(initial.initial), path, test_path)
    code = _solver(options)
    text = c_header(code) if in_c else javascript(code)
    write_content(path, text)
    if test_path is not None:
        write_content(test_path, (c_test if in_c else javascript_test)(code, path.name))
    limits, lines = code.assembly.interval, len(text.splitlines())
    data: dict[str, Any] = {
        "output": output,
        "mechanism": code.assembly.mechanism.name,
        "drivers": [*code.assembly.drivers],
        "coordinates": [*code.formulas.coordinates],
        "range": None if limits is None else [float(limits[0]), float(limits[1])],
        "lines": lines,
        "torques": code.inertias is not None,
        "test": test,
    }
    span = "any value" if limits is None else f"{limits[0]:.6g} to {limits[1]:.6g} rad"
    call = f"{code.prefix}_solve from {', '.join(code.assembly.drivers)} ({span})"
    use = f"{lines} lines; {code.prefix}_start, then {call}"
    return Result(data, lambda: typer.echo(use), files=(output, test))


def _solver(options: ModelOptions) -> SolverCode:
    """Return the solver of a model; a line on stderr names forces that its torques leave out."""
    options.require_other_drivers()
    code = solver_code(assembly(options.load()))
    mechanism = code.assembly.source.mechanism
    forces = forces_of(code.assembly.source).under_drivers({*mechanism.drivers, *mechanism.locked})
    without = [name.replace("_", " ") for name in NOT_IN_TORQUES if getattr(forces, name)]
    if code.inertias is not None and without:
        print_stderr(
            f"mechsim: the torques of the solver are without {', '.join(without)} of the model; "
            "`mechsim dynamics inverse` includes them"
        )
    return code


def _fmu(options: ModelOptions, initial: InitialOptions | None, output: str, standard: Standard) -> Result:
    """Write an FMU: of a run from an initial state, or of the positions if that is None."""
    model: FmuModel
    if initial is None:
        model = kinematic_fmu(_solver(options))
    else:
        model = dynamic_fmu(released_model(options), dict(initial.initial))
    write_content(output, fmu_archive(model, standard))
    data = {"output": output, "mechanism": model.name, "fmi": standard}
    return _with_variables(model, data, f"FMI {standard}.0, Model Exchange and Co-Simulation", (output,))


def _dynamics(model: DynamicModel, initial: Mapping[str, Initial], path: Path, test: Path | None) -> Result:
    """Write a header of the motion under forces, and its test."""
    written = dynamic_fmu(model, initial)
    text = dynamics_header(written)
    checked = dynamics_test(written, released(model), initial, path.name) if test is not None else ""
    write_content(path, text)
    if test is not None:
        write_content(test, checked)
    data = {"output": str(path), "mechanism": written.name, "test": None if test is None else str(test)}
    use = f"{len(text.splitlines())} lines; {written.identifier}_start, _begin, _advance"
    return _with_variables(written, data, use, (str(path), data["test"]))


def _with_variables(
    model: FmuModel, data: dict[str, Any], title: str, files: tuple[str | None, ...]
) -> Result:
    """Return the result of a written model of `FmuModel`, with the names of its variables."""
    kinds = ("inputs", "parameters", "states", "outputs")
    names = {kind: [variable.name for variable in getattr(model, kind)] for kind in kinds}

    def text() -> None:
        numbers = ", ".join(several(len(names[kind]), kind.removesuffix("s")) for kind in kinds)
        typer.echo(f"{title}: {numbers}")
        print_text(f"inputs: {', '.join(names['inputs']) or 'none'}")

    return Result({**data, **names}, text, files=files)
