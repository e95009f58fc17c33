"""Export a mechanism: as a MuJoCo model with settings, or as TOML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from mechsim import files
from mechsim.errors import InputError, needs
from mechsim.io.plain_joints import left_out
from mechsim.io.readers import load
from mechsim.io.toml_writer import to_toml
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import forces_of
from mechsim.mechanism.limits import Ranges
from mechsim.mechanism.mechanism import Mechanism, require_polynomials
from mechsim.mechanism.scene import Level, Scene
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.mjcf.equalities import TIME_CONSTANT_STEPS
from mechsim.simulation.mjcf.generator import set_drive_inertia
from mechsim.simulation.mjcf.joints import CRANK, limit_joints
from mechsim.simulation.settings import plain_settings
from mechsim.simulation.source import assembled
from mechsim.units import crank_speed, si

if TYPE_CHECKING:
    import mujoco

    from mechsim.studies.robots.serial_twin import SerialTwin

# level of a model, and the speed for which its settings are chosen, by default
LEVEL, SPEED = "motion", "600rpm"
SERIAL_FORMATS = ("mjcf-tree", "urdf")
DRAWINGS = ("dxf", "svg")
FORMATS = ("xml", "toml", "sdf", "usda", *DRAWINGS, *SERIAL_FORMATS)
STYLES = ("plain", "menagerie")


@dataclass(frozen=True)
class ExportedModel:
    """A mechanism as the text of a file.

    Attributes:
        name: of the mechanism.
        format: one of `FORMATS`.
        text: of the file.
        left_out: sentence on what the file cannot contain; empty if nothing is left out.
        twin: couplings of a serial twin and their errors; None for others.
    """

    name: str
    format: str
    text: str
    twin: SerialTwin | None = None
    left_out: str = ""

    def __str__(self) -> str:
        return self.text


def export(
    model: Any,
    output: str | PathLike[str] | None = None,
    *,
    set: Mapping[str, str | float] | None = None,
    format: str = "xml",
    style: str = "plain",
    independent: Sequence[str] | Mapping[str, tuple[float | str, float | str] | None] = (),
    scene: str = LEVEL,
    timestep: float | str | None = None,
    settings: Mapping[str, Any] | None = None,
    speed: float | str | None = None,
    hole: float | str | None = None,
    **options: Any,
) -> ExportedModel:
    """Return a mechanism as a MuJoCo model, as TOML, SDF, USD or drawings; write it if a path is given.

    Args:
        model: any argument of `load`.
        output: path of the file; None writes none.
        set: parameter -> its value, as for `load`.
        format: "xml", "toml", "sdf" or "usda"; "dxf" or "svg" for the links as flat plates; "mjcf-tree" or
            "urdf" for the serial twin, which has no loops.
        independent: joints of the twin that move freely, with ranges in SI or text; by default those with
            actuators, within their limits.
        style: "plain", or "menagerie": position actuators, a closed keyframe `home`, masses and geoms.
        scene: contents of the MuJoCo model: "pose", "motion", "dynamics" or "picture".
        timestep: of the file, in [s] or text; by default 0.1 ms.
        settings: fields of `Settings` that the file contains.
        speed: of a motor and a keyframe, in [rad/s] or text; by default no motor.
        hole: diameter of holes in flat plates, in [m] or text; by default 0.05 of the characteristic length.
        options: `drive`, `lock` and further arguments of `load`.

    Raises:
        InputError: for an invalid model or option.
        AssemblyError: for loops that do not close.

    Example:
        >>> ms.export("four_bar", "four_bar.xml", speed="600rpm").name
        'four_bar'
    """
    settings = settings or {}
    if independent and format not in SERIAL_FORMATS:
        raise InputError(
            "--independent applies to a serial twin; leave it out, or add "
            f"--format {' or '.join(SERIAL_FORMATS)}"
        )
    if hole is not None and format not in DRAWINGS:
        raise InputError(f"--hole applies to drawings; leave it out, or add --format {' or '.join(DRAWINGS)}")
    if format in SERIAL_FORMATS:
        loops = options.pop("loops", None)
        if style != "plain" or scene != LEVEL or any((settings, timestep, speed, *options.values())):
            raise InputError(
                "a serial twin takes --independent, --loops and --set only; leave out --style, --scene, "
                "--speed, --drive, --lock and what else changes the model"
            )
        from mechsim.studies.robots.serial_twin import serial_twin

        twin = serial_twin(model, format, independent=independent, set=set, loops=loops)
        result = ExportedModel(twin.name, format, twin.text, twin=twin)
    else:
        require_compatible(format, scene, settings, timestep, speed, style)
        loaded = isinstance(model, KinematicSolver) and not set
        solver = model if loaded else load(model, set, still=True, **options)
        solver, elsewhere = _with_formula_from(solver, Path(fspath(output or "")).parent)
        if style == "menagerie":
            text, omitted = _menagerie_text(solver, settings, timestep)
        elif format in ("sdf", "usda"):
            text, omitted = _text_of_joints(solver, format)
        elif format in DRAWINGS:
            from mechsim.pictures.flat_plates import drawing_text, flat_plates

            plates, omitted = flat_plates(solver.mechanism, si(hole, "m", "--hole"))
            text = drawing_text(plates, format)
        elif format == "toml":
            text, omitted = to_toml(solver), elsewhere
        else:
            text, omitted = _mjcf_text(solver, scene, settings, timestep, speed)
        result = ExportedModel(solver.name, format, text, left_out=omitted)
    if output is not None:
        files.write_content(Path(fspath(output)), result.text)
    return result


def _text_of_joints(solver: KinematicSolver, format: str) -> tuple[str, str]:
    """Return a mechanism as SDF or USD text, and a sentence on what is left out."""
    if format == "sdf":
        from mechsim.io.sdf import to_sdf

        return to_sdf(solver)
    with needs("usd"):
        from mechsim.io.usd_writer import to_usd
    return to_usd(solver)


def _with_formula_from(solver: KinematicSolver, folder: Path) -> tuple[KinematicSolver, str]:
    """Return a mechanism whose formula is named from a folder, or has none if it lies elsewhere, and why."""
    file, colon, function = solver.formula.rpartition(":")
    if not file:
        return solver, ""
    try:
        address = Path(file).resolve().relative_to(folder.resolve()).as_posix() + colon + function
    except ValueError:
        reason = (
            f"the formula {solver.formula} is left out, because it lies outside the folder of the written "
            "file; copy it there and name it in [formula]"
        )
        return solver.with_mechanism(solver.mechanism, formula=""), reason
    return solver.with_mechanism(solver.mechanism, formula=address), ""


def require_compatible(
    format: str,
    scene: str,
    settings: Mapping[str, Any],
    timestep: float | str | None,
    speed: float | str | None,
    style: str = "plain",
) -> None:
    """Raise InputError for an unknown format or style, or options that exclude each other."""
    if format not in FORMATS:
        raise InputError(f"there is no format {format!r}; choose from {', '.join(FORMATS)}")
    has_settings = bool(settings) or timestep is not None
    if format != "xml" and (speed is not None or has_settings or scene != LEVEL):
        raise InputError("--scene, --speed and settings are for MuJoCo models; leave them out")
    if style not in STYLES:
        raise InputError(f"there is no style {style!r}; choose from {', '.join(STYLES)}")
    own = format != "xml" or scene != LEVEL or speed is not None or "drive_inertia" in settings
    if style == "menagerie" and own:
        raise InputError(
            "the style menagerie has its own scene, actuators and keyframe; leave out --format, --scene, "
            "--speed and drive_inertia"
        )


def exported(mechanism: Mechanism, scene: Scene) -> mujoco.MjSpec:
    """Return the assembled model of a mechanism, with its picture if the scene has one.

    Raises:
        AssemblyError: if the loops do not close at the mechanism's start.
    """
    require_polynomials(mechanism, "written as MJCF")
    spec = assembled(mechanism, scene)
    if scene.holds("picture"):
        from mechsim.pictures.render.scenery import add_picture

        add_picture(spec, mechanism)
    return spec


def _menagerie_text(
    solver: KinematicSolver, settings: Mapping[str, Any], timestep: float | str | None
) -> tuple[str, str]:
    """Return the text of a model with position actuators and a closed keyframe, and what is left out."""
    from mechsim.studies.robots.menagerie import SERVO_TIMESTEP, with_servos

    scene = Scene(level="picture", forces=solver.forces)
    spec = exported(solver.mechanism, scene)
    _put_settings(spec, settings, SERVO_TIMESTEP if timestep is None else timestep, crank_speed(SPEED))
    spec = with_servos(spec, solver.mechanism, scene.acting, solver.ranges)
    return to_xml(spec), _omitted(solver, "MJCF", spec, solver.ranges)


def _put_settings(
    spec: mujoco.MjSpec, settings: Mapping[str, Any], timestep: float | str | None, speed: float
) -> None:
    """Put settings into a model, with a time constant of some steps where none is stated."""
    if "solref" not in settings:
        settings = {"constant_steps": TIME_CONSTANT_STEPS, **settings}
    plain_settings(settings, timestep, float(spec.option.timestep), speed).put_into(spec)
    if "drive_inertia" in settings:
        set_drive_inertia(spec, settings["drive_inertia"])


def _omitted(solver: KinematicSolver, container: str, spec: mujoco.MjSpec, ranges: Ranges) -> str:
    """Give a model its ranges; return a sentence on what it cannot contain."""
    dry: list[str] = []
    if rubbing := [friction.joint for friction in forces_of(solver).friction if friction.coulomb]:
        from mechsim.simulation.mjcf.force_elements import coulomb_name

        # where MuJoCo has no Coulomb friction, an actuator waits for a caller that computes it in each step
        names = [actuator.name for actuator in spec.actuators]
        dry = [joint for joint in rubbing if any(name.startswith(coulomb_name(joint)) for name in names)]
    return left_out(solver, container, limit_joints(spec, ranges), dry)


def _mjcf_text(
    solver: KinematicSolver,
    level: str,
    settings: Mapping[str, Any],
    timestep: float | str | None,
    speed: float | str | None,
) -> tuple[str, str]:
    """Return the text of a model with settings, and a sentence on what is left out."""
    scene = Scene(level=cast(Level, level), forces=solver.forces)
    spec = exported(solver.mechanism, scene)
    crank = solver.mechanism.has_crank and solver.mechanism.crank.name
    ranges = {CRANK if name == crank else name: limits for name, limits in solver.ranges.items()}
    container = "MJCF" if scene.holds("dynamics") else f"the scene {level}"
    omitted = _omitted(solver, container, spec, ranges)
    rate = crank_speed(SPEED if speed is None else speed)
    _put_settings(spec, settings, timestep, rate)
    if speed is not None:
        from mechsim.studies.scene import tune_model

        spec = tune_model.turning(spec, solver.mechanism, rate)
    return to_xml(spec), omitted
