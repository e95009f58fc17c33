"""Command `mechsim sensitivity`: exact derivatives by dimensions, and what tolerances make of a motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import typer

from mechsim import files, units
from mechsim.cli.declared_options import spread
from mechsim.cli.load_options import MachineOptions, print_masses
from mechsim.cli.options import SPEED, DriveOptions, Json, Model, Output, Sets, family_of, speed_of, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import progress
from mechsim.cli.unit_warnings import asked_angles
from mechsim.errors import InputError
from mechsim.pictures import plots
from mechsim.studies.sensitivity import (
    Loading,
    MovedFamily,
    Sensitivity,
    ToleranceStudy,
    derivative_table,
    instants_of,
    path_bands,
    tolerance_study,
    tolerances_of,
    written_tolerances,
)
from mechsim.studies.sensitivity.tolerance_analysis import SAMPLES, SEED
from mechsim.studies.sensitivity.tolerances import CLEARANCE, DISTRIBUTIONS
from mechsim.units import option

MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitivityOptions:
    """What is asked of a mechanism's quantities."""

    of: tuple[str, ...] = option(
        (),
        "Quantities: points (P3, P3.v), joints (rocker), columns (P3.x, rocker.v, torque, P3.fx), force:P3.",
        read=units.parse_names,
        metavar="Q,...",
    )
    to: tuple[str, ...] = option(
        ("all",),
        "Dimensions: parameters, parts of places as pivot.x; of a file without parameters JOINT.at.x.",
        read=units.parse_names,
        text="all",
        metavar="p,...",
    )
    angles: str | None = option(
        None, "Crank angles start:stop:step, both ends included; a bare number is rad. [default: 0:360:5deg]"
    )
    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    tolerances: str | None = option(
        None,
        "What dimensions may be off by: crank=±0.02mm,...; P3.clearance=0.01mm is a joint's; or a table "
        "dimension,tolerance.",
        metavar="FILE.csv|NAME=BOUND,...",
    )
    distribution: str = option("uniform", f"How dimensions lie in their bounds: {', '.join(DISTRIBUTIONS)}.")
    samples: int = option(SAMPLES, "Mechanisms of Monte Carlo; 0 leaves it out.")
    seed: int = option(SEED, "Of the random numbers.")
    plot: str | None = option(None, "Draw derivatives, or the bands: .svg, .pdf or .png.", metavar="FILE")

    def check(self) -> None:
        """Refuse what cannot be, before any work is done."""
        if not self.of:
            raise InputError("no quantity is asked for; give --of, as in --of P3,rocker,torque")
        if not 0 <= self.samples <= MOST_SAMPLES or self.seed < 0:
            raise InputError(
                f"--samples is {self.samples} and --seed {self.seed}; "
                f"give 0 to {MOST_SAMPLES} samples and a seed from 0"
            )
        if self.tolerances is None and self.distribution != "uniform":
            raise InputError("--distribution is of tolerances, and none are given; add --tolerances")


