"""Command `mechsim tune`: the cheapest settings with which plain MuJoCo satisfies a tolerance on a scene."""

import difflib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np
import typer

from mechsim import units
from mechsim.cli.command import Result, command
from mechsim.cli.exit_codes import print_stderr
from mechsim.cli.options import DriveOptions, writable
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.cli.scene_options import ControlOptions, python_laws, user_scene
from mechsim.errors import InputError
from mechsim.files import atomic_path
from mechsim.studies.scene import (
    MEASURES,
    SceneTrial,
    UserScene,
    errors_of,
    start_error,
    stepped,
    with_assembled_start,
)
from mechsim.studies.scene.errors import divergence_reason
from mechsim.studies.scene.settings import ALLOWABLE, PlainSettings, settings_of
from mechsim.studies.scene.tune import AIM, SECONDS, Tuned, TuningReport, tuned
from mechsim.studies.scene.write_tuned import KEY, changes, control_lines, python_of, tuned_text, written

# rows of the table of tried settings
MOST_ROWS = 14


class TriedSettings(TypedDict):
    """Changed settings with their error and cost."""

    error: float
    ms_per_s: float
    settings: dict[str, Any]
    errors: dict[str, Any]


class Published(TriedSettings):
    """The settings of the file."""

    reached: bool


class TunedSettings(TriedSettings):
    """The settings that were written; the error is that of the written file."""

    estimate: float


class LimitJson(TypedDict):
    """The converged reference of errors, and its own errors."""

    what: str
    error: float
    effort_error: float


class TuneJson(TypedDict):
    """The search and its result."""

    mechanism: str
    by: str
    tolerance: float
    unit: str
    reached: bool
    summary: list[str]
    published: Published
    tuned: TunedSettings
    by_python: TriedSettings | None
    limit: LimitJson
    put_in: list[Any]
    diff: str
    seconds: float
    tried: list[TriedSettings]
    output: str | None
    python: str | None


@command
def tune(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file that MuJoCo loads.")],
    *,
    tolerance: Annotated[
        str,
        typer.Option(help="Tolerance; a bare number is metres, by torque N m (or N of a slide)."),
    ],
    by: Annotated[
        str,
        typer.Option(
            metavar="closure|trajectory|torque",
            help="Error: points against the exact closure at the run's own drivers, points against the "
            "scene's own limit of small steps and stiff loops, or efforts against that limit.",
        ),
    ] = "closure",
    driven: DriveOptions,
    controls: ControlOptions,
    allow: Annotated[
        str,
        typer.Option(
            metavar="KIND,...",
            help=f"What may be disabled or become softer: {', '.join(ALLOWABLE)}.",
        ),
    ] = "",
    budget: Annotated[str, typer.Option(help="Duration of the search.")] = f"{SECONDS:g}s",
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="OUT.xml", help="Where to write the scene.")
    ],
    python: Annotated[
        str | None,
        typer.Option(
            metavar="OUT.py", help="Where to write Python that runs it, or reaches what no file can."
        ),
    ] = None,
) -> Result[TuneJson]:
    """Find the cheapest settings with which plain MuJoCo satisfies a tolerance on your own scene and motion.

    Examples:
    mechsim tune gripper.xml --tolerance 10um --ctrl fingers=120 -o tuned.xml
    mechsim tune leg.xml --tolerance 1um --by trajectory -o tuned.xml
    """
    path = writable(output, ".xml")
    script = None if python is None else writable(python, ".py")
    if by not in MEASURES:
        raise InputError(f"there is no error by {by!r}; known are {', '.join(MEASURES)}")
    limit = _tolerance(tolerance, by)
    seconds = units.parse_time(budget, "the budget")
    scene = replace(user_scene(model, driven, controls), allowed=_allowed(allow))
    if path.resolve() == Path(scene.path).resolve():
        raise InputError(f"-o {output} is the file itself; name another, so that it stays as it is")
    if by == "closure":
        scene = _with_closed_start(scene, limit)
    with progress("tune", None, at_least=True) as report:
        result = tuned(
            scene,
            limit,
            by,  # pyright: ignore[reportArgumentType]
            budget=seconds,
            progress=report,
        )
    _require_runnable(result)
    tuning, data = _written(result, path, script)
    data |= {"output": output, "python": python}
    return Result(data, lambda: _print(tuning, data), tuning.reached)  # pyright: ignore[reportArgumentType]


