"""Command `mechsim fit`: dimensions from measured motion, or masses and friction from measured torques."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mechsim import files, units
from mechsim.cli.command import Result, Stated, Without, command, output_file
from mechsim.cli.load_options import note_replaced
from mechsim.cli.options import SPEED, ModelOptions
from mechsim.cli.output import Value, number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.errors import InputError, several
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.quantities import scalar_quantities
from mechsim.studies.calibration import Fit, fit_dimensions
from mechsim.studies.identification import Identification, identify
from mechsim.studies.measured_table import MeasuredMotion, measured_of, read_measured, single
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.units import crank_speed, option

# significant digits of an identified dimension
MAX_DIGITS = 9
# options of a motion that a log of torques contains
FROM_LOG = ("drive", "duration")
# names of parameters that torques determine
INERTIAL = re.compile(
    r".+\.(mass|com(\.[xyz])?|inertia(\.[xyz]{2})?|(viscous|coulomb)(_turn)?)|(.+\.)?motor\.constant"
)

# relative difference between the given and the measured speed that is reported as an error
SPEED_DIFFERENCE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Measured motion, and the dimensions to identify."""

    to: str | None = option(
        None,
        "Table of the measured motion: columns angle or t, P3.x, rocker.q ..., in SI or with a unit "
        "(P3.x [mm]); P3.x± holds standard deviations; or a log of joint states in MCAP.",
        metavar="FILE.csv|FILE.mcap",
    )
    vary: tuple[str, ...] = option(
        (),
        "Dimensions to identify, and CRANK.offset, the zero of the crank's encoder; or, from torques or "
        "currents: LINK.mass, LINK.com.x, LINK.inertia.zz, JOINT.viscous, JOINT.coulomb, motor.constant.",
        read=units.parse_names,
        metavar="P,...",
    )
    speed: str | None = option(
        None, f"Crank speed; a bare number is rad/s. Default: that of the table, else {SPEED}."
    )

    @property
    def inertial(self) -> bool:
        """Whether masses, friction or motor constants are to be identified; InputError for a mixture."""
        own = [name for name in self.vary if INERTIAL.fullmatch(name)]
        others = [name for name in self.vary if name not in own]
        if own and others:
            raise InputError(
                f"--vary names dimensions ({', '.join(others)}) and {', '.join(own)}; fit the dimensions to "
                "the motion first, then the others to the torques"
            )
        return bool(own)


@command
def fit(
    source: Annotated[ModelOptions, Without("track", "duration", "loops")],
    options: FitOptions,
    stated: Stated,
    output: Annotated[
        str | None,
        output_file("Result to write: .json, or residuals as .csv or .npz.", ".json", ".csv", ".npz"),
    ] = None,
) -> Result:
    """Identify dimensions from measured motion, or masses and friction from torques, with their uncertainty.

    The search starts from the present dimensions: give others with --set. -o writes the result as .json, or
    measured and fitted quantities row by row as .csv.

    Examples:
    mechsim fit slider_crank --to measured.csv --vary crank,rod
    mechsim fit arm.toml --to measured.csv --vary reach,crank.offset -o fit.json
    mechsim fit arm.toml --to log.csv --vary forearm.mass,elbow.viscous
    """
    table = options.to
    if table is None:
        raise InputError("the measured motion is missing; name its table, as in --to measured.csv")
    if not options.vary:
        raise InputError("--vary is missing; name the dimensions to identify, as in --vary crank,coupler")
    if options.inertial:
        stated.exclude(["speed", *FROM_LOG], "on parameters from torques")
        return _identify(source, options.vary, table, output)
    parametric = source.load_parametric()
    solver = parametric.make({})
    measured = measured_of(read_measured(table), solver, table)
    moved = MovedFamily(parametric, measured.angles, _crank_speed(options.speed, measured, solver))
    quantities = scalar_quantities([*single(measured.values, moved).values()], solver.mechanism)
    timed = any(quantity.order or quantity.loaded for quantity in quantities)
    stated.exclude(["speed"], "on measured positions", not timed)
    if any(quantity.loaded for quantity in quantities):
        note_replaced(solver)
    with progress("fit", None) as report:
        names = [name for name in options.vary if name != moved.offset]
        offset = len(names) < len(options.vary)
        result = fit_dimensions(moved, measured, names, offset=offset, progress=report)
    if output is not None:
        _write(output, result, measured)
    return Result(result, lambda: _print(result, measured), result.outcome == "fitted", [output])


