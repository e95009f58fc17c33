"""Command `mechsim solve`: a motion in closed form or by loop equations."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer

from mechsim import files
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.cli.declared_options import spread
from mechsim.cli.motion_warnings import FewDigits, digits_in_json, few_digits, swing_of, tell_digits, worse
from mechsim.cli.options import (
    SPEED,
    ChangePointOption,
    DriveOptions,
    Json,
    Model,
    Output,
    Sets,
    form_of,
    moving,
    speed_of,
    with_policy,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.output_units import Labelled, OutputUnits, Units, output_units
from mechsim.cli.progress import Tick, progress
from mechsim.cli.unit_warnings import asked_angles
from mechsim.errors import InputError
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import require_memory
from mechsim.subjects.driver_positions import Poses, poses_of_table
from mechsim.units import option, parse_angles

# times or crank angles -> the motion there
Solved = Callable[[Array], Motion]
# crank angles solved in one go where the results leave part by part
PART = 1 << 17
# bytes held for each number that is written as .npz, and as JSON
PACKED, AS_JSON = 40.0, 160.0
ANGLES, SAMPLES = "0:360:5deg", 73
MOST_SAMPLES = 10_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveOptions:
    """At which instants a motion is solved."""

    angles: str | None = option(
        None,
        f"Crank angles start:stop:step, both ends included; a bare number is rad. [default: {ANGLES}; one "
        "swing within the reachable range of a crank that cannot]",
    )
    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    samples: int = option(SAMPLES, "Rows of a motion under programs, both ends included.")
    at: str | None = option(
        None, "Poses instead: driver coordinates in SI row by row, .csv or .npz.", metavar="FILE"
    )

    def check(self, drive: Form) -> None:
        """Refuse what does not go together."""
        if (self.angles or self.speed) and (drive.motion_laws or self.at):
            what = "--angles" if self.angles else "--speed"
            raise InputError(f"{what} is of a crank without a program; leave it out with --drive and --at")
        if not 2 <= self.samples <= MOST_SAMPLES:
            raise InputError(f"--samples is {self.samples}; give 2 to {MOST_SAMPLES}")


@spread
def solve(
    model: Model,
    asked: SolveOptions,
    driven: DriveOptions,
    through: ChangePointOption = None,
    sets: Sets = None,
    units: Units = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Solve a mechanism by its closed form, else by loop equations; write .csv or .npz, or print a table."""
    place = None if output is None else writable(output, ".csv", ".npz")
    drive = with_policy(form_of(model, sets, driven), through)
    asked.check(drive)
    shown = output_units(units, drive)
    if asked.at is not None:
        _told(drive, poses_of_table(drive, files.read(asked.at), asked.at), place, as_json, shown)
        return
    moving(drive)
    drive, instants, solved, what = _instants(drive, asked)
    if as_json or (place is not None and place.suffix.lower() == ".npz"):
        numbers = len(instants) * (
            1.0 + 9.0 * len(drive.mechanism.points) + 3.0 * len(drive.mechanism.joints)
        )
        require_memory(what, numbers, AS_JSON if as_json else PACKED, "write .csv, which needs no memory")
        _told(drive, solved(instants), place, as_json, shown)
        return
    if not isinstance(drive, ClosedForm):
        # loop equations that cannot be followed over the whole motion are rejected before a row is written
        solved(np.array([instants.min(), instants.max()]))
    lost: list[FewDigits | None] = [None]
    with progress("solve", -(-len(instants) // PART)) as tick:
        parts = _parts(drive, instants, solved, tick, lost)
        labelled = (_labelled(part, shown) for part in parts)
        if place is not None:
            files.write_records(place, labelled)
        else:
            _print(labelled)
    tell_digits(lost[0])
    if place is not None:
        typer.echo(f"wrote {len(instants)} rows to {place}")


def _instants(drive: Form, asked: SolveOptions) -> tuple[Form, Array, Solved, str]:
    """Return what moves, times under motion laws or else crank angles, what solves there, and their name."""
    motion_laws = drive.motion_laws
    if motion_laws is not None:
        times = np.linspace(0.0, motion_laws.duration, asked.samples)
        return drive, times, lambda part: drive.solve(t=part), f"{asked.samples:,} samples"
    speed = speed_of(asked.speed or SPEED)
    swing = None if asked.angles else swing_of(drive, speed)
    if swing is not None:
        swung = drive.starting_at(swing.angles)
        times = np.linspace(0.0, swing.duration, SAMPLES)
        return swung, times, lambda part: swung.solve(*swing.state(part)), f"{SAMPLES} instants of a swing"
    angles = parse_angles(asked.angles or ANGLES, "the crank angles")
    asked_angles("--angles", asked.angles or ANGLES, drive)
    start = drive.starting_at(angles, speed)
    return start, angles, lambda part: start.solve(part, speed), f"{len(angles):,} crank angles"


def _labelled(found: Motion | Poses, shown: OutputUnits | None) -> files.Tabled:
    return found if shown is None else Labelled(found, found.column_units(), shown)


def _told(
    drive: Form, found: Motion | Poses, place: Path | None, as_json: bool, shown: OutputUnits | None
) -> None:
    """Write, print or tell in JSON what was found as a whole."""
    output = None if place is None else str(place)
    lost = few_digits(drive, found) if isinstance(found, Motion) else None
    if place is not None:
        files.write(place, _labelled(found, shown))
    if as_json:
        columns = dict(found.columns())
        told = {"mechanism": drive.name, "rows": len(found), "output": output, "columns": columns}
        print_json(told | digits_in_json(lost))
        return
    tell_digits(lost)
    if place is None:
        _print(iter([_labelled(found, shown)]))
    else:
        typer.echo(f"wrote {len(found)} rows to {output}")


def _parts(
    drive: Form, instants: Array, solved: Solved, tick: Tick, lost: list[FewDigits | None]
) -> Iterator[Motion]:
    """Yield the motion part by part; put into the list of one where it has the fewest digits so far."""
    for first in range(0, len(instants), PART):
        part = solved(instants[first : first + PART])
        lost[0] = worse(lost[0], few_digits(drive, part))
        yield part
        tick()


def _print(parts: Iterator[files.Tabled]) -> None:
    for number, part in enumerate(parts):
        columns = dict(part.columns())
        if number == 0:
            sys.stdout.write(files.csv_head(columns))
        rows = np.column_stack(list(columns.values()))
        sys.stdout.writelines(",".join(map(repr, row.tolist())) + "\n" for row in rows)
