"""Command `mechsim tune`: the cheapest settings with which plain MuJoCo satisfies a tolerance on a scene."""

import re
from dataclasses import MISSING, replace
from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.cli.command import Result, Without, command, one_of_each, output_file
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ControlOptions, DriveOptions
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.errors import InputError, several
from mechsim.simulation.plain_settings import ALLOWABLE, PlainSettings
from mechsim.studies.scene.errors import SceneTrial
from mechsim.studies.scene.scene import require_mjcf
from mechsim.studies.scene.tune import SECONDS, Tuned
from mechsim.studies.scene.tune_model import tune as tune_model
from mechsim.studies.scene.write_tuned import setting_changes
from mechsim.units import option


@command
def tune(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file that MuJoCo loads.")],
    *,
    tolerance: str = option(
        MISSING, "Tolerance; a bare number is in m, with --by torque in N m (N for a slide)."
    ),
    by: str = option(
        "closure",
        "Error to keep: closure compares points with exactly closed loops at the run's own driver "
        "positions, trajectory with a run of small steps and stiff loops, torque compares efforts.",
        metavar="closure|trajectory|torque",
    ),
    driven: Annotated[DriveOptions, Without("loops")],
    controls: ControlOptions,
    allow: str = option("", f"What may be disabled or softened: {', '.join(ALLOWABLE)}.", metavar="KIND,..."),
    budget: str = option(f"{SECONDS:g}s", "Duration of the search; a bare number is in s."),
    outputs: Annotated[
        list[str],
        output_file(
            "Tuned scene to write: .xml. Give it twice for a Python script that runs the scene with its "
            "controls and forces: .py.",
            ".xml",
            ".py",
            metavar="OUT.xml",
        ),
    ],
) -> Result:
    """Find the cheapest settings with which plain MuJoCo satisfies a tolerance on your own scene and motion.

    Examples:
    mechsim tune gripper.xml --tolerance 10um --ctrl fingers=120 -o tuned.xml
    mechsim tune leg.xml --tolerance 1um --by trajectory -o tuned.xml
    """
    output, python = one_of_each(outputs, (".xml",), (".py",))
    if output is None:
        raise InputError("-o names no scene to write; give -o OUT.xml too")
    require_mjcf(model)
    seconds = units.parse_time(budget, "the budget")
    kinds = [kind.strip() for kind in allow.split(",") if kind.strip()]
    with progress("tune", None, at_least=True) as report:
        result = tune_model(
            model,
            tolerance,
            by=by,
            ctrl=dict(controls.ctrl),
            allow=kinds,
            budget=seconds,
            output=output,
            python=python,
            progress=report,
            **driven.as_arguments(),
        )
    notes.extend(result.notes)
    data: dict[str, Any] = result.as_dict() | {"output": output, "python": python}
    return Result(data, lambda: _print(result.report, data), result.reached)


def _print(result: Tuned, data: dict[str, Any]) -> None:
    """Print the result, the table of tried settings, and the changes of the file."""
    unit, after = result.unit, replace(result.best, errors=result.errors)
    trials = {"as published": result.published, f"written: {_summary(result, after)}": after}
    rows = [(name, *_row(trial, result)) for name, trial in trials.items()]
    shown = (PlainSettings(), result.best.settings)
    others = sorted(result.compared, key=lambda trial: trial.seconds)
    rows += [(_summary(result, own), *_row(own, result)) for own in others if own.settings not in shown]
    for sentence in result.sentences:
        print_text(sentence)
    if not result.reached:
        print_text(f"no MJCF file reaches {result.tolerance:g} {unit} for this scene")
    head = ["settings changed", f"{result.by} [{unit}]", "trajectory [m]", "ms/s"]
    # the deciding measure is printed once only
    keep = [i for i in range(4) if not (i == 2 and result.by == "trajectory")]
    title = f"{result.scene.path}: {result.by} within {result.tolerance:g} {unit}; ms per simulated second"
    print_table(title, [head[i] for i in keep], [[row[i] for i in keep] for row in rows])
    typer.echo(f"wrote {data['output']}")
    if data["put_in"]:
        print_text(f"included files are part of it, since they change: {', '.join(data['put_in'])}")
    print_text(f"{several(len(result.tried), 'setting')} tried in {number(result.seconds, 3)} s")
    print_text(f"trajectory: difference to {data['limit']['what']}; --json lists the changed lines")


def _summary(result: Tuned, trial: SceneTrial) -> str:
    changed = setting_changes(result.scene, trial.settings)
    return ", ".join(f"{name} {_short(value)}" for name, value in changed.items()) or "none"


def _short(text: str) -> str:
    """Return the words of a setting, numbers with few digits."""
    return " ".join(number(float(word)) if re.match(r"[-\d.]", word) else word for word in text.split())


def _row(trial: SceneTrial, result: Tuned) -> tuple[str, str, str]:
    error = trial.errors.by(result.by) + result.reference_error
    return number(error, 2), number(trial.errors.trajectory, 2), number(1e3 * trial.seconds, 3)