@spread
def sensitivity(
    model: Model,
    asked: SensitivityOptions,
    acting: MachineOptions,
    driven: DriveOptions,
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Derive quantities by dimensions, exactly; say what tolerances make of them, and who is to blame.

    The table has the columns angle and P3.x/crank ..., derivatives at the same position of the drivers in SI;
    with --tolerances P3.x, P3.x.worst, P3.x.rss ... as well.
    """
    asked.check()
    place = None if output is None else writable(output, ".csv", ".npz")
    picture = None if asked.plot is None else writable(asked.plot, ".svg", ".pdf", ".png")
    family = family_of(model, sets, driven)
    form = family.make({})
    if form.motion_laws is not None and (asked.angles or asked.speed):
        what = "--angles" if asked.angles else "--speed"
        raise InputError(f"{what} is of a crank without a program; leave it out with --drive")
    angles = (
        instants_of(form) if asked.angles is None else units.parse_angles(asked.angles, "the crank angles")
    )
    if asked.angles is not None:
        asked_angles("--angles", asked.angles, form)
    loading = Loading(acting.forces, acting.density, acting.diameter)
    moved = MovedFamily(family, angles, speed_of(asked.speed or SPEED), loading)
    given = None
    if asked.tolerances is not None:
        written = written_tolerances(asked.tolerances)
        given = tolerances_of(written, family.dimensions, form.mechanism, asked.distribution)
    with progress("sensitivity", None, quiet=as_json) as tick:
        to = list(given.bounds) if given is not None and asked.to == ("all",) else asked.to
        table = derivative_table(moved, asked.of, to)
        study = None
        if given is not None:
            study = tolerance_study(table, given, samples=asked.samples, seed=asked.seed, progress=tick)
    if place is not None:
        files.write(place, table if study is None else _Both(table, study))
    if picture is not None:
        plots.write(picture, _drawn(table, study))
    masses = loading.machine(form).masses if table.moved.loaded(table.values) else ()
    if as_json:
        used = {"masses": [one.as_dict() for one in masses]} if masses else {}
        print_json(_told(table, study) | {"output": output, "plot": asked.plot} | used)
        return
    _print(table, study)
    print_masses(masses)
    for name in (output, asked.plot):
        if name is not None:
            typer.echo(f"wrote {name}")


@dataclass(frozen=True, slots=True)
class _Both:
    """Derivatives, and what tolerances make, in one table."""

    table: Sensitivity
    study: ToleranceStudy

    def columns(self) -> Any:
        """Yield all columns, each once."""
        return iter((dict(self.table.columns()) | dict(self.study.columns())).items())


def _told(table: Sensitivity, study: ToleranceStudy | None) -> dict[str, Any]:
    """Return a table and a study as plain data."""
    over, at = table.moved.over
    told: dict[str, Any] = {
        "mechanism": table.name,
        "rows": len(table),
        "over": over,
        "dimensions": {
            name: {"value": one.value, "unit": one.unit} for name, one in table.dimensions.items()
        },
        "units": {
            f"{quantity}/{name}": table.unit(quantity, name) for quantity in table.values for name in table.by
        },
        "columns": dict(table.columns()),
        "left_out": table.left_out,
    }
    if study is None:
        return told
    sampled = study.sampled
    random = None
    if sampled is not None:
        names = ("samples", "solved", "failed", "order", "miss", "seed")
        random = {name: getattr(sampled, name) for name in names}
    clearances = {joint + CLEARANCE: one for joint, one in study.tolerances.clearances.items()}
    told["tolerances"] = {
        "bounds": {**study.tolerances.bounds, **clearances},
        "distribution": study.tolerances.distribution,
        "monte_carlo": random,
        "quantities": {one: _off(study, one, at) for one in table.values},
        "paths": {
            path.point: {"worst": float(path.worst.max()), "rss": float(path.squares.max())}
            for path in path_bands(table, study)
        },
    }
    return told


def _off(study: ToleranceStudy, quantity: str, at: Any) -> dict[str, Any]:
    """Return the largest that a quantity is off by over the motion, where, and the shares."""
    worst = study.worst(quantity)
    told: dict[str, Any] = {
        "unit": study.table.units[quantity],
        "worst": float(worst.max()),
        "at": float(at[int(np.argmax(worst))]),
        "rss": float(study.squares(quantity).max()),
        "deviation": float(study.deviation(quantity).max()),
        "shares": study.shares(quantity),
    }
    random = study.random(quantity)
    if random:
        told |= {"std": float(random["std"].max()), "mean": float(np.abs(random["mean"]).max())}
        told |= {"low": float(random["low"].min()), "high": float(random["high"].max())}
    return told


def _print(table: Sensitivity, study: ToleranceStudy | None) -> None:
    over, at = table.moved.over
    where = "at [rad]" if over == "angle" else "at [s]"
    if study is None:
        rows = [
            (quantity, name, f"{values[i]:.6g}", table.unit(quantity, name), f"{at[i]:.4f}")
            for quantity in table.values
            for name, values in table.of(quantity).items()
            for i in (int(np.argmax(np.abs(values))),)
        ]
        print_table(f"{table.name}: derivatives", ("of", "to", "largest", "unit", where), rows)
    else:
        _print_study(study, where, at)
    for name, why in table.left_out.items():
        typer.echo(f"left out {name}: {why}")


def _print_study(study: ToleranceStudy, where: str, at: Any) -> None:
    rows: list[tuple[str, ...]] = []
    for quantity in study.table.values:
        one = _off(study, quantity, at)
        blame = sorted(one["shares"].items(), key=lambda pair: -pair[1])[:3]
        shares = ", ".join(f"{name} {100.0 * part:.0f} %" for name, part in blame if part > 0.0)
        random = f"{one['std']:.4g}" if "std" in one else ""
        numbers = (f"{one['worst']:.4g}", f"{one['rss']:.4g}", f"{one['deviation']:.4g}", random)
        rows.append((quantity, *numbers, one["unit"], f"{one['at']:.4f}", shares))
    head = ("of", "worst case", "root of squares", "std, linear", "std, random", "unit", where, "shares")
    print_table(f"{study.table.name}: at most off by", head, rows)
    for path in path_bands(study.table, study):
        typer.echo(
            f"path of {path.point}: at most {path.worst.max():.4g} m aside, "
            f"{path.squares.max():.4g} m by root of squares"
        )
    found = study.sampled
    if found is None:
        return
    how = {1: "to first order", 2: "to second order", 0: "each solved"}[found.order]
    checked = f"; {found.solved} of them solved, which differ by {found.miss:.2g} standard deviations at most"
    lost = f"; {found.failed} could not be put together" if found.failed else ""
    typer.echo(
        f"{found.samples} random mechanisms {how}{checked if found.order else lost} (seed {found.seed})"
    )


def _drawn(table: Sensitivity, study: ToleranceStudy | None) -> Any:
    over, at = table.moved.over
    if study is None:
        curves: Mapping[str, Any] = {quantity: table.of(quantity) for quantity in table.values}
        return plots.sensitivity_plot(
            over, at, curves, table.units, {name: one.unit for name, one in table.dimensions.items()}
        )
    bands = {
        one: plots.Band(
            table.units[one],
            study.worst(one),
            study.squares(one),
            study.random(one).get("low"),
            study.random(one).get("high"),
            study.shares(one),
        )
        for one in table.values
    }
    paths = [
        plots.PathBand(path.point, path.positions, path.worst, path.squares)
        for path in path_bands(table, study)
    ]
    return plots.tolerance_plot(plots.ToleranceSheet(over, at, bands, paths))
