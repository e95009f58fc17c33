"""What `mechsim simulate --ctrl` does: a user's scene as it is, its actuators fed, judged by its closure."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import typer

from mechsim import files
from mechsim.cli.options import DriveOptions, pair_of
from mechsim.cli.output import print_json
from mechsim.cli.plain_options import plain_settings
from mechsim.cli.scene_options import CTRL, SceneOptions, user_scene
from mechsim.errors import InputError
from mechsim.model.outcome import POSITION_TOLERANCE, Outcome
from mechsim.numerics.arrays import Array
from mechsim.studies.scenes import SceneErrors, SceneRun, UserScene, start_error
from mechsim.studies.scenes.plain_settings import PlainSettings
from mechsim.studies.scenes.why_broken import why_broken
from mechsim.studies.tuning.finer_steps import finer


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
    bound = POSITION_TOLERANCE * scene.size if tolerance is None else tolerance
    hopeless = bool(_stands_open(scene, bound))
    run, errors, used = finer(scene, settings, bound, fixed=tolerance is None or hopeless, records=samples)
    outcome: Outcome = "diverged" if run.broken else "passed" if errors.closure <= bound else "failed"
    if place is not None:
        files.write_table(place, table_of(run))
    _tell(scene, run, errors, used, outcome, bound, output, as_json)
    raise typer.Exit(0 if outcome == "passed" else 1)


def table_of(run: SceneRun) -> dict[str, Array]:
    """Return the columns of a run: time, points with velocities, joints, actuators' efforts."""
    scene, model = run.scene, run.model
    table = {"time": run.time}
    velocities = run.velocities
    for k, name in enumerate(scene.places):
        for axis, label in enumerate("xyz"):
            table[f"{name}.{label}"] = run.points[:, k, axis]
        for axis, label in enumerate("xyz"):
            table[f"{name}.v{label}"] = velocities[:, k, axis]
    for j, joint in enumerate(scene.mechanism.joints[: model.njnt]):
        if len(joint.coordinates) == 1:
            table[f"{joint.name}.q"] = run.qpos[:, model.jnt_qposadr[j]]
            table[f"{joint.name}.v"] = run.qvel[:, model.jnt_dofadr[j]]
    names = [model.actuator(i).name or f"actuator{i + 1}" for i in range(model.nu)]
    for i, name in enumerate([*names, *scene.drive]):
        table[f"effort:{name}"] = run.efforts[:, i]
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


def _tell(
    scene: UserScene,
    run: SceneRun,
    errors: SceneErrors,
    used: PlainSettings,
    outcome: str,
    bound: float,
    output: str | None,
    as_json: bool,
) -> None:
    note = why_broken(run) if run.broken else _stands_open(scene, bound)
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
