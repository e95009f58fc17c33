"""Command `mechsim sample`: random closed configurations of a MuJoCo model."""

from dataclasses import MISSING
from typing import Annotated

import numpy as np
import typer

from mechsim.cli.closed_model import ClosedModelOptions, closed_model
from mechsim.cli.command import Result, command, output_file
from mechsim.cli.progress import progress
from mechsim.files import atomic_path
from mechsim.studies import closed_configurations
from mechsim.units import option


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
    model = closed_model(source)[0]
    with progress("sample", None) as report:
        states = closed_configurations.sample(
            model, n, seed, progress=report, lock_others=source.locks_others, fix_base=source.fix_base
        )
    with atomic_path(output) as temporary, temporary.open("wb") as file:
        np.savez(file, qpos=states.qpos, qvel=states.qvel, residual=states.residual)
    worst = float(states.residual.max())
    data = {"n": n, "accepted": states.accepted, "worst_residual": worst}
    text = f"{n} states, {states.accepted:.1%} of draws accepted, worst residual {worst:.2g}"
    return Result(data, lambda: typer.echo(text), files=(output,))
