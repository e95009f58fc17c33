"""The command reduce: the smallest scene that keeps a tolerance for what is tracked."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import files, units
from mechsim.cli.declared_options import spread
from mechsim.cli.options import File, Json, LockOptions, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import Tick, progress
from mechsim.cli.scene_options import SceneOptions, user_scene
from mechsim.errors import InputError
from mechsim.studies.reduction import By, LeftOut, Reduction, reduced, with_comment
from mechsim.studies.scene import SceneErrors, spec_of

UNITS: dict[By, units.Unit] = {"trajectory": "m", "torque": "N m"}


@spread
def reduce(
    model: Annotated[str, typer.Argument(metavar="FILE.xml", help="An MJCF file of your own.")],
    *,
    tolerance: Annotated[
        str,
        typer.Option(help="Bound on what is tracked; a bare number is metres, by torque N m."),
    ],
    by: Annotated[
        str, typer.Option(metavar="trajectory|torque", help="What counts: tracked points, or efforts.")
    ] = "trajectory",
    asked: SceneOptions,
    held: LockOptions,
    output: File,
    as_json: Json = False,
) -> None:
    """Leave out of a scene what is not needed for what is tracked; write what is left."""
    place = writable(output, ".xml")
    if by not in UNITS:
        raise InputError(f"--by is {by!r}; it can be {', '.join(UNITS)}")
    unit = UNITS[by]
    bound = units.parse(tolerance, unit, "the tolerance")
    if not 0.0 < bound < float("inf"):
        raise InputError(f"the tolerance is {tolerance}; give one above 0, as in 10um")
    asked = replace(asked, track=tuple(one for text in asked.track for one in _points(text)))
    scene = user_scene(model, asked, held)
    keep = {part for text in asked.track for part in text.partition("@")[0].split(",")} | set(scene.tracked)
    with progress("reduce", 100) as tick:
        found = reduced(scene, spec_of(scene), bound, keep=keep, by=by, progress=_Told(tick))
    with files.atomic_path(place) as path:
        path.write_text(with_comment(found, Path(model).name, bound, unit))
    if as_json:
        print_json(_as_dict(found) | {"tolerance": bound, "by": by, "unit": unit, "output": output})
    else:
        _print(found, model, bound, unit)
        typer.echo(f"wrote {output}")
    raise typer.Exit(0 if found.kept(bound) else 1)


def _points(text: str) -> list[str]:
    """Return the points that one --track names: P,Q are two, P,BODY@x,y,z is one."""
    return [text] if "@" in text else text.split(",")


class _Told:
    """Shows what is tried."""

    def __init__(self, tick: Tick):
        self.tick = tick

    def __call__(self, what: str, part: float) -> None:
        self.tick(what, part)


def _as_dict(found: Reduction) -> dict[str, Any]:
    first, second = found.errors
    return {
        "left_out": [_row(one, found.by) for one in found.left_out],
        "error": max(first.by(found.by), second.by(found.by)),
        "speedup": found.speedup,
        "motion": _errors(first),
        "second_motion": _errors(second),
        "ms_per_s": {"full": 1e3 * found.time, "reduced": 1e3 * found.time / found.speedup},
        "tried": found.tried,
        "undone": list(found.undone),
    }


def _row(one: LeftOut, by: By) -> dict[str, Any]:
    return {
        "what": one.candidate.what,
        "family": one.candidate.category,
        "error": one.alone_errors.by(by),
        "time_ratio": one.time_ratio,
        "together": one.error,
        "torque": one.alone_errors.torque,
        "energy": one.alone_errors.energy,
    }


def _errors(one: SceneErrors) -> dict[str, float]:
    return {"trajectory": one.trajectory, "torque": one.torque, "energy": one.energy}


def _print(found: Reduction, model: str, bound: float, unit: str) -> None:
    rows = [
        (
            one.candidate.what,
            f"{one.alone_errors.by(found.by):.1e}",
            f"{one.time_ratio:.3g}",
            f"{one.error:.1e}",
            f"{one.alone_errors.torque:.1e}",
            f"{one.alone_errors.energy:.1e}",
        )
        for one in found.left_out
    ]
    head = ("left out", f"error alone [{unit}]", "time", f"together [{unit}]", "effort", "energy [J]")
    print_table(f"{model}: what it does not need", head, rows)
    for what in found.undone:
        typer.echo(f"brought back, for the whole was beyond the tolerance: {what}")
    for which, errors in zip(("its motion", "a second motion"), found.errors, strict=True):
        typer.echo(
            f"over {which}: within {errors.by(found.by):.2g} {unit} of the full scene "
            f"(bound {bound:.3g} {unit}); efforts within {errors.torque:.2g}, "
            f"energy within {errors.energy:.2g} J"
        )
    typer.echo(
        f"{found.speedup:.3g} times as fast: {1e3 * found.time / found.speedup:.3g} instead of "
        f"{1e3 * found.time:.3g} ms a simulated second; {found.tried} candidates tried"
    )
