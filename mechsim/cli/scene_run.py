"""Run of a user's MJCF scene under controls, compared with its exact closure."""

from typing import Any

import typer

from mechsim import files
from mechsim.cli.command import Result
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ControlOptions, DriveOptions
from mechsim.cli.output import number, print_text
from mechsim.errors import several
from mechsim.mechanism.finding import POSITION_TOLERANCE, Outcome
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.coordinates import actuator_names
from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.errors import SceneEvaluator, divergence_reason, sampled_run, start_error
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene, open_scene, require_mjcf


def user_scene(path: str, driven: DriveOptions, controls: ControlOptions) -> UserScene:
    """Return the scene of an MJCF file and its prescribed motion; notes state what was changed.

    Args:
        path: path of the file.
        driven: drivers, duration and tracked points.
        controls: controls of the actuators.

    Raises:
        InputError: if the file is not MJCF, or a joint, actuator, keyframe or point is missing.
        AssemblyError: if the loops do not close at the start of the motion laws.
    """
    require_mjcf(path)
    scene, changed = open_scene(path, ctrl=dict(controls.ctrl), **driven.as_arguments())
    notes.extend(changed)
    return scene


def run_under_controls(
    scene: UserScene,
    plain: PlainSettings,
    requested: float | None,
    samples: int | None,
    output: str | None,
) -> Result:
    """Step a user's MJCF scene unchanged under its controls, and compare it with its exact closure.

    Args:
        scene: the scene.
        plain: settings that change those of the file.
        requested: tolerance on closure in [m]; None for `POSITION_TOLERANCE` of the size.
        samples: number of rows; None for all.
        output: file of the motion; None writes none.
    """
    tolerance = POSITION_TOLERANCE * scene.mechanism.characteristic_length if requested is None else requested
    gap = start_error(scene)
    violation = (
        f"the loops are open by {gap:.2g} m at the initial pose of the file, which no time step corrects; "
        "give more digits there, or let `mechsim tune` write a keyframe that is closed"
    )
    run = run_scene(scene, plain.applied(scene.model))
    errors = SceneEvaluator().errors(run)
    if samples is not None:
        run = sampled_run(run, samples)
    outcome: Outcome = "diverged" if run.broken else "passed" if errors.closure <= tolerance else "failed"
    note = divergence_reason(run) if run.broken else violation if gap > tolerance else ""
    if output is not None:
        files.write_table(output, table_of(run))

    def text() -> None:
        if run.broken:
            print_text(f"{outcome}: {run.broken}: {note}")
        else:
            print_text(
                f"{outcome}: points within {number(errors.closure, 3)} m of the exact closure at the run's "
                f"own drivers (tolerance {number(tolerance, 3)} m)"
            )
            print_text(note)
        typer.echo(f"{run.steps} steps in {number(run.seconds)} s, in plain MuJoCo")
        if output is not None:
            typer.echo(f"wrote {several(len(run.time), 'row')} to {output}")

    data: dict[str, Any] = {
        "outcome": outcome,
        "tolerance": tolerance,
        "estimate": errors.closure,
        "steps": run.steps,
        "seconds": run.seconds,
        "method": "step",
        "note": note,
        "settings": plain.as_dict() | {"timestep": float(run.model.opt.timestep)},
        "mechanism": scene.mechanism.name,
        "output": output,
        "rows": len(run.time),
    }
    return Result(data, text, outcome == "passed")


def table_of(run: SceneRun) -> dict[str, Array]:
    """Return the columns of a run: time, points with velocities, joints, actuator forces."""
    scene, model = run.scene, run.model
    table = {"t": run.time}
    velocities = run.velocities
    for k, name in enumerate(scene.tracked):
        table |= {f"{name}.{axis}": run.points[:, k, i] for i, axis in enumerate("xyz")}
        table |= {f"{name}.v{axis}": velocities[:, k, i] for i, axis in enumerate("xyz")}
    for j, joint in enumerate(scene.mechanism.joints[: model.njnt]):
        if len(joint.coordinates) == 1:
            table[f"{joint.name}.q"] = run.qpos[:, model.jnt_qposadr[j]]
            table[f"{joint.name}.v"] = run.qvel[:, model.jnt_dofadr[j]]
    for i, name in enumerate([*actuator_names(model), *scene.joint_laws]):
        table[f"effort:{name}"] = run.forces[:, i]
    return table
