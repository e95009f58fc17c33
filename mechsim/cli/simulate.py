"""The command that runs MuJoCo: simulate."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.options import Json, Name, Output, Sets, Speed, drive_of, scene_of, speed_of, writable
from mechsim.cli.output import print_json, progress

if TYPE_CHECKING:
    from mechsim.simulation import CrankProfile, Run, Settings


def simulate(
    name: Name,
    speed: Speed = "600rpm",
    turns: Annotated[float, typer.Option(help="Turns of the crank.")] = 1.0,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Bound on the place of any tracked point; a bare number is metres. Chooses the steps; "
            "without it the settings stand, and a thousandth of the longest link is the bound."
        ),
    ] = None,
    timestep: Annotated[str | None, typer.Option(help="Time step; a bare number is seconds.")] = None,
    steps_per_turn: Annotated[int | None, typer.Option(help="Steps in a turn of the crank.")] = None,
    integrator: Annotated[
        str | None, typer.Option(help="Euler, implicitfast, implicit, RK4 or discrete.")
    ] = None,
    solref: Annotated[
        str | None, typer.Option(help="Two numbers with a comma, as MuJoCo takes them.")
    ] = None,
    solimp: Annotated[
        str | None, typer.Option(help="Two to five numbers with commas, as MuJoCo takes them.")
    ] = None,
    hardness: Annotated[
        float | None, typer.Option(help="Factor on constraint softness; 1 is MuJoCo's own.")
    ] = None,
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
    scene: Annotated[str, typer.Option(help="pose, motion, dynamics or picture.")] = "motion",
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Run a mechanism in MuJoCo under a driven crank."""
    from mechsim import files, simulation, units
    from mechsim.errors import InputError

    place = None if output is None else writable(output, ".csv", ".npz")
    drive = drive_of(name, sets)
    wanted = None if tolerance is None else units.parse_length(tolerance, "the tolerance")
    asked = speed_of(speed)
    motion = _profile(profile) if profile else simulation.constant(asked, turns)
    settings = _settings(motion, timestep, steps_per_turn, integrator, solref, solimp, hardness)
    if wanted is not None and (timestep or steps_per_turn):
        raise InputError("--tolerance chooses the step by itself; leave out --timestep and --steps-per-turn")
    samples = None
    if every is not None:
        spacing = units.parse_angle(every, "the angle between records")
        whole = round(motion.turns * simulation.TURN / abs(spacing)) if spacing else 0
        if whole < 1:
            raise InputError(f"records {every} apart do not fit the motion; give an angle above 0 within it")
        samples = whole
    if profile is None:
        _within_range(drive, turns)
    with progress("simulate", None) as tick:
        run = simulation.simulate(
            drive.mechanism,
            profile=motion,
            tolerance=wanted,
            settings=settings,
            method=method,  # pyright: ignore[reportArgumentType]
            samples=samples,
            scene=scene_of(scene),
            watch=tick,
        )
    if place is not None:
        files.write(place, run.motion)
    if as_json:
        print_json(run.summary() | {"mechanism": name, "output": output, "rows": len(run.motion)})
    else:
        typer.echo(f"{run.outcome}: {_found(run)}")
        what = "poses" if run.method == "pose" else "steps"
        typer.echo(f"{run.steps} {what} in {run.seconds:.4g} s, by {run.method}")
        if place is not None:
            typer.echo(f"wrote {len(run.motion)} rows to {output}")
    raise typer.Exit(0 if run.outcome == "met" else 1)


def _found(run: "Run") -> str:
    if run.outcome == "diverged":
        return run.motion.broken
    return f"places within {run.estimate:.3g} m of the solved poses (bound {run.tolerance:.3g} m)"


def _within_range(drive: Any, turns: float) -> None:
    """Refuse to drive a crank round that cannot turn fully."""
    from mechsim.errors import AssemblyError

    arcs = drive.crank_range()
    if not arcs.full and arcs.arcs:
        raise AssemblyError(
            f"{drive.name}: the crank cannot make {turns:g} turns: it can stand {arcs}; "
            "change the dimensions, or give a --profile that stays inside"
        )


def _profile(path: str) -> "CrankProfile":
    from mechsim import files, simulation
    from mechsim.errors import InputError

    table = files.read(path)
    missing = [column for column in ("time", "angle") if column not in table]
    if missing:
        raise InputError(
            f"{path!r} has no column {', '.join(missing)} (it has {', '.join(table)}); name them so"
        )
    return simulation.table(table["time"], table["angle"])


def _settings(
    profile: "CrankProfile",
    timestep: str | None,
    steps_per_turn: int | None,
    integrator: str | None,
    solref: str | None,
    solimp: str | None,
    hardness: float | None,
) -> "Settings | None":
    """Return the settings asked for; None where none was."""
    from mechsim import simulation, units
    from mechsim.errors import InputError

    asked: dict[str, Any] = {}
    if timestep is not None and steps_per_turn is not None:
        raise InputError("both --timestep and --steps-per-turn were given; give one of them")
    if timestep is not None:
        asked["steps_per_turn"] = simulation.check_step(units.parse_time(timestep, "the time step"), profile)
    if steps_per_turn is not None:
        asked["steps_per_turn"] = steps_per_turn
    if integrator is not None:
        asked["integrator"] = integrator
    if hardness is not None:
        asked["hardness"] = hardness
    if solref is not None:
        asked["solref"] = _numbers("solref", solref, 2, 2)
    if solimp is not None:
        given = _numbers("solimp", solimp, 2, 5)
        asked["solimp"] = given + (0.9999, 0.9999, 0.001, 0.5, 2.0)[len(given) :]
    return simulation.Settings(**asked) if asked else None


def _numbers(name: str, text: str, least: int, most: int) -> tuple[float, ...]:
    from mechsim import units
    from mechsim.errors import InputError

    values = units.parse_vector(text, "1", f"--{name}")
    if not least <= len(values) <= most:
        wanted = str(least) if least == most else f"{least} to {most}"
        raise InputError(f"--{name} is {text!r}, {len(values)} numbers; give {wanted}, with commas")
    return values