def _crank_speed(requested: str | None, measured: MeasuredMotion, solver: KinematicSolver) -> float:
    """Return the crank's speed in [rad/s]: the given speed, else the speed of the table, else the default.

    Raises:
        InputError: if the table has another speed than the given speed.
    """
    rates = measured.values.get(f"{solver.mechanism.drivers[0]}.v")
    if rates is None or not solver.motion_laws.crank:
        return crank_speed(requested or SPEED)
    mean = float(rates.mean())
    if requested is None:
        return mean
    speed = crank_speed(requested)
    if abs(speed - mean) > SPEED_DIFFERENCE * abs(mean):
        raise InputError(
            f"--speed is {speed:.4g} rad/s, but the crank of the table rotates at {mean:.4g} rad/s; "
            "leave --speed out"
        )
    return speed


def _identify(source: ModelOptions, vary: Sequence[str], table: str, output: str | None) -> Any:
    """Return the result of masses, friction and motor constants from a log."""
    if output is not None and not output.lower().endswith(".json"):
        raise InputError(f"-o is {output}; parameters from torques are written as .json")
    arguments = {name: value for name, value in source.load_arguments().items() if name not in FROM_LOG}
    with progress("fit", None):
        result = identify(source.model, read_measured(table), vary, where=table, **arguments)
        note_replaced(load(source.model, **arguments, still=True))
    if output is not None:
        files.write_json(output, result)
    return Result(result, lambda: _print_identified(result), result.outcome == "fitted", [output])


def _print_identified(result: Identification) -> None:
    names = [name for name in result.values if name not in result.without_effect]
    _print_values(f"{result.mechanism}: {result.outcome}", "parameter", result, names)
    for combination in result.combinations:
        value, deviation = number(combination.value), number(combination.deviation, 2)
        print_text(f"only together: {combination.text} = {value} ± {deviation}")
    if result.without_effect:
        print_text(f"no torque depends on {', '.join(result.without_effect)}")
    if result.impossible:
        print_text(f"{', '.join(result.impossible)} cannot be negative; check signs, units and the model")
    errors = ", ".join(
        f"{name} {number(result.prediction_error[name], 3)} ({number(value, 3)} where fitted)"
        for name, value in result.rms.items()
    )
    fitted, predicted = result.rows
    print_text(f"root mean square error of the last {predicted} rows, predicted from {fitted}: {errors}")
    if result.unused:
        print_text(
            f"{several(len(result.unused), 'column')} without a use: {', '.join(result.unused[:4])} ..."
        )


def _write(path: str, result: Fit, measured: MeasuredMotion) -> None:
    if path.lower().endswith(".json"):
        files.write_json(path, result)
        return
    table = {result.moved.over[0]: measured.over}
    names = single(measured.values, result.moved)
    fitted = result.moved.values([*names.values()], {})
    for name, values in measured.values.items():
        own = fitted[names[name]]
        table |= {name: values, f"{name}.fit": own, f"{name}.left": own - values}
    files.write_table(path, table)


def _print(result: Fit, measured: MeasuredMotion) -> None:
    for group in result.together:
        print_text(
            f"indistinguishable by these measurements: {', '.join(group)}; fix one, or measure more"
            if len(group) > 1
            else f"no measured quantity depends on {', '.join(group)}"
        )
    _print_values(f"{result.moved.designs.name}: {result.outcome}", "dimension", result, [*result.values])
    strongest = max(result.correlations.items(), key=lambda pair: abs(pair[1]), default=None)
    if strongest is not None:
        pair, value = strongest
        print_text(f"strongest correlation {value:.3f}, of {pair}; condition {number(result.condition, 3)}")
    rms = ", ".join(f"{name} {number(value, 3)}" for name, value in result.rms.items())
    print_text(f"root mean square residual of {several(measured.count, 'number')}: {rms}")
    if result.weighed:
        print_text(
            f"that is {number(result.spread, 3)} of the given deviations; about 1 if these are correct"
        )


def _print_values(title: str, what: str, result: Fit | Identification, names: Sequence[str]) -> None:
    """Print a table of values with their deviations."""
    rows: list[tuple[Value, ...]] = []
    for name in names:
        deviations = [own.get(name) for own in (result.deviations, result.within_95)]
        texts = ["unknown" if value is None else number(value, 2) for value in deviations]
        value = _to_digit_of(result.values[name], deviations[0])
        rows.append((name, value, *texts, result.start[name], result.units[name]))
    print_table(title, (what, "value", "± (1 sigma)", "± (95 %)", "start", "unit"), rows)


def _to_digit_of(value: float, deviation: float | None) -> str:
    """Return a value rounded to the second significant digit of its deviation."""
    if not deviation or not value or not np.isfinite(deviation):
        return number(value)
    digits = 2 + int(np.floor(np.log10(abs(value / deviation))))
    return number(value, min(max(digits, 2), MAX_DIGITS))
