"""The command that runs MuJoCo: simulate."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files, simulation
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.record import with_all_joints
from mechsim.cli.declared_options import spread
from mechsim.cli.motion_warnings import digits_in_json, few_digits, swing_of, tell_digits
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
    pair_of,
    scene_of,
    speed_of,
    with_policy,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.output_units import Labelled, Units, output_units
from mechsim.cli.progress import progress
from mechsim.cli.scene_options import CTRL, SceneOptions, plain_settings, user_scene
from mechsim.cli.verdict_text import found_in, in_json, of_crank, tell_findings
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.model.finding import POSITION_TOLERANCE, Outcome
from mechsim.model.motion import select_instants
from mechsim.model.motion_laws import interval_around
from mechsim.model.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation import CrankProfile, Run, Settings
from mechsim.studies.scene import SceneErrors, SceneRun, UserScene, start_error
from mechsim.studies.scene.errors import divergence_reason
from mechsim.studies.scene.settings import PlainSettings
from mechsim.studies.scene.step_sizes import finer
from mechsim.subjects.driver_positions import Poses, driver_path
from mechsim.units import option, parse_angle, parse_length, parse_time

Asked = Annotated[Mapping[str, Any], Settings]
# what is said of a crank alone, and why it is refused beside programs
OF_A_CRANK = ("speed", "turns", "profile", "every")
PROGRAMMED = "is of a crank without a program; leave it out, and give --duration"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What is run, how far and how well."""

    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    turns: float | None = option(None, "Turns of the crank. [default: 1; one swing where it cannot]")
    profile: str | None = option(
        None, "Crank angle over time: .csv or .npz with time, angle.", metavar="FILE"
    )
    at: str | None = option(
        None,
        "Poses instead, each solved by itself: driver coordinates in SI row by row, .csv or .npz.",
        metavar="FILE",
    )
    tolerance: str | None = option(
        None,
        "Bound on the place of any tracked point; a bare number is metres. Chooses the steps; without it the "
        "settings stand, and a ten-thousandth of the stroke is the bound.",
    )
    timestep: str | None = option(None, "Time step, kept exactly; a bare number is seconds.")
    method: str | None = option(
        None,
        "step integrates in time, pose solves each crank angle by itself. By default what is asked for: step "
        "with a tolerance, a time step, an integrator or a constraint setting, else pose.",
        metavar="step|pose",
    )
    every: str | None = option(None, "Crank angle between records, as in 5deg.")
    samples: int | None = option(None, "Rows, both ends included; about 72 a turn if left out.")

    @property
    def bound(self) -> float | None:
        """The tolerance in [m]."""
        return None if self.tolerance is None else parse_length(self.tolerance, "the tolerance")

    def refuse(self, *names: str, because: str) -> None:
        """Refuse options that were given."""
        for name in names:
            if getattr(self, name) is not None:
                raise InputError(f"--{name} {because}")

    def records(self, motion: CrankProfile) -> int | None:
        """Return how many instants after the first are recorded; None where it is not said."""
        if self.every is not None:
            if self.samples is not None:
                raise InputError("both --samples and --every were given; give one of them")
            spacing = parse_angle(self.every, "the angle between records")
            whole = round(motion.turns * simulation.REVOLUTION / abs(spacing)) if spacing else 0
            if whole < 1:
                raise InputError(
                    f"records {self.every} apart do not fit the motion; give an angle above 0 within it"
                )
            return whole
        if self.samples is not None and self.samples < 2:
            raise InputError(f"--samples is {self.samples}; give 2 or more")
        return None if self.samples is None else self.samples - 1


