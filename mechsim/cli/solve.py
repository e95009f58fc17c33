"""Command `mechsim solve`: a motion in closed form or by loop equations."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from mechsim import files
from mechsim.cli.command import JSON_OPTION, Result, Stated, command, table_file
from mechsim.cli.motion_warnings import AccuracyWarning, limited_swing, loss_of_significance
from mechsim.cli.options import SPEED, ChangePointOption, ModelOptions, require_motion, warn_about_angles
from mechsim.cli.output import SI_UNITS, OutputUnits, Units, output_units, print_table, without_noise
from mechsim.cli.progress import progress
from mechsim.errors import InputError, several
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import revolutions_to
from mechsim.numerics.arrays import Array, unique
from mechsim.numerics.resources import require_memory
from mechsim.units import crank_speed, option, parse_angles

if TYPE_CHECKING:
    from mechsim.io.driver_positions import Poses

# rows of a chunk of the result
CHUNK = 1 << 17
# bytes of memory per number for output as .npz, and as JSON
NPZ_BYTES, JSON_BYTES = 40.0, 160.0
ANGLES, SAMPLES, MAX_SAMPLES = "0:360:5deg", 73, 10_000_000
# rows and columns of the table in a terminal
SHOWN_ROWS, SHOWN_COLUMNS = 25, 6
# suffixes of the columns of velocities and accelerations
RATE_SUFFIXES = {"v", "a", *(f"{rate}{axis}" for rate in "va" for axis in "xyz")}


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveOptions:
    """Instants at which a motion is solved."""

    angles: str | None = option(
        None,
        f"Crank angles start:stop:step, both ends included; a bare number is rad. Default: {ANGLES}, or one "
        "swing within the range of a crank that cannot rotate fully.",
    )
    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    samples: int | None = option(
        None, f"Rows of one turn, or of the motion laws, both ends included. [default: {SAMPLES}]"
    )
    poses: str | None = option(
        None,
        "Table of driver coordinates to solve instead: .csv or .npz, in SI.",
        name="--at",
        metavar="FILE",
    )

    def check(self, solver: KinematicSolver, stated: Stated) -> None:
        """Raise InputError for options that exclude each other."""
        by_poses = "with --at, which determines the rows"
        stated.exclude(["angles", "speed", "samples"], by_poses, self.poses)
        stated.exclude(["angles", "speed"], "under motion laws", not solver.motion_laws.crank)
        stated.exclude(["samples"], "with --angles, which determine the rows", self.angles)
        if self.samples is not None and not 2 <= self.samples <= MAX_SAMPLES:
            raise InputError(f"--samples is {self.samples}; give 2 to {MAX_SAMPLES}")


@dataclass(frozen=True, slots=True)
class SolveTask:
    """Instants to solve, and their solver.

    Attributes:
        solver: solver of the mechanism, assembled for the first instant.
        instants: times under motion laws or in a swing, otherwise crank angles.
        motion_at: instants -> the motion at these instants.
        name: name of the instants in messages.
    """

    solver: KinematicSolver
    instants: Array
    motion_at: Callable[[Array], Motion]
    name: str


@command
def solve(
    source: ModelOptions,
    options: SolveOptions,
    stated: Stated,
    change_point: ChangePointOption = None,
    units: Units = None,
    output: Annotated[str | None, table_file("Motion to write")] = None,
    as_json: JSON_OPTION = False,
) -> Result | None:
    """Solve a mechanism by its closed form, else by loop equations; write .csv or .npz, or print a table.

    Examples:
    mechsim solve four_bar --angles 0:360:5deg --speed 300rpm -o motion.csv
    mechsim solve arm.xml --drive 'left=30deg*sin(2*pi*t)' --samples 101
    """
    stated.exclude(["units"], "with --json, which is in SI, without -o", as_json and output is None)
    solver = source.load_with_policy(change_point)
    if options.poses is not None:
        from mechsim.io.driver_positions import poses_of_table

        options.check(solver, stated)
        poses = poses_of_table(solver, files.read_in_si(options.poses), options.poses)
        return _whole(solver, poses, output, output_units(units, solver))
    require_motion(solver)
    options.check(solver, stated)
    task, shown = _task(solver, options), output_units(units, solver)
    in_terminal = output is None and sys.stdout.isatty()
    if as_json or in_terminal or (output or "").lower().endswith(".npz"):
        numbers = 1.0 + 9.0 * len(solver.mechanism.points) + 3.0 * len(solver.mechanism.joints)
        number_bytes = JSON_BYTES if as_json else NPZ_BYTES
        remedy = "write .csv, which needs no memory"
        require_memory(task.name, len(task.instants) * numbers, number_bytes, remedy)
        return _whole(task.solver, task.motion_at(task.instants), output, shown)
    _in_chunks(task, output, shown)
    return None


def _task(solver: KinematicSolver, options: SolveOptions) -> SolveTask:
    """Return the task: a motion under motion laws, a swing, or crank angles."""
    laws, samples = solver.motion_laws, options.samples or SAMPLES
    if not laws.crank:
        times = np.linspace(0.0, laws.duration, samples)
        return SolveTask(solver, times, lambda t: solver.solve(t=t), f"{samples:,} samples")
    speed = crank_speed(options.speed or SPEED)
    swing = None if options.angles else limited_swing(solver, speed)
    if swing is not None:
        times, swinging = np.linspace(0.0, swing.duration, samples), solver.starting_at(swing.angles)
        name = f"{samples} instants of a swing"
        return SolveTask(swinging, times, lambda t: swinging.solve(*swing.state(t)), name)
    if options.angles or options.samples is None:
        angles = parse_angles(options.angles or ANGLES, "the crank angles")
        warn_about_angles("--angles", options.angles or ANGLES, solver.written.angle)
    else:
        angles = np.linspace(0.0, 2.0 * np.pi, samples)
    if not options.angles:
        # a screw does not return after a revolution
        angles = angles + revolutions_to(solver.mechanism.start)
    start = solver.starting_at(angles, speed)
    return SolveTask(start, angles, lambda q: start.solve(q, speed), f"{len(angles):,} crank angles")


def _columns(motion: "Motion | Poses", shown: OutputUnits | None) -> dict[str, Array]:
    """Return the columns of a motion in units that label them; in SI without labels for None."""
    if shown is None:
        return dict(motion.columns())
    units_of = motion.column_units()
    return {
        shown.label(name, units_of.get(name, "")): values / shown.converted(units_of.get(name, ""))[0]
        for name, values in motion.columns()
    }


def _whole(
    solver: KinematicSolver, motion: "Motion | Poses", output: str | None, shown: OutputUnits | None
) -> Result:
    """Write a motion that is in memory, and return it as the result."""
    few = loss_of_significance(solver, motion) if isinstance(motion, Motion) else None
    if output is not None:
        files.write_table(output, _columns(motion, shown))

    def text() -> None:
        if few is not None:
            few.warn()
        if output is not None:
            typer.echo(f"wrote {several(len(motion), 'row')} to {output}")
        elif sys.stdout.isatty():
            _print_table(solver.name, _columns(motion, shown or SI_UNITS))
        else:
            _print_csv([_columns(motion, shown)])

    data = {"mechanism": solver.name, "rows": len(motion), "output": output}
    data |= {"columns": dict(motion.columns()), "few_digits": few}
    return Result(data, text)


def _in_chunks(task: SolveTask, output: str | None, shown: OutputUnits | None) -> None:
    """Write or print a motion as .csv chunk by chunk, in constant memory."""
    instants, fewest = task.instants, list[AccuracyWarning]()
    # a motion that has no solution as a whole fails before a row is written
    task.motion_at(np.array([instants.min(), instants.max()]))

    def chunks() -> Iterator[dict[str, Array]]:
        for first in range(0, len(instants), CHUNK):
            motion = task.motion_at(instants[first : first + CHUNK])
            if few := loss_of_significance(task.solver, motion):
                fewest.append(few)
            yield _columns(motion, shown)
            report()

    with progress("solve", -(-len(instants) // CHUNK)) as report:
        if output is None:
            _print_csv(chunks())
        else:
            files.write_tables(output, chunks())
    if fewest:
        min(fewest, key=lambda few: few.conditioning).warn()
    if output is not None:
        typer.echo(f"wrote {several(len(instants), 'row')} to {output}")


def _print_csv(tables: Iterable[Mapping[str, Array]]) -> None:
    for index, columns in enumerate(tables):
        if index == 0:
            sys.stdout.write(files.csv_head(columns))
        rows = np.column_stack(list(columns.values()))
        sys.stdout.writelines(",".join(map(repr, row.tolist())) + "\n" for row in rows)


def _print_table(name: str, columns: Mapping[str, Array]) -> None:
    """Print a readable selection: nonzero columns of positions, and evenly spaced rows."""
    values = {
        head: without_noise(column.tolist())
        for head, column in columns.items()
        if head.partition(" ")[0].rpartition(".")[2] not in RATE_SUFFIXES
    }
    shown = [head for head, column in values.items() if any(column)][:SHOWN_COLUMNS]
    count = len(next(iter(columns.values())))
    rows = unique(np.linspace(0, count - 1, min(count, SHOWN_ROWS)).astype(int)).tolist()
    print_table(name, shown, [[values[head][row] for head in shown] for row in rows])
    typer.echo(f"{len(rows)} of {count} rows, {len(shown)} of {len(columns)} columns; -o FILE.csv writes all")
