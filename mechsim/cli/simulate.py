"""The command that runs MuJoCo: simulate."""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files, simulation, units
from mechsim.analytic.forms import Form
from mechsim.cli.declared_options import spread
from mechsim.cli.fed_scene import simulate_fed
from mechsim.cli.options import (
    SPEED,
    DriveOptions,
    Json,
    Model,
    Output,
    Sets,
    SpeedIfAny,
    ThroughChange,
    forces_of,
    form_of,
    moving,
    passed,
    programs_of,
    scene_of,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json, progress
from mechsim.cli.scene_findings import found_in, in_json, of_crank, tell_findings
from mechsim.errors import AssemblyError, InputError
from mechsim.model.crank_profile import arc_around
from mechsim.simulation import CrankProfile, Run, Settings

Asked = Annotated[Mapping[str, Any], Settings]


@spread
def simulate(
    model: Model,
    *,
    speed: SpeedIfAny = None,
    turns: Annotated[float | None, typer.Option(help="Turns of the crank. [default: 1]")] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Bound on the place of any tracked point; a bare number is metres. Chooses the steps; "
            "without it the settings stand, and a ten-thousandth of the stroke is the bound."
        ),
    ] = None,
    timestep: Annotated[str | None, typer.Option(help="Time step; a bare number is seconds.")] = None,
    asked: Asked,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="step|pose",
            help="step integrates in time, pose solves each crank angle by itself. By default what is asked "
            "for: step with a tolerance, a time step, an integrator or a constraint setting, else pose.",
        ),
    ] = None,
    profile: Annotated[
        str | None, typer.Option(metavar="FILE", help="Crank angle over time: .csv or .npz with time, angle.")
    ] = None,
    every: Annotated[str | None, typer.Option(help="Crank angle between records, as in 5deg.")] = None,
    samples: Annotated[
        int | None, typer.Option(help="Rows, both ends included; about 72 a turn if left out.")
    ] = None,
    scene: Annotated[str, typer.Option(help="pose, motion, dynamics or picture.")] = "motion",
    cut: Annotated[str | None, typer.Option(help="Joints at which to cut the loops, with commas.")] = None,
    driven: DriveOptions,
    ctrl: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR=PROGRAM",
            help="Feed an actuator of an MJCF file, in its control's own unit: a number, 0.3*sin(2*pi*t), "
            "FILE.csv. The file is then stepped as it is, but for settings asked for; --drive prescribes.",
        ),
    ] = None,
    through: ThroughChange = None,
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Run a mechanism in MuJoCo under a driven crank, or under programs of its drivers."""
    place = None if output is None else writable(output, ".csv", ".npz")
    wanted = None if tolerance is None else units.parse_length(tolerance, "the tolerance")
    if ctrl:
        _require_no_crank(
            speed=speed, turns=turns, profile=profile, every=every, method=method, through=through
        )
        simulate_fed(
            model,
            ctrl,
            driven,
            tolerance=wanted,
            timestep=timestep,
            asked=asked,
            samples=samples,
            place=place,
            output=output,
            as_json=as_json,
        )
    drive = passed(moving(form_of(model, sets, driven)), through)
    programs = programs_of(drive)
    if programs is None:
        steady = speed_of(speed or SPEED)
        motion = _profile(profile) if profile else _turned(drive, steady, 1.0 if turns is None else turns)
    else:
        _require_no_crank(speed=speed, turns=turns, profile=profile, every=every)
        motion = programs.clock
    settings = _settings(motion, timestep, asked)
    if wanted is not None and (timestep or "steps_per_turn" in asked):
        raise InputError("--tolerance chooses the step by itself; leave out --timestep and --steps-per-turn")
    if samples is not None:
        if every is not None or samples < 2:
            raise InputError(f"--samples is {samples}; give 2 or more, and leave out --every")
        samples -= 1
    if every is not None:
        spacing = units.parse_angle(every, "the angle between records")
        whole = round(motion.turns * simulation.TURN / abs(spacing)) if spacing else 0
        if whole < 1:
            raise InputError(f"records {every} apart do not fit the motion; give an angle above 0 within it")
        samples = whole
    with progress("simulate", None) as tick:
        run = simulation.simulate(
            drive,
            profile=motion if programs is None else None,
            programs=programs,
            tolerance=wanted,
            settings=settings,
            method=method,  # pyright: ignore[reportArgumentType]
            samples=samples,
            scene=scene_of(scene, cut, forces_of(drive)),
            watch=tick,
        )
    if place is not None:
        files.write(place, run.motion)
    scene_findings = found_in(drive, programs or of_crank(drive, motion))
    if as_json:
        told = {"mechanism": drive.name, "output": output, "rows": len(run.motion)}
        print_json(run.summary() | told | in_json(scene_findings))
    else:
        tell_findings(scene_findings)
        typer.echo(f"{run.outcome}: {_found(run)}")
        if run.note:
            typer.echo(run.note)
        what = "poses" if run.method == "pose" else "steps"
        typer.echo(f"{run.steps} {what} in {run.seconds:.4g} s, by {run.method}")
        if place is not None:
            typer.echo(f"wrote {len(run.motion)} rows to {output}")
    raise typer.Exit(0 if run.outcome == "met" else 1)


def _found(run: Run) -> str:
    if run.outcome == "diverged":
        return run.motion.broken
    return f"places within {run.estimate:.3g} m of the solved poses (bound {run.tolerance:.3g} m)"


def _require_no_crank(**given: object) -> None:
    """Refuse what is said of a crank beside programs."""
    for name, value in given.items():
        if value is not None:
            raise InputError(f"--{name} is of a crank without a program; leave it out, and give --duration")


def _turned(drive: Form, speed: float, turns: float) -> CrankProfile:
    """Return the crank's motion at constant speed; refuse one that leaves the crank's range."""
    arcs = drive.crank_range()
    if arcs.full or not arcs.arcs:
        return simulation.constant(speed, turns)
    profile = simulation.constant(speed, turns, drive.mechanism.start)
    ends, _, _ = profile.state(np.array([0.0, profile.duration]))
    around = arc_around(arcs, float(ends[0]))
    if around is None or not around[0] <= ends.min() <= ends.max() <= around[1]:
        raise AssemblyError(
            f"{drive.name}: the crank cannot make {turns:g} turns from {ends[0]:.6g} rad: it can stand "
            f"{arcs}; change the dimensions, or give a --profile that stays inside"
        )
    return profile


def _profile(path: str) -> CrankProfile:
    from mechsim import files, simulation
    from mechsim.errors import InputError

    table = files.read(path)
    missing = [column for column in ("time", "angle") if column not in table]
    if missing:
        raise InputError(
            f"{path!r} has no column {', '.join(missing)} (it has {', '.join(table)}); name them so"
        )
    return simulation.table(table["time"], table["angle"])


def _settings(profile: CrankProfile, timestep: str | None, asked: Mapping[str, Any]) -> Settings | None:
    """Return the settings asked for; None where none was."""
    if timestep is None:
        return Settings(**asked) if asked else None
    if "steps_per_turn" in asked:
        raise InputError("both --timestep and --steps-per-turn were given; give one of them")
    steps = simulation.check_step(units.parse_time(timestep, "the time step"), profile)
    return Settings(steps_per_turn=steps, **asked)
