"""Command `mechsim fit`: dimensions from measured motion, with their uncertainty."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from mechsim import files, units
from mechsim.cli.declared_options import spread
from mechsim.cli.load_options import MachineOptions
from mechsim.cli.options import SPEED, DriveOptions, Json, Model, Output, Sets, family_of, speed_of, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import progress
from mechsim.errors import InputError
from mechsim.studies.fit import Fit, MeasuredMotion, fit_dimensions, measured_of, single
from mechsim.studies.sensitivity import Loading, MovedFamily
from mechsim.units import option


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """What was measured, and what is to be found."""

    to: str | None = option(
        None,
        "Measured motion: columns angle (or t), P3.x, rocker.q ... in SI or with a unit, as P3.x [mm]; P3.x± "
        "holds standard deviations.",
        metavar="FILE.csv",
    )
    vary: tuple[str, ...] = option((), "Dimensions to find.", read=units.parse_names, metavar="p,...")
    offset: bool = option(
        False, "The zero of the crank's encoder is unknown, too: find CRANK.offset.", name="--offset"
    )
    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")

    def check(self) -> str:
        """Return the table; refuse what is not said."""
        if self.to is None:
            raise InputError("no measured motion is given; name a table with --to FILE.csv")
        if not self.vary:
            raise InputError("no dimension is to be found; name some, as in --vary crank,coupler")
        return self.to


@spread
def fit(
    model: Model,
    asked: FitOptions,
    acting: MachineOptions,
    driven: DriveOptions,
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Find dimensions from measured motion, with their uncertainty; say which cannot be told apart.

    It begins from the dimensions as they stand: give others with --set. -o writes what was found as .json, or
    measured and fitted quantities row by row as .csv.
    """
    table = asked.check()
    place = None if output is None else writable(output, ".json", ".csv", ".npz")
    family = family_of(model, sets, driven)
    form = family.make({})
    measured = measured_of(files.read(table), form, table)
    loading = Loading(acting.forces, acting.density, acting.diameter)
    moved = MovedFamily(family, measured.angles, speed_of(asked.speed or SPEED), loading)
    with progress("fit", None, quiet=as_json) as tick:
        found = fit_dimensions(moved, measured, asked.vary, offset=asked.offset, progress=tick)
    told = _told(found, measured) | {"output": output}
    if place is not None:
        _write(place, found, measured, told)
    if as_json:
        print_json(told)
    else:
        _print(found, measured)
        if output is not None:
            typer.echo(f"wrote {output}")
    raise typer.Exit(0 if found.outcome == "fitted" else 1)


def _write(place: Path, found: Fit, measured: MeasuredMotion, told: dict[str, Any]) -> None:
    if place.suffix.lower() == ".json":
        files.write_json(place, told)
        return
    table = {found.moved.over[0]: measured.over}
    named = single(measured.values, found.moved)
    fitted = found.moved.values([*named.values()], {})
    for name, values in measured.values.items():
        own = fitted[named[name]]
        table |= {name: values, f"{name}.fit": own, f"{name}.left": own - values}
    files.write_table(place, table)


def _told(found: Fit, measured: MeasuredMotion) -> dict[str, Any]:
    """Return a fit as plain data."""
    within = found.within()
    return {
        "mechanism": found.moved.family.name,
        "outcome": found.outcome,
        "dimensions": {
            name: {
                "value": value,
                "deviation": found.deviations.get(name),
                "within_95": within.get(name),
                "start": found.start[name],
                "unit": found.units[name],
            }
            for name, value in found.values.items()
        },
        "covariance": found.covariance.tolist(),
        "correlations": {f"{a}, {b}": one for (a, b), one in found.correlations.items()},
        "not_told_apart": [list(group) for group in found.together],
        "rms": dict(found.rms),
        "spread": found.spread,
        "weighed": found.weighed,
        "condition": found.condition,
        "rows": len(measured.angles),
        "numbers": measured.count,
        "tried": found.tried,
    }


def _print(found: Fit, measured: MeasuredMotion) -> None:
    within = found.within()
    rows = [
        (
            name,
            f"{value:.9g}",
            f"{found.deviations[name]:.2g}" if name in found.deviations else "not told",
            f"{within[name]:.2g}" if name in within else "not told",
            f"{found.start[name]:.9g}",
            found.units[name],
        )
        for name, value in found.values.items()
    ]
    head = ("dimension", "found", "± (1 sigma)", "± (95 %)", "begun from", "unit")
    print_table(f"{found.moved.family.name}: {found.outcome}", head, rows)
    for group in found.together:
        told = f"cannot be told apart by what was measured: {', '.join(group)}; hold one, or measure more"
        typer.echo(told if len(group) > 1 else f"nothing that was measured depends on {', '.join(group)}")
    strongest = max(found.correlations.items(), key=lambda pair: abs(pair[1]), default=None)
    if strongest is not None:
        (a, b), value = strongest
        typer.echo(f"strongest correlation {value:.3f}, of {a} and {b}; condition {found.condition:.3g}")
    rms = ", ".join(f"{name} {value:.3g}" for name, value in found.rms.items())
    typer.echo(f"left of {measured.count} numbers, root mean square: {rms}")
    if found.weighed:
        typer.echo(f"that is {found.spread:.3g} of the deviations given; about 1 where these are true")
