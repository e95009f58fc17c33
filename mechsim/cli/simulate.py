"""Command `mechsim simulate`: a mechanism or a user's MJCF scene in MuJoCo."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files
from mechsim.cli.command import Result, Stated, command, table_file
from mechsim.cli.finding_text import findings_in_json, print_finding_lines
from mechsim.cli.motion_warnings import known_crank_range, limited_swing, loss_of_significance
from mechsim.cli.options import SPEED, ChangePointOption, ControlOptions, ModelOptions, require_motion
from mechsim.cli.output import number, print_text
from mechsim.cli.progress import progress
from mechsim.cli.verdict_text import headline
from mechsim.errors import AssemblyError, InputError, several
from mechsim.io.driver_positions import Poses, driver_path
from mechsim.io.scene_findings import scene_findings
from mechsim.io.simulate_by_name import simulate as run_in_mujoco
from mechsim.kinematics.loops.record import with_all_joints
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import select_instants
from mechsim.mechanism.motion_laws import (
    CrankProfile,
    constant,
    interval_around,
    make_motion_laws,
    revolutions_to,
)
from mechsim.mechanism.scene import Scene
from mechsim.simulation.run import Run
from mechsim.simulation.settings import SettingOptions, Settings, plain_settings
from mechsim.studies.motions import driven_as
from mechsim.units import crank_speed, option, parse_time, parse_tolerance

# options without an effect on a file that is stepped under controls
WITHOUT_CONTROLS = ("change_point", "sets", "poses", "method", "drive_inertia")
# options of time steps
OF_STEPS = ("timestep", *(field.name for field in fields(SettingOptions)))
# options that apply to a crank only and are invalid with motion laws
CRANK_OPTIONS = ("speed", "turns")
UNDER_LAWS = "under motion laws, whose time is --duration"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Motion, duration and accuracy of a run."""

    speed: str | None = option(None, f"Crank speed; a bare number is rad/s. [default: {SPEED}]")
    turns: float | None = option(None, "Turns of the crank. [default: 1, or one swing within its range]")
    poses: str | None = option(
        None,
        "Table of driver coordinates whose configurations MuJoCo solves: .csv or .npz, in SI.",
        name="--at",
        metavar="FILE",
    )
    tolerance: str | None = option(
        None,
        "Tolerance on the position of any tracked point; a bare number is metres. It determines the steps; "
        "without it the settings do, and the tolerance is 1e-4 of the stroke.",
    )
    timestep: str | None = option(None, "Time step, kept exactly; a bare number is seconds.")
    method: str | None = option(
        None,
        "step integrates in time, pose solves each crank angle by itself. Default: step with a tolerance, a "
        "time step, an integrator or a constraint setting, else pose.",
        metavar="step|pose",
    )
    samples: int | None = option(None, "Rows, both ends included. Default: about 72 a turn.")

    @property
    def tolerance_in_metres(self) -> float | None:
        """The tolerance in [m]."""
        return None if self.tolerance is None else parse_tolerance(self.tolerance)

    def __post_init__(self) -> None:
        if self.samples is not None and self.samples < 2:
            raise InputError(f"--samples is {self.samples}; give 2 or more")


@command
def simulate(
    source: ModelOptions,
    options: RunOptions,
    *,
    stated: Stated,
    setting: SettingOptions,
    controls: ControlOptions,
    change_point: ChangePointOption = None,
    output: Annotated[str | None, table_file("Motion to write")] = None,
) -> Result:
    """Run a mechanism in MuJoCo under a driven crank, or under motion laws of its drivers.

    Examples:
    mechsim simulate four_bar --speed 600rpm --turns 2 --tolerance 1um
    mechsim simulate gripper.xml --ctrl 'fingers=120*sin(t)' -o run.csv
    """
    settings = setting.stated()
    if controls.ctrl:
        stated.exclude(WITHOUT_CONTROLS, "with --ctrl, which runs the file as it is")
        stated.exclude(["lock"], "as `others` with --ctrl, which runs the file as it is", source.locks_others)
        from mechsim.cli.scene_run import run_under_controls, user_scene

        stated.exclude(CRANK_OPTIONS, UNDER_LAWS)
        controlled = user_scene(source.model, source, controls)
        plain = plain_settings(settings, options.timestep, float(controlled.model.opt.timestep))
        return run_under_controls(controlled, plain, options.tolerance_in_metres, options.samples, output)
    stated.exclude(OF_STEPS, "with --method pose, which takes no steps", options.method == "pose")
    solver = source.load_with_policy(change_point)
    motion = _motion(solver, options, stated)
    if motion is None:
        run, laws = _poses(solver, options), None
    else:
        run = _run(solver, motion, options, settings)
        laws = None if solver.motion_laws.crank else solver.motion_laws
        if solver.source is not None and laws is None:
            # the motion of the crank of an MJCF file as a motion law
            states = {solver.mechanism.drivers[0]: motion.state}
            laws = make_motion_laws(solver.mechanism, states, motion.duration)
    findings = scene_findings(solver, laws)
    few = None if motion is None or run.motion.broken else loss_of_significance(solver, run.motion)
    # the file is written last, so that invalid input writes nothing
    if output is not None:
        joints = with_all_joints(solver.mechanism, run.motion)
        table = joints if motion else Poses(joints)
        files.write_table(output, dict(table.columns()))

    method, unit = ("solved poses",) * 2 if run.method == "pose" else ("stepped", "time steps")

    def text() -> None:
        print_finding_lines(findings)
        if few is not None:
            few.warn()
        if run.outcome == "diverged":
            print_text(f"diverged: {run.motion.broken}")
        else:
            typer.echo(headline(f"{solver.name}  MuJoCo, {method}", run.outcome == "passed"))
            print_text(
                f"  points within {number(run.estimate, 3)} m of the solved poses "
                f"(tolerance {number(run.tolerance, 3)} m)"
            )
        print_text(run.note)
        typer.echo(f"  {run.steps} {unit} in {number(run.seconds)} s")
        if output is not None:
            typer.echo(f"wrote {several(len(run.motion), 'row')} to {output}")

    data = run.summary() | {"mechanism": solver.name, "output": output, "rows": len(run.motion)}
    data |= {"few_digits": few} | findings_in_json(findings)
    return Result(data, text, run.outcome == "passed")


