"""Command `mechsim export`: the MuJoCo model of a mechanism, or of all."""

from typing import Annotated

import typer

from mechsim import files
from mechsim.analytic import catalog
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.cli.declared_options import spread
from mechsim.cli.options import (
    DriveOptions,
    Output,
    Sets,
    folder_for,
    forces_of,
    form_of,
    scene_of,
    writable,
)
from mechsim.cli.output import progress
from mechsim.errors import InputError
from mechsim.pictures.render.exported_scene import exported
from mechsim.simulation import mjcf
from mechsim.subjects.toml_writer import toml_of


@spread
def export(
    model: Annotated[
        str | None,
        typer.Argument(metavar="[MODEL]", help="A catalogue name, FILE.toml or FILE.py:OBJECT."),
    ] = None,
    *,
    every: Annotated[
        str | None, typer.Option("--all", metavar="DIR", help="Export every mechanism into this folder.")
    ] = None,
    scene: Annotated[str, typer.Option(help="pose, motion, dynamics or picture.")] = "motion",
    cut: Annotated[str | None, typer.Option(help="Joints at which to cut the loops, with commas.")] = None,
    form: Annotated[
        str, typer.Option("--format", metavar="xml|toml", help="A MuJoCo model, or the mechanism itself.")
    ] = "xml",
    driven: DriveOptions,
    sets: Sets = None,
    output: Output = None,
) -> None:
    """Write the MuJoCo model of a mechanism, or the mechanism as TOML."""
    wanted = scene_of(scene, cut)
    if form not in ("xml", "toml"):
        raise InputError(f"there is no format {form!r}; known are xml, toml")
    if form == "toml" and (every is not None or cut is not None):
        raise InputError("--all and --cut are for MuJoCo models; leave them out, or --format toml")
    if (model is None) == (every is None):
        raise InputError("export takes either one MODEL or --all DIR; give one of them")
    if every is not None:
        if sets or output or cut or driven != DriveOptions():
            raise InputError("--all exports every mechanism as it is; leave out --set, --drive, --cut and -o")
        folder = folder_for(every)
        with progress("export", len(catalog.DRIVES)) as tick:
            for one in catalog.DRIVES:
                text = mjcf.to_xml(exported(catalog.make(one).mechanism, wanted))
                with files.written_beside(folder / f"{one}.xml") as path:
                    path.write_text(text)
                tick(one)
        typer.echo(f"wrote {len(catalog.DRIVES)} models to {every}")
        return
    assert model is not None
    place = None if output is None else writable(output, f".{form}")
    moved = form_of(model, sets, driven)
    if form == "toml":
        text = toml_of(moved if isinstance(moved, LoopForm) else moved.mechanism)
    else:
        text = mjcf.to_xml(exported(moved.mechanism, scene_of(scene, cut, forces_of(moved))))
    if place is None:
        typer.echo(text, nl=False)
        return
    with files.written_beside(place) as path:
        path.write_text(text)
    typer.echo(f"wrote {output}")
