"""Command `mechsim reduce`: the smallest scene that satisfies a tolerance for what is tracked."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from mechsim import files, units
from mechsim.cli.command import Result, command
from mechsim.cli.options import DriveOptions, File, writable
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.cli.scene_options import ControlOptions, user_scene
from mechsim.errors import InputError
from mechsim.studies.reduction import By, LeftOut, Reduction, reduced, with_comment
from mechsim.studies.scene import SceneErrors, spec_of

UNITS: dict[By, units.Unit] = {"trajectory": "m", "torque": "N m"}


class RemovedJson(TypedDict):
    """A removed element: its error alone, and of the scene once it was removed with those before it."""

    what: str
    family: str
    error: float
    time_ratio: float
    together: float
    torque: float
    energy: float


class MotionErrors(TypedDict):
    """Errors of the reduced scene over a motion."""

    trajectory: float
    torque: float
    energy: float


class Cost(TypedDict):
    """Milliseconds per simulated second."""

    full: float
    reduced: float


class ReduceJson(TypedDict):
    """What was removed, and errors and cost of the rest."""

    left_out: list[RemovedJson]
    error: float
    speedup: float
    motion: MotionErrors
    second_motion: MotionErrors
    ms_per_s: Cost
    tried: int
    undone: list[str]
    tolerance: float
    by: str
    unit: str
    output: str | None


@command
def reduce(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file of your own.")],
    *,
    tolerance: Annotated[
        str, typer.Option(help="Tolerance on what is tracked; a bare number is metres, by torque N m.")
    ],
    by: Annotated[
        str, typer.Option(metavar="trajectory|torque", help="Error: of tracked points, or of efforts.")
    ] = "trajectory",
    driven: DriveOptions,
    controls: ControlOptions,
    output: File,
) -> Result[ReduceJson]:
    """Remove from a scene what its tracked points do not need; write the reduced scene.

    Examples:
    mechsim reduce gripper.xml --tolerance 10um --track fingertip -o reduced.xml
    mechsim reduce leg.xml --by torque --tolerance 0.01 -o reduced.xml
    """
    path = writable(output, ".xml")
    if by not in UNITS:
        raise InputError(f"--by is {by!r}; it can be {', '.join(UNITS)}")
    unit = UNITS[by]
    limit = units.parse(tolerance, unit, "the tolerance")
    if not 0.0 < limit < float("inf"):
        raise InputError(f"the tolerance is {tolerance}; give one above 0, as in 10um")
    # P,Q are two points, P,BODY@x,y,z is one
    points = [name for text in driven.track for name in ([text] if "@" in text else text.split(","))]
    driven = replace(driven, track=tuple(points))
    scene = user_scene(model, driven, controls)
    keep = {name for text in points for name in text.partition("@")[0].split(",")} | set(scene.tracked)
    with progress("reduce", None) as report:
        result = reduced(scene, spec_of(scene), limit, keep=keep, by=by, progress=report)
    with files.atomic_path(path) as unfinished:
        unfinished.write_text(with_comment(result, Path(model).name, limit, unit))
    data: ReduceJson = {**_as_dict(result), "tolerance": limit, "by": by, "unit": unit, "output": output}
    return Result(data, lambda: _print(result, model, limit, unit), result.kept(limit), [output])


def _as_dict(result: Reduction) -> dict[str, object]:
    first, second = result.errors
    return {
        "left_out": [_removed(element, result.by) for element in result.left_out],
        "error": max(first.by(result.by), second.by(result.by)),
        "speedup": result.speedup,
        "motion": _errors(first),
        "second_motion": _errors(second),
        "ms_per_s": {"full": 1e3 * result.time, "reduced": 1e3 * result.time / result.speedup},
        "tried": result.tried,
        "undone": list(result.undone),
    }


def _removed(element: LeftOut, by: By) -> RemovedJson:
    return {
        "what": element.candidate.what,
        "family": element.candidate.category,
        "error": element.alone_errors.by(by),
        "time_ratio": element.time_ratio,
        "together": element.error,
        "torque": element.alone_errors.torque,
        "energy": element.alone_errors.energy,
    }


def _errors(errors: SceneErrors) -> MotionErrors:
    return {"trajectory": errors.trajectory, "torque": errors.torque, "energy": errors.energy}


def _print(result: Reduction, model: str, tolerance: float, unit: str) -> None:
    rows = [
        (
            element.candidate.what,
            *(number(value, 2) for value in (element.alone_errors.by(result.by), element.error)),
            number(element.time_ratio, 3),
            *(number(value, 2) for value in (element.alone_errors.torque, element.alone_errors.energy)),
        )
        for element in result.left_out
    ]
    head = ("removed", f"alone [{unit}]", f"together [{unit}]", "time", "effort", "energy [J]")
    print_table(f"{model}: errors of what was removed, relative time of a step", head, rows)
    for what in result.undone:
        print_text(f"restored, since the whole was beyond the tolerance: {what}")
    for motion, errors in zip(("its motion", "a second motion"), result.errors, strict=True):
        print_text(
            f"over {motion}: within {number(errors.by(result.by), 2)} {unit} of the full scene (tolerance "
            f"{number(tolerance, 3)} {unit}); efforts within {number(errors.torque, 2)}, energy within "
            f"{number(errors.energy, 2)} J"
        )
    print_text(
        f"{number(result.speedup, 3)} times as fast: {number(1e3 * result.time / result.speedup, 3)} instead "
        f"of {number(1e3 * result.time, 3)} ms a simulated second; {result.tried} candidates tried"
    )