@spread
def simulate(
    model: Model,
    options: RunOptions,
    *,
    asked: Asked,
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
    through: ChangePointOption = None,
    sets: Sets = None,
    units: Units = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Run a mechanism in MuJoCo under a driven crank, or under programs of its drivers."""
    place = None if output is None else writable(output, ".csv", ".npz")
    if ctrl and units is not None:
        raise InputError("--units is of a motion's table; leave it out with --ctrl")
    if ctrl:
        options.refuse(*OF_A_CRANK, "method", because=PROGRAMMED)
        if through is not None:
            raise InputError(f"--change-point {PROGRAMMED}")
        options.refuse("at", because="prescribes joints; leave it out with --ctrl")
        simulate_fed(
            model,
            ctrl,
            driven,
            tolerance=options.bound,
            timestep=options.timestep,
            asked=asked,
            samples=options.samples,
            place=place,
            output=output,
            as_json=as_json,
        )
    drive = with_policy(form_of(model, sets, driven), through)
    model_of, shown = scene_of(scene, cut, drive.forces), output_units(units, drive)
    if options.at is not None:
        run, motion = _posed(drive, options, asked, model_of), None
    else:
        motion = _motion(moving(drive), options)
        run = _run(drive, motion, options, asked, model_of)
    found = found_in(drive, None if motion is None else drive.motion_laws or of_crank(drive, motion))
    lost = None if motion is None or run.motion.broken else few_digits(drive, run.motion)
    # last, for what is refused writes nothing
    if place is not None:
        told = with_all_joints(drive.mechanism, run.motion)
        table = told if motion else Poses(told)
        files.write(place, table if shown is None else Labelled(table, told.column_units(), shown))
    if as_json:
        told = {"mechanism": drive.name, "output": output, "rows": len(run.motion)}
        print_json(run.summary() | told | digits_in_json(lost) | in_json(found))
    else:
        tell_findings(found)
        tell_digits(lost)
        _tell(run, output)
    raise typer.Exit(0 if run.outcome == "passed" else 1)


def _motion(drive: Form, options: RunOptions) -> CrankProfile:
    """Return how the crank turns, or the clock of the programs."""
    motion_laws = drive.motion_laws
    if motion_laws is not None:
        options.refuse(*OF_A_CRANK, because=PROGRAMMED)
        return motion_laws.path_profile
    if options.profile:
        return _profile(options.profile)
    speed = speed_of(options.speed or SPEED)
    swing = swing_of(drive, speed) if options.turns is None else None
    return swing or _turned(drive, speed, 1.0 if options.turns is None else options.turns)


def _run(
    drive: Form, motion: CrankProfile, options: RunOptions, asked: Mapping[str, Any], scene: Scene
) -> Run:
    """Run what moves along its motion."""
    motion_laws, wanted = drive.motion_laws, options.bound
    timestep = _timestep(options.timestep, asked)
    if wanted is not None and (options.timestep or "steps_per_turn" in asked):
        raise InputError("--tolerance chooses the step by itself; leave out --timestep and --steps-per-turn")
    with progress("simulate", None) as tick:
        return simulation.simulate(
            drive,
            profile=motion if motion_laws is None else None,
            motion_laws=motion_laws,
            tolerance=wanted,
            settings=Settings(**asked) if asked else None,
            timestep=timestep,
            method=options.method,  # pyright: ignore[reportArgumentType]
            samples=options.records(motion),
            scene=scene,
            progress=tick,
        )


def _posed(drive: Form, options: RunOptions, asked: Mapping[str, Any], scene: Scene) -> Run:
    """Solve the poses at rows of driver coordinates."""
    options.refuse(*OF_A_CRANK, "samples", because="is of a motion; leave it out with --at")
    options.refuse("tolerance", "timestep", because="is of steps; poses with --at are solved to rounding")
    if options.method == "step" or asked:
        raise InputError("--at solves poses; leave out --method step and settings of steps")
    assert options.at is not None
    rows = driver_path(drive, files.read(options.at), options.at, uniform=True)
    last = max(round(rows.motion_laws.duration), 1)
    run = simulation.simulate(drive, motion_laws=rows.motion_laws, method="pose", samples=last, scene=scene)
    return replace(run, motion=select_instants(run.motion, rows.times.astype(np.intp)), steps=len(rows.times))


def _tell(run: Run, output: str | None) -> None:
    typer.echo(f"{run.outcome}: {_found(run)}")
    if run.note:
        typer.echo(run.note)
    what = "poses" if run.method == "pose" else "steps"
    typer.echo(f"{run.steps} {what} in {run.seconds:.4g} s, by {run.method}")
    if output is not None:
        typer.echo(f"wrote {len(run.motion)} rows to {output}")


def _found(run: Run) -> str:
    if run.outcome == "diverged":
        return run.motion.broken
    return f"places within {run.estimate:.3g} m of the solved poses (bound {run.tolerance:.3g} m)"


def _turned(drive: Form, speed: float, turns: float) -> CrankProfile:
    """Return the crank's motion at constant speed; refuse one that leaves the crank's range."""
    try:
        arcs = drive.crank_range()
    except MobilityError as error:
        if error.outcome != "underdetermined":
            raise
        # how far it can turn no pose says, but a run in time does
        return simulation.constant(speed, turns, drive.mechanism.start)
    if arcs.full or not arcs.arcs:
        return simulation.constant(speed, turns)
    profile = simulation.constant(speed, turns, drive.mechanism.start)
    ends, _, _ = profile.state(np.array([0.0, profile.duration]))
    around = interval_around(arcs, float(ends[0]))
    if around is None or not around[0] <= ends.min() <= ends.max() <= around[1]:
        raise AssemblyError(
            f"{drive.name}: the crank cannot make {turns:g} turns from {ends[0]:.6g} rad: it can stand "
            f"{arcs}; change the dimensions, or give a --profile that stays inside"
        )
    return profile


def _profile(path: str) -> CrankProfile:
    table = files.read(path)
    missing = [column for column in ("time", "angle") if column not in table]
    if missing:
        raise InputError(
            f"{path!r} has no column {', '.join(missing)} (it has {', '.join(table)}); name them so"
        )
    return simulation.table(table["time"], table["angle"])


def _timestep(text: str | None, asked: Mapping[str, Any]) -> float | None:
    """Return the time step asked for in [s]; None where none was."""
    if text is None:
        return None
    if "steps_per_turn" in asked:
        raise InputError("both --timestep and --steps-per-turn were given; give one of them")
    return parse_time(text, "the time step")


def simulate_fed(
    model: str,
    ctrl: list[str],
    driven: DriveOptions,
    *,
    tolerance: float | None,
    timestep: str | None,
    asked: Mapping[str, Any],
    samples: int | None,
    place: Path | None,
    output: str | None,
    as_json: bool,
) -> None:
    """Run a scene, its actuators fed, and say how it ended; the exit code is that of `simulate`."""
    if "drive_inertia" in asked:
        raise InputError("--drive-inertia is of a driven run; with --ctrl leave it out")
    read = pair_of(CTRL)
    pairs = tuple((name, program or "") for name, program in map(read, ctrl))
    scene = user_scene(
        model,
        SceneOptions(
            drive=driven.drive, ctrl=pairs, key=driven.key, track=driven.track, duration=driven.duration
        ),
        driven,
    )
    settings = plain_settings(asked, timestep, float(scene.model.opt.timestep))
    bound = POSITION_TOLERANCE * scene.characteristic_length if tolerance is None else tolerance
    hopeless = bool(_stands_open(scene, bound))
    run, errors, used = finer(scene, settings, bound, fixed=tolerance is None or hopeless, records=samples)
    outcome: Outcome = "diverged" if run.broken else "passed" if errors.closure <= bound else "failed"
    if place is not None:
        files.write_table(place, table_of(run))
    _report_run(scene, run, errors, used, outcome, bound, output, as_json)
    raise typer.Exit(0 if outcome == "passed" else 1)


def table_of(run: SceneRun) -> dict[str, Array]:
    """Return the columns of a run: time, points with velocities, joints, actuators' efforts."""
    scene, model = run.scene, run.model
    table = {"time": run.time}
    velocities = run.velocities
    for k, name in enumerate(scene.tracked):
        for axis, label in enumerate("xyz"):
            table[f"{name}.{label}"] = run.points[:, k, axis]
        for axis, label in enumerate("xyz"):
            table[f"{name}.v{label}"] = velocities[:, k, axis]
    for j, joint in enumerate(scene.mechanism.joints[: model.njnt]):
        if len(joint.coordinates) == 1:
            table[f"{joint.name}.q"] = run.qpos[:, model.jnt_qposadr[j]]
            table[f"{joint.name}.v"] = run.qvel[:, model.jnt_dofadr[j]]
    names = [model.actuator(i).name or f"actuator{i + 1}" for i in range(model.nu)]
    for i, name in enumerate([*names, *scene.joint_laws]):
        table[f"effort:{name}"] = run.forces[:, i]
    return table


def _stands_open(scene: UserScene, bound: float) -> str:
    """Say how far the loops of a scene stand open at its start, where no step can mend that; else nothing."""
    gap = start_error(scene)
    if gap <= bound:
        return ""
    return (
        f"the loops stand open by {gap:.2g} m where the file starts, which no step mends; give more digits "
        "there, or let `mechsim tune` write a keyframe that is closed"
    )


def _report_run(
    scene: UserScene,
    run: SceneRun,
    errors: SceneErrors,
    used: PlainSettings,
    outcome: str,
    bound: float,
    output: str | None,
    as_json: bool,
) -> None:
    note = divergence_reason(run) if run.broken else _stands_open(scene, bound)
    if as_json:
        print_json(
            {
                "outcome": outcome,
                "tolerance": bound,
                "estimate": errors.closure if np.isfinite(errors.closure) else None,
                "steps": run.steps,
                "seconds": run.seconds,
                "method": "step",
                "note": note,
                "settings": used.as_dict() | {"timestep": float(run.model.opt.timestep)},
                "mechanism": scene.mechanism.name,
                "output": output,
                "rows": len(run.time),
            }
        )
        return
    if run.broken:
        typer.echo(f"{outcome}: {run.broken}: {note}")
    else:
        typer.echo(
            f"{outcome}: points within {errors.closure:.3g} m of the exact closure at the run's own drivers "
            f"(bound {bound:.3g} m)"
        )
        if note:
            typer.echo(note)
    typer.echo(f"{run.steps} steps in {run.seconds:.4g} s, in plain MuJoCo")
    if output is not None:
        typer.echo(f"wrote {len(run.time)} rows to {output}")
