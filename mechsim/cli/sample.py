"""Command `mechsim sample`: random closed configurations of a MuJoCo model."""

from dataclasses import MISSING
from typing import Annotated, TypedDict

import numpy as np
import typer

from mechsim.cli.command import Result, command
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import (
    FixBase,
    Key,
    Loops,
    Model,
    Sets,
    Start,
    changed_parameters,
    output_file,
    requested_start,
    writable,
)
from mechsim.cli.progress import progress
from mechsim.files import atomic_path
from mechsim.studies import closed_configurations
from mechsim.studies.robots.mujoco_models import notes_on
from mechsim.subjects.mjcf_source import with_loops
from mechsim.units import option


class SampleJson(TypedDict):
    """The written states."""

    n: int
    accepted: float
    worst_residual: float


@command
def sample(
    model: Model,
    *,
    n: int = option(MISSING, "Number of states.", name="-n"),
    output: Annotated[str, output_file("States to write: .npz.")],
    seed: int = option(0, "Seed of the random numbers."),
    sets: Sets = None,
    loops: Loops = None,
    key: Key = None,
    start: Start = None,
    fix_base: FixBase = False,
    lock_others: bool = option(
        False,
        "Joints without actuators that the loops do not determine stay where they start.",
        name="--lock-others",
    ),
) -> Result[SampleJson]:
    """Draw closed configurations within joint limits and in one assembly, in MuJoCo's order of qpos.

    Examples:
    mechsim sample ankle.xml -n 4096 -o states.npz
    mechsim sample gripper.urdf -n 100 --seed 7 -o states.npz --json
    """
    path = writable(output, ".npz")
    source, changed, initial = with_loops(model, loops), changed_parameters(sets), requested_start(start)
    notes.extend(notes_on(source, changed, key, initial))
    with progress("sample", None) as report:
        states = closed_configurations.sample(
            source,
            n,
            seed,
            set=changed,
            progress=report,
            key=key,
            start=initial,
            fix_base=fix_base,
            lock_others=lock_others,
        )
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, qpos=states.qpos, qvel=states.qvel, residual=states.residual)
    data: SampleJson = {"n": n, "accepted": states.accepted, "worst_residual": float(states.residual.max())}
    text = f"{n} states, {states.accepted:.1%} of draws accepted, worst residual {data['worst_residual']:.2g}"
    return Result(data, lambda: typer.echo(text), files=(output,))