def _allowed(text: str) -> tuple[str, ...]:
    kinds = tuple(kind.strip() for kind in text.split(",") if kind.strip())
    for kind in kinds:
        if kind not in ALLOWABLE:
            raise InputError(f"--allow names {kind!r}; what may be disabled is {', '.join(ALLOWABLE)}")
    return kinds


def _with_closed_start(scene: UserScene, tolerance: float) -> UserScene:
    """Return a scene whose initial pose satisfies a tolerance; if that of the file does not, a closed one."""
    error = start_error(scene)
    if error <= AIM * tolerance:
        return scene
    if error <= tolerance and errors_of(stepped(scene, records=None)).closure <= tolerance:
        return scene
    print_stderr(
        f"{scene.path}: its loops are open by {error:.2g} m at the initial pose; the tuned file starts "
        f"closed, in keyframe {KEY}"
    )
    return with_assembled_start(scene)


def _require_runnable(result: Tuned) -> None:
    """Raise InputError with the cause for a scene that diverges with all settings that were tried."""
    if np.isfinite(result.closest.errors.by(result.by)) or result.beyond is not None:
        return
    cause = divergence_reason(stepped(result.scene)) or "no closed pose is near its states"
    raise InputError(
        f"{result.scene.path}: the scene diverges with all of {len(result.tried)} settings: {cause}; change "
        "the motion or the scene"
    )


def _tolerance(text: str, by: str) -> float:
    if by == "torque":
        try:
            value = float(text.removesuffix("Nm").removesuffix("N"))
        except ValueError:
            raise InputError(f"the tolerance is {text!r}; give a number of N m, as in 0.01") from None
    else:
        value = units.parse_length(text, "the tolerance")
    if not 0.0 < value < float("inf"):
        raise InputError(f"the tolerance is {text}; give a finite one above 0")
    return value


def _written(result: Tuned, path: Path, script: Path | None) -> tuple[TuningReport, dict[str, Any]]:
    """Write the tuned scene, run it as plain MuJoCo reads it, and return the report and the JSON object."""
    best = result.best
    scene = replace(result.scene, model=best.settings.applied(result.scene.model))
    laws = python_laws(scene)
    draft = tuned_text(result.scene, best.settings, [], path.parent)
    reports: list[TuningReport] = []

    def finish(read_back: UserScene) -> str:
        run = stepped(read_back, records=None)
        reports.append(TuningReport(result, result.evaluator.errors(run)))
        comment = _comment(reports[0], scene, laws)
        return tuned_text(result.scene, best.settings, comment, path.parent).after

    read_back = written(result.scene, best.settings, draft.after, path, finish)
    report = reports[0]
    if script is not None:
        _write_script(script, result, read_back, path, laws)
    after = path.read_text(encoding="utf-8").splitlines()
    diff = difflib.unified_diff(
        draft.before.splitlines(), after, result.scene.path, str(path), lineterm="", n=0
    )
    return report, {
        "mechanism": result.scene.mechanism.name,
        "by": result.by,
        "tolerance": result.tolerance,
        "unit": report.unit,
        "reached": report.reached,
        "summary": report.sentences,
        "published": _as_dict(result, result.published)
        | {"error": report.published_error, "reached": result.satisfied},
        "tuned": _as_dict(result, best)
        | {
            "error": report.error,
            "estimate": best.errors.by(result.by) + result.reference_error,
            "errors": report.errors.as_dict(),
        },
        "by_python": None if result.beyond is None else _as_dict(result, result.beyond),
        "limit": {
            "what": result.reference.what,
            "error": result.reference.errors[0],
            "effort_error": result.reference.errors[1],
        },
        "put_in": list(draft.included),
        "diff": "\n".join(diff),
        "seconds": result.seconds,
        "tried": [_as_dict(result, trial) for trial in result.tried],
    }


