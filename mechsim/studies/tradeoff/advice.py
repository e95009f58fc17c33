"""What to do about a setting of a trade-off: a command, a fragment of MJCF, and lines of Python that run."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from mechsim.simulation import Settings
from mechsim.studies.tradeoff.model_builds import Build
from mechsim.studies.tradeoff.work_precision import Point


def advice(point: Point, model: str, speed: float) -> dict[str, str | None]:
    """Return what gives a point's settings.

    Args:
        point: of a trade-off.
        model: name or file that was measured.
        speed: of the crank, in [rad/s].

    Returns:
        "command": `mechsim simulate` with its options, None where it takes another drive or a reduction;
        "export": `mechsim export` of a model that has the settings, None where no file can say them;
        "xml": a fragment of MJCF, None where no file can say it all; "python": lines that run.
    """
    return {
        "command": command(point, model, speed),
        "export": exporting(point, model, speed),
        "xml": fragment(point, speed),
        "python": snippet(point, model, speed),
    }


def command(point: Point, model: str, speed: float) -> str | None:
    """Return the call of `mechsim simulate` that runs a point; None where it has no option for its model."""
    build = point.family.build
    if (build.drive, build.rod, build.variant) != (Build().drive, None, None):
        return None
    told = [_option(name, value) for name, value in _changed(point.settings).items()]
    told += [f"--cut {','.join(build.cut)}"] if build.cut else []
    told += [f"--scene {build.level}"] if build.level != Build().level else []
    return " ".join(["mechsim", "simulate", model, "--speed", f"{speed!r}rad/s", *told])


def exporting(point: Point, model: str, speed: float) -> str | None:
    """Return the call of `mechsim export` that writes a point's settings; None where no file can say them."""
    settings = point.settings
    if model.endswith(".xml") or fragment(point, speed) is None:
        return None
    # what a run makes of what it was not told
    file = replace(settings, solref=_solref(settings, speed), iterations=1, residual=0.0)
    left = {"steps_per_turn", "constant_steps", "compliance", "drive_inertia"}
    told = {one.name: getattr(file, one.name) for one in fields(Settings) if one.name not in left}
    options = [_option(name, _plain(value)) for name, value in told.items() if value is not None]
    return " ".join(["mechsim", "export", model, f"--timestep {settings.timestep(speed)!r}", *options])


def _solref(settings: Settings, speed: float) -> tuple[float, float]:
    return settings.solref or (settings.constant * settings.timestep(speed), 1.0)


def fragment(point: Point, speed: float) -> str | None:
    """Return the MJCF that says a point's settings; None where softness is scaled after compiling."""
    settings = point.settings
    if settings.compliance_used != 1.0 or point.family.build != Build():
        return None
    timestep = settings.timestep(speed)
    solref = _solref(settings, speed)
    safe = "enable" if settings.refsafe else "disable"
    exact = ' diagexact="enable"' if settings.diagexact else ""
    return (
        f'<option timestep="{timestep!r}" integrator="{settings.integrator}" iterations="1" tolerance="0">'
        f'<flag refsafe="{safe}" island="disable"{exact}/></option>\n'
        f'<default><equality solref="{_words(solref)}" solimp="{_words(settings.solimp)}"/></default>'
    )


def snippet(point: Point, model: str, speed: float) -> str:
    """Return lines of Python that run a point."""
    settings = ", ".join(f"{name}={value!r}" for name, value in _changed(point.settings).items())
    build = ", ".join(
        f"{one.name}={getattr(point.family.build, one.name)!r}"
        for one in fields(Build)
        if getattr(point.family.build, one.name) != one.default
    )
    source = f"pathlib.Path({model!r})" if model.endswith(".xml") else "source.mechanism"
    lines = ["import pathlib", ""] if model.endswith(".xml") else ["import mechsim as ms"]
    lines += ["from mechsim.simulation import Settings"]
    lines += ["from mechsim.studies.tradeoff import Build, build_model", ""]
    variants = ""
    if not model.endswith(".xml"):
        lines.append(f"source = ms.load({model!r})")
        if point.family.build.variant is not None:
            lines.append("variants = {name: one.mechanism for name, one in source.variants().items()}")
            variants = ", variants"
    lines.append(f"built = build_model({source}, None, {speed!r}, Build({build}){variants})")
    lines.append(f"motion, seconds = built.motion(Settings({settings}))")
    return "\n".join(lines)


def _changed(settings: Settings) -> dict[str, Any]:
    """Return the settings that are not the default's; steps always."""
    told = {one.name: getattr(settings, one.name) for one in fields(Settings)}
    usual = {one.name: one.default for one in fields(Settings)}
    return {
        name: _plain(value)
        for name, value in told.items()
        if name == "steps_per_turn" or value != usual[name]
    }


def _plain(value: Any) -> Any:
    return tuple(float(one) for one in value) if isinstance(value, tuple | np.ndarray) else value


def _option(name: str, value: Any) -> str:
    """Return a setting as an option of the command line."""
    name = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{name}" if value else f"--no-{name}"
    if isinstance(value, tuple):
        return f"--{name}={','.join(f'{one:.17g}' for one in value)}"
    return f"--{name} {value!r}" if isinstance(value, float) else f"--{name} {value}"


def _words(values: tuple[float, ...]) -> str:
    return " ".join(f"{one:.17g}" for one in values)
