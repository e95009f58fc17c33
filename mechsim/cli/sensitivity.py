"""Command `mechsim sensitivity`: exact derivatives by dimensions, and propagation of tolerances."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mechsim import files, units
from mechsim.cli.command import Result, Stated, Without, command, table_file
from mechsim.cli.load_options import masses_in_json, note_replaced, print_masses
from mechsim.cli.options import SPEED, ModelOptions, warn_about_angles
from mechsim.cli.output import DEGREES, Value, print_table, print_text, without_noise
from mechsim.errors import InputError
from mechsim.mechanism.quantities import quantity_names
from mechsim.studies.sensitivity.moved_family import MovedFamily, spread_instants
from mechsim.studies.sensitivity.sensitivity import (
    Sensitivity,
    ToleranceStudy,
    derivative_table,
    tolerance_study,
)
from mechsim.studies.sensitivity.tolerances import CLEARANCE, parsed_tolerances, written_tolerances
from mechsim.units import crank_speed, option

# maximum number of printed contributions to a tolerance
MAX_SHARES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityOptions:
    """Quantities, dimensions and tolerances."""

    quantities: tuple[str, ...] = option(
        (),
        "Quantities: points (P3, P3.v), joints (rocker), columns (P3.x, rocker.v, torque, P3.fx), force:P3, "
        "distance:P,Q, angle:LINK,LINK, expr:EXPRESSION.",
        read=quantity_names,
        name="--of",
        metavar="Q,...",
    )
    to: tuple[str, ...] = option(
        ("all",),
        "Dimensions: parameters, components (pivot.x), or JOINT.at.x of a file without parameters.",
        read=units.parse_names,
        text="all",
        metavar="P,...",
    )
    angles: str | None = option(
        None, "Crank angles start:stop:step, both ends included; a bare number is rad. [default: 0:360:5deg]"
    )
    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    tolerances: str | None = option(
        None,
        "Tolerances of dimensions (crank=±0.02mm) and clearances of joints (P3.clearance=0.01mm). "
        "Default: the uncertainties in the file, if it states any.",
        metavar="P=BOUND,...",
    )


@command
def sensitivity(
    source: Annotated[ModelOptions, Without("track", "loops")],
    options: SensitivityOptions,
    stated: Stated,
    output: Annotated[str | None, table_file("Table of derivatives to write")] = None,
) -> Result:
    """Differentiate quantities by dimensions, exactly; propagate tolerances and rank their contributions.

    The table has the columns angle and P3.x/crank ..., derivatives in SI at the same position of the drivers.
    With --tolerances it also has P3.x, P3.x.worst, P3.x.rss ....

    Examples:
    mechsim sensitivity four_bar --of B,rocker --to crank,coupler
    mechsim sensitivity slider_crank --of B.x --tolerances crank=0.02mm,rod=0.05mm
    """
    if not options.quantities:
        raise InputError("--of is missing; name the quantities, as in --of P3,rocker,torque")
    parametric = source.load_parametric()
    bounds: Mapping[str, str | float] = parametric.uncertainties
    if options.tolerances is not None:
        bounds = written_tolerances(options.tolerances)
    solver = parametric.make({})
    stated.exclude(["angles", "speed"], "under motion laws", not solver.motion_laws.crank)
    if options.angles is None:
        instants = spread_instants(solver)
    else:
        instants = units.parse_angles(options.angles, "the crank angles")
        warn_about_angles("--angles", options.angles, solver.written.angle)
    moved = MovedFamily(parametric, instants, crank_speed(options.speed or SPEED))
    tolerances = None
    if bounds:
        tolerances = parsed_tolerances(bounds, parametric.dimensions, solver.mechanism, solver.written)
    to = list(tolerances.bounds) if tolerances is not None and options.to == ("all",) else options.to
    table = derivative_table(moved, options.quantities, to)
    study = None if tolerances is None else tolerance_study(table, tolerances)
    if output is not None:
        files.write_table(output, dict(table.columns()) | dict(() if study is None else study.columns()))
    loaded = table.moved.loaded(table.values)
    masses = moved.dynamic_model(solver).masses if loaded else ()
    if loaded:
        note_replaced(solver)

    def text() -> None:
        if study is None:
            _print_derivatives(table)
        else:
            _print_tolerances(study)
        for name, reason in table.left_out.items():
            print_text(f"left out {name}: {reason}")
        print_masses(masses)

    data: dict[str, Any] = {**_as_dict(table, study), "output": output, **masses_in_json(masses)}
    return Result(data, text, files=[output])


def _as_dict(table: Sensitivity, study: ToleranceStudy | None) -> dict[str, Any]:
    """Return a table and a study as plain data."""
    data: dict[str, Any] = {
        "mechanism": table.name,
        "rows": len(table),
        "over": table.moved.over[0],
        "dimensions": {
            name: files.attributes(dimension, "value", "unit") for name, dimension in table.dimensions.items()
        },
        "units": {
            f"{quantity}/{name}": table.unit(quantity, name) for quantity in table.values for name in table.by
        },
        "columns": dict(table.columns()),
        "left_out": table.left_out,
    }
    if study is not None:
        clearances = {joint + CLEARANCE: value for joint, value in study.tolerances.clearances.items()}
        data["tolerances"] = {
            "bounds": {**study.tolerances.bounds, **clearances},
            "quantities": {quantity: _deviations(study, quantity) for quantity in table.values},
        }
    return data


def _deviations(study: ToleranceStudy, quantity: str) -> dict[str, Any]:
    """Return the largest deviation of a quantity over the motion, its position, and the contributions."""
    worst = study.worst(quantity)
    return {
        "unit": study.table.units[quantity],
        "worst": float(worst.max()),
        "at": float(study.table.moved.over[1][int(np.argmax(worst))]),
        "rss": float(study.squares(quantity).max()),
        "deviation": float(study.deviation(quantity).max()),
        "shares": study.shares(quantity),
    }


def _instants(table: Sensitivity) -> tuple[str, float]:
    """Return the heading of a column of instants, and the factor from SI."""
    by, unit = DEGREES.converted("rad" if table.moved.over[0] == "angle" else "s")
    return f"at [{unit}]", 1.0 / by


def _print_derivatives(table: Sensitivity) -> None:
    heading, factor = _instants(table)
    rows: list[tuple[Value, ...]] = []
    for quantity, own in table.values.items():
        largest = float(np.abs(own).max())
        for name, values in table.derivatives(quantity).items():
            i = int(np.argmax(np.abs(values)))
            # 0 if a change as large as the dimension changes the quantity by rounding errors only
            dimension = abs(table.dimensions[name].value) or 1.0
            derivative = without_noise([float(values[i]), largest / dimension])[0]
            instant = factor * float(table.moved.over[1][i])
            rows.append((quantity, name, derivative, table.unit(quantity, name), instant))
    print_table(f"{table.name}: derivatives", ("of", "by", "largest", "unit", heading), rows)


def _print_tolerances(study: ToleranceStudy) -> None:
    """Print the deviation of each quantity and path, and its contributions."""
    heading, factor = _instants(study.table)
    rows: list[tuple[Value, ...]] = []
    for quantity in study.table.values:
        largest = _deviations(study, quantity)
        shares = sorted(largest["shares"].items(), key=lambda pair: -pair[1])[:MAX_SHARES]
        contributions = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares if share > 0.0)
        numbers = (largest["worst"], largest["rss"], largest["deviation"])
        rows.append((quantity, *numbers, largest["unit"], factor * largest["at"], contributions))
    head = ("of", "worst", "rss", "std", "unit", heading, "contributions")
    print_table(f"{study.table.name}: largest deviations, to first order", head, rows)
