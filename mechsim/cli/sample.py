"""Command `mechsim sample`: random closed configurations of a MuJoCo model."""

from dataclasses import MISSING
from typing import Annotated, Any

import numpy as np
import typer

from mechsim.cli.command import Result, Without, command
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ModelOptions, changed_parameters
from mechsim.cli.output_paths import output_file
from mechsim.cli.progress import progress
from mechsim.errors import InputError
from mechsim.files import atomic_path
from mechsim.studies import closed_configurations
from mechsim.studies.robots.mujoco_models import notes_on
from mechsim.subjects.mujoco_inputs import with_loops
from mechsim.units import option

# options of commands that solve configurations of a MuJoCo model
ClosedModelOptions = Annotated[ModelOptions, Without("drive", "track", "duration")]


def closed_model(source: ModelOptions) -> tuple[Any, dict[str, Any]]:
    """Return a model with its loop closures, and how its paths start; note what of it is not read."""
    if [*source.lock] not in ([], [("others", None)]):
        raise InputError("--lock takes only `others` here, for every actuator moves; leave other joints out")
    model, start = with_loops(source.model, source.loops), source.as_arguments()["start"]
    options: dict[str, Any] = {"set": changed_parameters(source.sets), "key": source.key, "start": start}
    notes.extend(notes_on(model, **options))
    return model, options | {"fix_base": source.fix_base}


@command
def sample(
    source: ClosedModelOptions,
    *,
    n: int = option(MISSING, "Number of states.", name="-n"),
    output: Annotated[str, output_file("States to write: .npz.", ".npz")],
    seed: int = option(0, "Seed of the random numbers."),
) -> Result:
    """Draw closed configurations within joint limits and in one assembly, in MuJoCo's order of qpos.

    Examples:
    mechsim sample ankle.xml -n 4096 -o states.npz
    mechsim sample gripper.urdf -n 100 --seed 7 -o states.npz --json
    """
    model, options = closed_model(source)
    with progress("sample", None) as report:
        states = closed_configurations.sample(
            model, n, seed, progress=report, lock_others=source.locks_others, **options
        )
    with atomic_path(output) as temporary, temporary.open("wb") as file:
        np.savez(file, qpos=states.qpos, qvel=states.qvel, residual=states.residual)
    worst = float(states.residual.max())
    data = {"n": n, "accepted": states.accepted, "worst_residual": worst}
    text = f"{n} states, {states.accepted:.1%} of draws accepted, worst residual {worst:.2g}"
    return Result(data, lambda: typer.echo(text), files=(output,))