def _as_dict(result: Tuned, trial: SceneTrial) -> dict[str, Any]:
    return {
        "error": trial.errors.by(result.by),
        "ms_per_s": 1e3 * trial.seconds,
        "settings": dict(changes(result.scene, trial.settings)),
        "errors": trial.errors.as_dict(),
    }


def _comment(report: TuningReport, scene: UserScene, laws: dict[str, str]) -> list[str]:
    """Return the comment of the file: the tolerance it satisfies, and how to step it."""
    start = "from mj_resetData"
    if scene.own_start or scene.key:
        start = f"from keyframe {KEY if scene.own_start else scene.key}"
    first, *rest = report.sentences
    return [
        f"mechsim tune: {first};",
        *(f"{sentence};" for sentence in rest),
        f"to be stepped {start}, with before each step, t = data.time, h = {scene.model.opt.timestep:g}:",
        *([f"  {line}" for line in control_lines(scene, laws)] or ["  nothing"]),
        *(f"  where q({name!r}, t) = {laws[name]}" for name in scene.joint_laws),
    ]


def _write_script(
    script: Path, result: Tuned, read_back: UserScene, path: Path, laws: dict[str, str]
) -> None:
    """Write the lines that run the tuned scene, with settings that only Python reaches."""
    scene, changed = read_back, {}
    if result.beyond is not None:
        best = (result.best).settings.as_dict()
        beyond = result.beyond.settings.as_dict()
        changed = {name: value for name, value in beyond.items() if best.get(name) != value}
        own = settings_of(result.scene.model).as_dict()
        changed |= {name: value for name, value in own.items() if name in best and name not in beyond}
        scene = replace(read_back, model=result.beyond.settings.applied(result.scene.model))
    text = python_of(scene, path, laws, changed=changed)
    with atomic_path(script) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def _print(report: TuningReport, data: dict[str, Any]) -> None:
    """Print the result, the table of tried settings, and the changes of the file."""
    result, unit = report.result, report.unit
    after = replace(report.best, errors=report.errors)
    rows = [("as published", *_row(result.published, result))]
    rows.append((f"written: {_summary(result, after)}", *_row(after, result)))
    shown = (PlainSettings(), report.best.settings)
    satisfying = [
        trial
        for trial in sorted(result.tried, key=lambda trial: trial.seconds)
        if trial.errors.by(result.by) + result.reference_error <= result.tolerance
        and trial.settings not in shown
    ]
    satisfying = satisfying[:MOST_ROWS] + ([] if result.beyond is None else [result.beyond])
    rows += [(_summary(result, trial), *_row(trial, result)) for trial in satisfying]
    for sentence in report.sentences:
        print_text(sentence)
    if not report.reached:
        print_text(f"no MJCF file reaches {result.tolerance:g} {unit} for this scene")
        if result.beyond is not None:
            script = f"in {data['python']}" if data["python"] else "which --python OUT.py writes"
            error = number(result.beyond.errors.by(result.by), 2)
            print_text(f"lines of Python reach {error} {unit}, {script}")
    head = ["settings changed", f"{result.by} [{unit}]", "trajectory [m]", "ms/s"]
    # the measure that decides is not printed twice
    keep = [i for i in range(4) if not (i == 2 and result.by == "trajectory")]
    title = f"{result.scene.path}: {result.by} within {result.tolerance:g} {unit}; ms per simulated second"
    print_table(title, [head[i] for i in keep], [[row[i] for i in keep] for row in rows])
    typer.echo(f"wrote {data['output']}")
    if data["put_in"]:
        print_text(f"included files are part of it, since they change: {', '.join(data['put_in'])}")
    typer.echo(data["diff"])
    print_text(
        f"{len(result.tried)} settings tried in {number(result.seconds, 3)} s; limit: {data['limit']['what']}"
    )


def _summary(result: Tuned, trial: SceneTrial) -> str:
    changed = changes(result.scene, trial.settings)
    return ", ".join(f"{name} {value}" for name, value in changed.items()) or "none"


def _row(trial: SceneTrial, result: Tuned) -> tuple[str, str, str]:
    error = trial.errors.by(result.by) + result.reference_error
    return number(error, 2), number(trial.errors.trajectory, 2), number(1e3 * trial.seconds, 3)
