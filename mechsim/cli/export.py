"""Command `mechsim export`: the MuJoCo model of a mechanism, the mechanism in other formats, drawings."""

from dataclasses import dataclass
from typing import Annotated, Any

import typer

from mechsim.cli.command import Result, Without, command, output_file, writable
from mechsim.cli.options import DriveOptions, Sets, joint_ranges
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.simulation.settings import SettingOptions
from mechsim.studies.export import LEVEL, SERIAL_FORMATS, require_compatible
from mechsim.studies.export import export as export_model
from mechsim.units import option


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Format and contents of an exported model."""

    scene: str = option(LEVEL, "Detail of the MuJoCo model: pose, motion, dynamics or picture.")
    cam: str | None = option(
        None, "Write the profile of this joint of kind cam instead: .csv, .dxf or .svg.", metavar="JOINT"
    )
    file_format: str = option(
        "xml",
        "A MuJoCo model; the mechanism itself; its links as flat plates, 1:1 in mm (dxf, svg); or its serial "
        "twin: the tree without loops, whose passive joints follow polynomials.",
        name="--format",
        metavar="xml|toml|sdf|usda|dxf|svg|mjcf-tree|urdf",
    )
    hole: str | None = option(
        None,
        "Diameter of the holes of flat plates; a bare number is metres. [default: 0.05 of the largest link]",
    )
    independent: str | None = option(
        None,
        "Joints of the serial twin that move freely, with their ranges. [default: those with actuators, "
        "within their limits]",
        metavar="J[=A:B],...",
    )
    style: str = option(
        "plain",
        "menagerie: position actuators and the keyframe `home`.",
        metavar="plain|menagerie",
    )
    timestep: str | None = option(None, "Time step of the file; a bare number is seconds. [default: 0.1 ms]")
    speed: str | None = option(
        None,
        "Crank speed of a motor and a keyframe; a bare number is rad/s. [default: no motor]",
    )


@command
def export(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="A name from `mechsim list`, FILE.toml, .xml, .urdf, .sdf, .usd or FILE.py:OBJECT, "
            "which is code and is run.",
        ),
    ],
    *,
    options: ExportOptions,
    setting: SettingOptions,
    driven: Annotated[DriveOptions, Without("duration", "track")],
    sets: Sets = None,
    output: Annotated[
        str | None, output_file("File to write; its format is that of --format. Default: the terminal.")
    ] = None,
) -> Result:
    """Write the MuJoCo model of a mechanism, the mechanism in another format, or its links as drawings.

    Examples:
    mechsim export four_bar --speed 600rpm -o four_bar.xml
    mechsim export gripper.xml --format toml -o gripper.toml
    mechsim export klann --format dxf --hole 4mm -o klann.dxf
    """
    settings, source = setting.stated(), driven.applied_to(model, sets)
    if options.cam is not None:
        if options != ExportOptions(cam=options.cam) or settings:
            raise InputError("--cam writes a profile; leave out the options of a model")
        return _cam(source.load(), options.cam, output)
    is_twin = options.file_format in SERIAL_FORMATS
    if not is_twin:
        require_compatible(options.file_format, options.scene, settings, options.timestep, options.speed)
    if options.file_format != "toml":  # which contains the motion laws
        source.require_other_drivers()
    extension = {"mjcf-tree": "xml"}.get(options.file_format, options.file_format)
    result = export_model(
        model if is_twin else source.load(still=True),
        None if output is None else writable(output, f".{extension}"),
        independent=joint_ranges("--independent", options.independent) if options.independent else (),
        format=options.file_format,
        style=options.style,
        scene=options.scene,
        timestep=options.timestep,
        settings=settings,
        speed=options.speed,
        hole=options.hole,
        **(source.load_arguments() if is_twin else {}),
    )

    def text() -> None:
        if output is None:
            typer.echo(result.text, nl=False)
        else:
            typer.echo(f"wrote {output}")
        if result.twin is not None:
            typer.echo(result.twin.summary(), err=output is None)
        if result.left_out:
            typer.echo(result.left_out, err=True)

    data: dict[str, Any] = {"mechanism": result.name, "format": result.format, "output": output}
    data |= {"text": result.text if output is None else None, "left_out": result.left_out}
    return Result(data | {"couplings": result.twin.coupled if result.twin else ()}, text)


def _cam(solver: KinematicSolver, joint: str, output: str | None) -> Result:
    """Write the profile of a cam."""
    from mechsim.pictures.cam_files import EXTENSIONS, cam_on, cam_text, write_cam

    cam, kind, text = cam_on(solver.mechanism, joint), ".csv", None
    if output is None:
        text = cam_text(cam, kind)
    else:
        path = writable(output, *EXTENSIONS)
        kind = path.suffix.lower()
        write_cam(path, cam)
    data = {"mechanism": solver.mechanism.name, "format": kind[1:], "output": output, "text": text}
    return Result(data, lambda: typer.echo(text or f"wrote {output}", nl=text is None))
