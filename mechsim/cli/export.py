"""Command `mechsim export`: the MuJoCo model of a mechanism, or of all; the mechanism as TOML."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NotRequired, TypedDict

import typer

from mechsim import files, units
from mechsim.analytic import catalog
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.cli.command import Result, command
from mechsim.cli.options import (
    SPEED,
    DriveOptions,
    Output,
    Sets,
    folder_for,
    load_model,
    scene_of,
    speed_of,
    writable,
)
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

# level of a model by default
LEVEL = "motion"


class ExportJson(TypedDict):
    """A written model, its text without -o, or all models of the catalogue."""

    output: str | None
    mechanism: NotRequired[str]
    format: NotRequired[Literal["xml", "toml"]]
    text: NotRequired[str | None]
    shortfall: NotRequired[str]
    mechanisms: NotRequired[list[str]]


@command
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
    file_format: Annotated[
        str, typer.Option("--format", metavar="xml|toml", help="A MuJoCo model, or the mechanism itself.")
    ] = "xml",
    timestep: Annotated[
        str | None, typer.Option(help="Time step of the file; a bare number is seconds. [default: 0.1 ms]")
    ] = None,
    settings: Annotated[Mapping[str, Any], Settings],
    driven: DriveOptions,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Position error to keep in plain MuJoCo, with a motor and a keyframe in which it rotates at "
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
) -> Result[ExportJson]:
    """Write the MuJoCo model of a mechanism, or the mechanism as TOML.

    Examples:
    mechsim export four_bar --speed 600rpm -o four_bar.xml
    mechsim export gripper.xml --format toml -o gripper.toml
    """
    level = scene_of(scene, cut)
    if file_format not in ("xml", "toml"):
        raise InputError(f"there is no format {file_format!r}; known are xml, toml")
    has_motor = speed is not None or tolerance is not None
    has_settings = bool(settings) or timestep is not None
    if file_format == "toml" and (every or cut or has_motor or has_settings or scene != LEVEL):
        raise InputError(
            "--all, --scene, --cut, --speed, --tolerance and settings are for MuJoCo models; leave them out, "
            "or --format toml"
        )
    if tolerance is not None and has_settings:
        raise InputError("--tolerance chooses the settings by itself; leave out the others")
    if (model is None) == (every is None):
        raise InputError("export takes either one MODEL or --all DIR; give one of them")
    if every is not None:
        if sets or output or cut or has_motor or has_settings or driven != DriveOptions():
            raise InputError(
                "--all exports every mechanism as it is; leave out --set, --drive, --cut, --speed, "
                "--tolerance, settings and -o"
            )
        return _catalogue(every, level)
    assert model is not None
    path = None if output is None else writable(output, f".{file_format}")
    solver = load_model(model, sets, driven)
    shortfall = ""
    if file_format == "toml":
        model_text = to_toml(solver if isinstance(solver, LoopForm) else solver.mechanism)
    else:
        loaded_scene = scene_of(scene, cut, solver.forces)
        model_text, shortfall = _text(solver.mechanism, loaded_scene, settings, timestep, speed, tolerance)
    if path is not None:
        with files.atomic_path(path) as unfinished:
            unfinished.write_text(model_text)

    def text() -> None:
        if path is None:
            typer.echo(model_text, nl=False)
        else:
            typer.echo(f"wrote {output}")
        if shortfall:
            typer.echo(shortfall, err=True)

    data: Any = {"mechanism": solver.name, "format": file_format, "output": output, "shortfall": shortfall}
    data |= {"text": model_text if path is None else None}
    return Result(data, text, not shortfall)


def _catalogue(path: str, scene: Scene) -> Result[ExportJson]:
    """Write the models of the catalogue into a folder."""
    folder = folder_for(path)
    folder.mkdir(exist_ok=True)
    with progress("export", len(catalog.DRIVES)) as report:
        for name in catalog.DRIVES:
            text = mjcf.to_xml(exported(catalog.make(name).mechanism, scene))
            with files.atomic_path(folder / f"{name}.xml") as unfinished:
                unfinished.write_text(text)
            report(name)
    names = list(catalog.DRIVES)
    data: ExportJson = {"mechanisms": names, "output": path}
    return Result(data, lambda: typer.echo(f"wrote {len(names)} models to {path}"))


def _text(
    mechanism: Mechanism,
    scene: Scene,
    settings: Mapping[str, Any],
    timestep: str | None,
    speed: str | None,
    tolerance: str | None,
) -> tuple[str, str]:
    """Return the text of a model with settings, and by how much it misses a tolerance; empty where not."""
    spec, rate = exported(mechanism, scene), speed_of(speed or SPEED)
    if "solref" not in settings:
        settings = {"constant_steps": TIME_CONSTANT_STEPS, **settings}
    plain_settings(settings, timestep, float(spec.option.timestep), rate).put_into(spec)
    if "drive_inertia" in settings:
        set_drive_inertia(spec, settings["drive_inertia"])
    if tolerance is None:
        return mjcf.to_xml(spec if speed is None else turning_model.turning(spec, mechanism, rate)), ""
    length = units.parse_length(tolerance, "the tolerance")
    if not 0.0 < length < float("inf"):
        raise InputError(f"the tolerance is {tolerance}; give a finite length above 0")
    with progress("export", None) as report:
        text, error = turning_model.exported_model(spec, mechanism, rate, length, progress=report)
    shortfall = f"no MJCF file reaches {length:g} m for this model: the error is {error:.2g} m"
    return text, "" if error <= length else shortfall
