"""Command `mechsim export`: the MuJoCo model of a mechanism, or of all."""

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from mechsim import files, units
from mechsim.analytic import catalog
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.cli.declared_options import spread
from mechsim.cli.options import (
    SPEED,
    DriveOptions,
    Json,
    Output,
    Sets,
    folder_for,
    form_of,
    scene_of,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.progress import progress
from mechsim.cli.scene_options import plain_settings
from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.pictures.render.scenery import exported
from mechsim.simulation import Settings, mjcf
from mechsim.simulation.mjcf.generator import TIME_CONSTANT_STEPS, set_drive_inertia
from mechsim.studies.scene import turning_model
from mechsim.subjects.toml_writer import to_toml

# level of a model where none is asked for
LEVEL = "motion"


@spread
def export(
    model: Annotated[
        str | None,
        typer.Argument(
            metavar="[MODEL]", help="A name that `mechsim list` gives, FILE.toml, FILE.xml or FILE.py:OBJECT."
        ),
    ] = None,
    *,
    every: Annotated[
        str | None, typer.Option("--all", metavar="DIR", help="Export every mechanism into this folder.")
    ] = None,
    scene: Annotated[str, typer.Option(help="pose, motion, dynamics or picture.")] = LEVEL,
    cut: Annotated[str | None, typer.Option(help="Joints at which to cut the loops, with commas.")] = None,
    form: Annotated[
        str, typer.Option("--format", metavar="xml|toml", help="A MuJoCo model, or the mechanism itself.")
    ] = "xml",
    timestep: Annotated[
        str | None, typer.Option(help="Time step of the file; a bare number is seconds. [default: 0.1 ms]")
    ] = None,
    asked: Annotated[Mapping[str, Any], Settings],
    driven: DriveOptions,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Place error to keep in plain MuJoCo, with a motor and a keyframe in which it turns at "
            "--speed; a bare number is metres."
        ),
    ] = None,
    speed: Annotated[
        str | None,
        typer.Option(
            help=f"Crank speed of a motor and a keyframe; a bare number is rad/s. [default: {SPEED} "
            "with --tolerance, else no motor]"
        ),
    ] = None,
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Write the MuJoCo model of a mechanism, or the mechanism as TOML."""
    wanted = scene_of(scene, cut)
    if form not in ("xml", "toml"):
        raise InputError(f"there is no format {form!r}; known are xml, toml")
    turns = speed is not None or tolerance is not None
    told = bool(asked) or timestep is not None
    if form == "toml" and (every is not None or cut is not None or turns or told or scene != LEVEL):
        raise InputError(
            "--all, --scene, --cut, --speed, --tolerance and settings are for MuJoCo models; leave them out, "
            "or --format toml"
        )
    if tolerance is not None and told:
        raise InputError("--tolerance chooses the settings by itself; leave out the others")
    if (model is None) == (every is None):
        raise InputError("export takes either one MODEL or --all DIR; give one of them")
    if every is not None:
        if sets or output or cut or turns or told or driven != DriveOptions():
            raise InputError(
                "--all exports every mechanism as it is; leave out --set, --drive, --cut, --speed, "
                "--tolerance, settings and -o"
            )
        _every(every, wanted, as_json)
        return
    assert model is not None
    place = None if output is None else writable(output, f".{form}")
    moved = form_of(model, sets, driven)
    missed = ""
    if form == "toml":
        text = to_toml(moved if isinstance(moved, LoopForm) else moved.mechanism)
    else:
        whole = scene_of(scene, cut, moved.forces)
        text, missed = _text(moved.mechanism, whole, asked, timestep, speed, tolerance)
    if place is not None:
        with files.atomic_path(place) as path:
            path.write_text(text)
    if as_json:
        whole = text if place is None else None
        print_json(
            {"mechanism": moved.name, "format": form, "output": output, "text": whole, "missed": missed}
        )
    elif place is None:
        typer.echo(text, nl=False)
    else:
        typer.echo(f"wrote {output}")
    if missed:
        if not as_json:
            typer.echo(missed, err=True)
        raise typer.Exit(1)


def _every(place: str, wanted: Scene, as_json: bool) -> None:
    """Write the models of the catalogue into a folder."""
    folder = folder_for(place)
    folder.mkdir(exist_ok=True)
    with progress("export", len(catalog.DRIVES)) as tick:
        for one in catalog.DRIVES:
            text = mjcf.to_xml(exported(catalog.make(one).mechanism, wanted))
            with files.atomic_path(folder / f"{one}.xml") as path:
                path.write_text(text)
            tick(one)
    if as_json:
        print_json({"mechanisms": list(catalog.DRIVES), "output": place})
    else:
        typer.echo(f"wrote {len(catalog.DRIVES)} models to {place}")


def _text(
    mechanism: Mechanism,
    scene: Scene,
    asked: Mapping[str, Any],
    timestep: str | None,
    speed: str | None,
    tolerance: str | None,
) -> tuple[str, str]:
    """Return the text of a model with settings, and by what it misses a tolerance; empty where not."""
    spec, rate = exported(mechanism, scene), speed_of(speed or SPEED)
    if "solref" not in asked:
        asked = {"constant_steps": TIME_CONSTANT_STEPS, **asked}
    plain_settings(asked, timestep, float(spec.option.timestep), rate).put_into(spec)
    if "drive_inertia" in asked:
        set_drive_inertia(spec, asked["drive_inertia"])
    if tolerance is None:
        return mjcf.to_xml(spec if speed is None else turning_model.turning(spec, mechanism, rate)), ""
    wanted = units.parse_length(tolerance, "the tolerance")
    if not 0.0 < wanted < float("inf"):
        raise InputError(f"the tolerance is {tolerance}; give a finite length above 0")
    with progress("export", None) as tick:
        text, error = turning_model.exported_model(spec, mechanism, rate, wanted, progress=tick)
    missed = f"no MJCF file reaches {wanted:g} m here: it errs by {error:.2g} m"
    return text, "" if error <= wanted else missed