def _motion(solver: KinematicSolver, options: RunOptions, stated: Stated) -> CrankProfile | None:
    """Return the motion of the crank, or the path parameter of motion laws; None for a table of poses."""
    if options.poses is not None:
        stated.exclude((*CRANK_OPTIONS, *OF_STEPS, "samples", "tolerance"), "with --at, which solves poses")
        return None
    laws = require_motion(solver).motion_laws
    if not laws.crank:
        stated.exclude(CRANK_OPTIONS, UNDER_LAWS)
        return laws.path_profile
    speed = crank_speed(options.speed or SPEED)
    swing = limited_swing(solver, speed) if options.turns is None else None
    return swing or _constant_speed(solver, speed, 1.0 if options.turns is None else options.turns)


def _run(
    solver: KinematicSolver, motion: CrankProfile, options: RunOptions, settings: Mapping[str, Any]
) -> Run:
    """Run a mechanism along its motion."""
    tolerance, timestep = options.tolerance_in_metres, None
    if options.timestep is not None:
        if "steps_per_turn" in settings:
            raise InputError("both --timestep and setting steps_per_turn were given; give one of them")
        timestep = parse_time(options.timestep, "the time step")
    if tolerance is not None and (timestep is not None or "steps_per_turn" in settings):
        raise InputError("--tolerance chooses the step by itself; leave out --timestep and steps_per_turn")
    with progress("simulate", None) as report:
        return run_in_mujoco(
            solver,
            **driven_as(solver, motion),
            tolerance=tolerance,
            settings=Settings(**settings) if settings else None,
            timestep=timestep,
            method=options.method,  # pyright: ignore[reportArgumentType]
            samples=None if options.samples is None else options.samples - 1,
            scene=Scene(level="motion", forces=solver.forces),
            progress=report,
        )


def _poses(solver: KinematicSolver, options: RunOptions) -> Run:
    """Solve the poses at rows of driver coordinates."""
    if options.method == "step":
        raise InputError("--at solves poses; leave out --method step")
    assert options.poses is not None
    rows = driver_path(solver, files.read_in_si(options.poses), options.poses, uniform=True)
    last, scene = max(round(rows.motion_laws.duration), 1), Scene(level="motion", forces=solver.forces)
    run = run_in_mujoco(solver, motion_laws=rows.motion_laws, method="pose", samples=last, scene=scene)
    return replace(run, motion=select_instants(run.motion, rows.times.astype(np.intp)), steps=len(rows.times))


def _constant_speed(solver: KinematicSolver, speed: float, turns: float) -> CrankProfile:
    """Return the crank's motion at constant speed; raise AssemblyError if it leaves the crank's range."""
    arcs = known_crank_range(solver)
    if arcs is not None and (arcs.full or not arcs.arcs):
        return constant(speed, turns, revolutions_to(solver.mechanism.start))
    profile = constant(speed, turns, solver.mechanism.start)
    if arcs is None:
        return profile
    ends, _, _ = profile.state(np.array([0.0, profile.duration]))
    arc = interval_around(arcs, float(ends[0]))
    if arc is None or not arc[0] <= ends.min() <= ends.max() <= arc[1]:
        raise AssemblyError(
            f"{solver.name}: the crank cannot make {turns:g} turns from {ends[0]:.6g} rad: its range is "
            f"{arcs}; change the dimensions, or give a motion law that stays inside by --drive"
        )
    return profile
