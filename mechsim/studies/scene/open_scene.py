"""The scene of a model and its prescribed motion: of an MJCF file, or of any other model written as one."""

import re
import shlex
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.io.law_text import control_laws, python_expression
from mechsim.io.prescription import duration_of
from mechsim.io.readers import load
from mechsim.kinematics.loops.joint_locks import undetermined_joints
from mechsim.mechanism.links import Vector
from mechsim.mechanism.mechanism import described
from mechsim.mechanism.motion_laws import State, steady
from mechsim.mechanism.scene import Scene
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled
from mechsim.studies.scene.scene import UserScene, scene_of
from mechsim.units import si


@contextmanager
def scene_file(model: Any) -> Generator[str]:
    """Yield the path of a model's MJCF file; for other models the file is temporary.

    Args:
        model: an MJCF file, or any input of `mechsim.load`.
    """
    if isinstance(model, str | PathLike) and fspath(model).lower().endswith(".xml"):
        yield fspath(model)
        return
    solver = load(model, still=True)
    if solver.source is not None:
        spec = solver.source.spec.copy()
    else:
        spec = assembled(described(solver), Scene(level="dynamics", forces=solver.forces))
    with TemporaryDirectory(prefix="mechsim-") as folder:
        path = Path(folder) / f"{solver.name.replace(' ', '_')}.xml"
        path.write_text(to_xml(spec), encoding="utf-8")
        yield str(path)


def open_scene(
    path: str,
    *,
    ctrl: Mapping[str, str | float] | None = None,
    track: Iterable[str] = (),
    key: str | None = None,
    duration: str | float | None = None,
    **options: Any,
) -> tuple[UserScene, tuple[str, ...]]:
    """Return the scene of an MJCF file and its prescribed motion, and notes on changes made to read it.

    Args:
        path: path of the file.
        ctrl: actuator -> its control as text, such as "255*(0.5-0.5*cos(2*pi*t))", "FILE.csv" or a number.
        track: recorded points, as for `mechsim.load`.
        key: initial keyframe.
        duration: in [s] or as text; by default that of the motion laws.
        options: `drive`, `lock` and other arguments of `mechsim.load`.

    Raises:
        InputError: for a joint, actuator, keyframe or point that is missing.
        AssemblyError: if the loops do not close at the start of the motion laws.
    """
    seconds = si(duration, "s", "the duration")
    # without motion laws of joints the duration is that of the controls
    driven = bool(options.get("drive"))
    own = seconds if driven else None
    solver = load(path, track=track, key=key, duration=own, still=not driven, **options)
    mechanism = solver.mechanism
    if not mechanism.drivers:
        # actuators between sites: closure is measured at independent joints
        mechanism = replace(mechanism, driver=tuple(undetermined_joints(mechanism)))
    joint_laws = dict(solver.motion_laws.by_name)
    joint_laws |= {name: steady(value, 0.0) for name, value in solver.mechanism.locked.items()}
    controls = control_laws({name: str(law) for name, law in (ctrl or {}).items()})
    laws: dict[str, State] = {**joint_laws, **controls}
    points: dict[str, tuple[str, Vector]] | None = dict(solver.mechanism.points) if track else None
    scene = scene_of(
        solver.source,
        mechanism,
        joint_laws=joint_laws,
        ctrl=controls,
        duration=duration_of(seconds, None, laws),
        points=points,
        key=key,
        started=bool(options.get("start")),
    )
    return scene, tuple(f"{solver.name}: {fact}" for fact in solver.facts)


def require_mjcf(path: str) -> None:
    """Raise InputError for a model that is not an MJCF file, whose settings could be changed."""
    if not path.lower().endswith(".xml"):
        written = shlex.quote(f"{Path(path).stem}.xml")
        raise InputError(
            f"{path!r} is not an MJCF file, whose MuJoCo settings this command changes; write one with "
            f"`mechsim export {shlex.quote(path)} -o {written}` and name that file"
        )


def python_laws(scene: UserScene) -> dict[str, str]:
    """Return the laws of joints and controls as Python expressions of t: name -> expression."""
    return {name: _expression(law) for name, law in {**scene.joint_laws, **scene.ctrl}.items()}


def _expression(law: State) -> str:
    text = getattr(law, "text", "")
    if text.lower().endswith(files.EXTENSIONS):
        return f"table({text!r})(t)"
    if re.search(r"\bt\b", text):
        return python_expression(text)
    value, rate, _ = (float(item[0]) for item in law(np.zeros(1)))
    return repr(value) if not rate else f"{value!r} + {rate!r} * t"
