"""Command `mechsim tune`: the cheapest settings with which plain MuJoCo keeps a tolerance on one scene."""

import difflib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import units
from mechsim.cli.declared_options import spread
from mechsim.cli.exit_codes import tell
from mechsim.cli.options import Json, LockOptions, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import progress
from mechsim.cli.scene_options import SceneOptions, expressions, user_scene
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

# rows of the table of what was tried
ROWS = 14


@spread
def tune(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file that MuJoCo loads.")],
    *,
    tolerance: Annotated[
        str, typer.Option(help="To keep; a bare number is metres, by torque N m (or N of a slide).")
    ],
    by: Annotated[
        str,
        typer.Option(
            metavar="closure|trajectory|torque",
            help="What errs: points against the exact closure at the run's own drivers, points against the "
            "scene's own limit of small steps and hard loops, or efforts against that limit.",
        ),
    ] = "closure",
    asked: SceneOptions,
    held: LockOptions,
    allow: Annotated[
        str,
        typer.Option(
            metavar="KIND,...",
            help=f"What need not stay, and may be switched off or become softer: {', '.join(ALLOWABLE)}.",
        ),
    ] = "",
    budget: Annotated[str, typer.Option(help="About how long to search.")] = f"{SECONDS:g}s",
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="OUT.xml", help="Where to write the scene.")
    ],
    python: Annotated[
        str | None,
        typer.Option(
            metavar="OUT.py", help="Where to write Python that runs it, or reaches what no file can."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the cheapest settings with which plain MuJoCo keeps a tolerance on your own scene and motion."""
    place = writable(output, ".xml")
    script = None if python is None else writable(python, ".py")
    if by not in MEASURES:
        raise InputError(f"there is no error by {by!r}; known are {', '.join(MEASURES)}")
    wanted = _tolerance(tolerance, by)
    seconds = units.parse_time(budget, "the budget")
    scene = user_scene(model, asked, held)
    scene = replace(scene, allowed=_allowed(allow))
    if place.resolve() == Path(scene.path).resolve():
        raise InputError(f"-o {output} is the file itself; name another, so that it stays as it is")
    if by == "closure":
        scene = _closed(scene, wanted)
    with progress("tune", None, at_least=True) as tick:
        found = tuned(scene, wanted, by, budget=seconds, progress=tick)  # pyright: ignore[reportArgumentType]
    _require_runnable(found)
    report, told = _written(found, place, script)
    if as_json:
        print_json(told | {"output": output, "python": python})
    else:
        _print(report, told, output, python)
    raise typer.Exit(0 if report.reached else 1)


def _allowed(text: str) -> tuple[str, ...]:
    kinds = tuple(one.strip() for one in text.split(",") if one.strip())
    for kind in kinds:
        if kind not in ALLOWABLE:
            raise InputError(f"--allow names {kind!r}; what can be allowed is {', '.join(ALLOWABLE)}")
    return kinds


def _closed(scene: UserScene, tolerance: float) -> UserScene:
    """Return a scene that can keep a tolerance where it starts; if its file cannot, one begun closed."""
    gap = start_error(scene)
    if gap <= AIM * tolerance:
        return scene
    if gap <= tolerance and errors_of(stepped(scene, records=None)).closure <= tolerance:
        return scene
    closed = with_assembled_start(scene)
    tell(
        f"{scene.path}: its loops stand open by {gap:.2g} m where it starts; the tuned file begins closed, "
        f"in keyframe {KEY}"
    )
    return closed


def _require_runnable(found: Tuned) -> None:
    """Refuse a scene that diverges with everything that was tried, and say what makes it so."""
    if np.isfinite(found.closest.errors.by(found.by)) or found.beyond is not None:
        return
    run = stepped(found.scene)
    cause = divergence_reason(run) or "no closed pose is near its states"
    raise InputError(
        f"{found.scene.path}: with all of {len(found.tried)} settings the scene comes to nothing: {cause}; "
        "change the motion or the scene"
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


def _written(found: Tuned, place: Path, script: Path | None) -> tuple[TuningReport, dict[str, Any]]:
    """Write what was found, run it as plain MuJoCo has it, and return what there is to tell."""
    best = found.best
    scene = replace(found.scene, model=best.settings.applied(found.scene.model))
    said = expressions(scene)
    bare = tuned_text(found.scene, best.settings, [], place.parent)
    reports: list[TuningReport] = []

    def finish(outside: UserScene) -> str:
        run = stepped(outside, records=None)
        reports.append(TuningReport(found, found.evaluator.errors(run)))
        comment = _comment(reports[0], scene, said)
        return tuned_text(found.scene, best.settings, comment, place.parent).after

    outside = written(found.scene, best.settings, bare.after, place, finish)
    report = reports[0]
    if script is not None:
        _write_script(script, found, outside, place, said)
    after = place.read_text(encoding="utf-8")
    return report, {
        "mechanism": found.scene.mechanism.name,
        "by": found.by,
        "tolerance": found.tolerance,
        "unit": report.unit,
        "reached": report.reached,
        "summary": report.sentences,
        "published": _told(found, found.published)
        | {"error": report.published_error, "reached": found.satisfied},
        "tuned": {
            "error": report.error,
            "estimate": best.errors.by(found.by) + found.reference_error,
            "ms_per_s": 1e3 * best.seconds,
            "settings": dict(changes(found.scene, best.settings)),
            "errors": report.errors.as_dict(),
        },
        "by_python": None if found.beyond is None else _told(found, found.beyond),
        "limit": {
            "what": found.reference.what,
            "error": found.reference.errors[0],
            "effort_error": found.reference.errors[1],
        },
        "put_in": list(bare.included),
        "diff": _diff(bare.before, after, found.scene.path, str(place)),
        "seconds": found.seconds,
        "tried": [_told(found, one) for one in found.tried],
    }


def _told(found: Tuned, trial: SceneTrial) -> dict[str, Any]:
    return {
        "error": trial.errors.by(found.by),
        "ms_per_s": 1e3 * trial.seconds,
        "settings": dict(changes(found.scene, trial.settings)),
        "errors": trial.errors.as_dict(),
    }


def _comment(report: TuningReport, scene: UserScene, said: dict[str, str]) -> list[str]:
    """Return what the file states of itself: what it satisfies, and how it is to be stepped."""
    begun = "from mj_resetData"
    if scene.own_start or scene.key:
        begun = f"from keyframe {KEY if scene.own_start else scene.key}"
    first, *rest = report.sentences
    return [
        f"mechsim tune: {first};",
        *(f"{one};" for one in rest),
        f"to be stepped {begun}, with before each step, t = data.time, h = {scene.model.opt.timestep:g}:",
        *([f"  {line}" for line in control_lines(scene, said)] or ["  nothing"]),
        *(f"  where q({name!r}, t) = {said[name]}" for name in scene.joint_laws),
    ]


def _write_script(script: Path, found: Tuned, outside: UserScene, place: Path, said: dict[str, str]) -> None:
    """Write the lines that run what was found."""
    scene, changed = outside, {}
    if found.beyond is not None:
        best = found.best
        known = best.settings.as_dict()
        changed = {k: v for k, v in found.beyond.settings.as_dict().items() if known.get(k) != v}
        changed |= {
            k: v
            for k, v in settings_of(found.scene.model).as_dict().items()
            if k in known and k not in found.beyond.settings.as_dict()
        }
        scene = replace(outside, model=found.beyond.settings.applied(found.scene.model))
    text = python_of(scene, place, said, changed=changed)
    with atomic_path(script) as beside:
        beside.write_text(text, encoding="utf-8")


def _diff(before: str, after: str, path: str, place: str) -> str:
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), path, place, lineterm="", n=0)
    return "\n".join(lines)


def _print(report: TuningReport, told: dict[str, Any], output: str, python: str | None) -> None:
    found, unit = report.result, report.unit
    after = replace(report.best, errors=report.errors)
    rows = [("as published", *_cells(found.published, found))]
    rows.append((f"written: {_summary(found, after)}", *_cells(after, found)))
    tried = sorted(found.tried, key=lambda one: one.seconds)
    satisfying = [one for one in tried if one.errors.by(found.by) + found.reference_error <= found.tolerance]
    shown = (PlainSettings(), report.best.settings)
    others = [one for one in satisfying if one.settings not in shown]
    rows += [(_summary(found, one), *_cells(one, found)) for one in others[:ROWS]]
    if found.beyond is not None:
        rows.append((_summary(found, found.beyond), *_cells(found.beyond, found)))
    for sentence in report.sentences:
        typer.echo(sentence)
    head = ("settings changed", f"{found.by} in {unit}", "trajectory in m", "ms a simulated s")
    print_table(f"{told['mechanism']}: {found.by} within {found.tolerance:g} {unit}", head, rows)
    if not report.reached:
        typer.echo(f"no MJCF file reaches {found.tolerance:g} {unit} here")
        if found.beyond is not None:
            how = f"in {python}" if python else "which --python OUT.py writes"
            typer.echo(f"lines of Python reach {found.beyond.errors.by(found.by):.2g} {unit}, {how}")
    typer.echo(f"wrote {output}")
    if told["put_in"]:
        typer.echo(f"put into it, as something in them changes: {', '.join(told['put_in'])}")
    typer.echo(told["diff"])
    typer.echo(f"{len(found.tried)} settings tried in {found.seconds:.3g} s; limit: {told['limit']['what']}")


def _summary(found: Tuned, one: SceneTrial) -> str:
    said = ", ".join(f"{name} {value}" for name, value in changes(found.scene, one.settings).items())
    return said or "none"


def _cells(one: SceneTrial, found: Tuned) -> tuple[str, str, str]:
    return (
        f"{one.errors.by(found.by) + found.reference_error:.2g}",
        f"{one.errors.trajectory:.2g}",
        f"{1e3 * one.seconds:.3g}",
    )
