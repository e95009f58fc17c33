"""A user's scene written with other settings into its own text, and read back as plain MuJoCo reads it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.files import written_beside
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf_reader.fixed_bodies import FixedBodies
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.simulation.mjcf_text.edited_text import (
    EditedText,
    Element,
    equality_elements,
    put_comment,
    put_key,
    set_compliance,
    set_options,
)
from mechsim.simulation.mjcf_text.included_files import moved_to, read_text, with_included
from mechsim.studies.scene.scene import RK4, UserScene
from mechsim.studies.scene.settings import FLAGS, OPTIONS, PlainSettings

# keyframe in which a prescribed motion begins
KEY = "mechsim_start"
# what a file read back may differ by from what was meant, of each number
SAME = 1e-12
WHOLE = "write it out whole first (mujoco.MjSpec.from_file(...).to_xml()) and tune that"
# what no run depends on
_APART = ("key", "name", "text", "bvh", "oct_", "paths", "stat", "vis", "tex", "mat_")
_SIZES = ("nbuffer", "nkey", "nnames", "npaths", "nnames_map", "signature")


@dataclass(frozen=True)
class TunedText:
    """The text of a scene with other settings.

    Attributes:
        before: the user's own, with the files put in that had to be changed.
        after: what is to be written.
        put_in: the included files that were put in.
    """

    before: str
    after: str
    put_in: tuple[str, ...]


def tuned_text(scene: UserScene, settings: PlainSettings, comment: Sequence[str], place: Path) -> TunedText:
    """Return the text of a scene with settings, and with what its prescribed joints need.

    Args:
        scene: the scene.
        settings: that a file can say.
        comment: lines to say at its beginning.
        place: the folder in which it will lie.

    Raises:
        InputError: where a row or joint that is to change stands in no text, as of an attached model.
    """
    folder = Path(scene.path).resolve().parent
    told = settings.as_dict()
    softness = {name: _numbers(told[name]) for name in ("solref", "solimp") if name in told}
    options = {name: _word(told[name]) for name in OPTIONS if name in told}
    flags = {name: told[name] for name in FLAGS if name in told}
    if scene.drive:
        options.setdefault("tolerance", _word(float(scene.model.opt.tolerance)))

    def concerned(root: Element) -> bool:
        sections = {one.tag for one in root.children}
        joints = {one.attributes.get("name") for one in root.every("joint")}
        return bool(
            (softness and sections & {"equality"})
            or ((options or flags) and "option" in sections)
            or joints & {*scene.drive}
            or (scene.still and ("keyframe" in sections or _bodies(root, scene.still.poses)))
        )

    before, put_in = with_included(read_text(scene.path), folder, concerned)
    before = moved_to(before, folder, place)
    edited = EditedText(before)
    if softness:
        if len(equality_elements(edited.root)) != scene.model.neq:
            raise InputError(
                f"{scene.path}: {scene.model.neq - len(equality_elements(edited.root))} of its "
                f"equality constraints stand in no text of its own, as those of attached models; {WHOLE}"
            )
        set_compliance(edited, softness)
    set_options(edited, options, flags)
    if scene.still is not None:
        _hold_still(scene, edited, scene.still)
    for name, (inertia, _) in scene.wheels.items():
        edited.set(_joint(scene, edited.root, name), "armature", _word(inertia))
    if scene.own_start:
        state = dict(zip(("qpos", "qvel"), scene.start, strict=True))
        beside = scene.standing if scene.key is not None else {}
        told = {
            name: _numbers(value.tolist()) for name, value in (state | dict(beside)).items() if len(value)
        }
        put_key(edited, KEY, told)
    if comment:
        put_comment(edited, comment)
    return TunedText(before, edited.result, put_in)


def _joint(scene: UserScene, root: Element, name: str) -> Element:
    for one in root.every("joint"):
        if one.attributes.get("name") == name and one.within("worldbody") is not None:
            return one
    raise InputError(
        f"{scene.path}: no joint in its text is called {name!r}; give the driven joint a name there"
    )


def _bodies(root: Element, names: Collection[str]) -> list[Element]:
    return [one for one in root.every("body") if one.attributes.get("name") in names]


def _hold_still(scene: UserScene, edited: EditedText, still: FixedBodies) -> None:
    """Take away the balls and free joints that are held, and what keyframes say of them."""
    for body in _bodies(edited.root, still.poses):
        name = body.attributes["name"]
        joints = [one for one in body.children if one.tag in ("joint", "freejoint")]
        if not still.order[name] < len(joints):
            raise InputError(f"{scene.path}: the text of {name} does not hold its own joints; {WHOLE}")
        edited.take_away(joints[still.order[name]])
        if name in still.moved:
            turned = {"euler", "axisangle", "xyaxes", "zaxis"} & {*body.attributes}
            if turned or still.order[name] or body.within("frame") is not None:
                raise InputError(f"{scene.path}: {name} cannot be put elsewhere in its text; {WHOLE}")
            edited.set(body, "pos", _numbers(still.poses[name][:3].tolist()))
            edited.set(body, "quat", _numbers(still.poses[name][3:].tolist()))
    for section in edited.root.children:
        for one in section.children if section.tag == "keyframe" else ():
            for what, kept in (("qpos", still.qpos), ("qvel", still.qvel)):
                if what in one.attributes:
                    values = np.array(one.attributes[what].split(), dtype=np.float64)
                    edited.set(one, what, _numbers(values[kept].tolist()))


def _numbers(values: Sequence[float]) -> str:
    return " ".join(_word(float(value)) for value in values)


def _word(value: object) -> str:
    """Return a value as MJCF has it, numbers to the last bit."""
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e6 else repr(value)
    return str(value)


@quiet()
def written(
    scene: UserScene,
    settings: PlainSettings,
    text: str,
    place: Path,
    finish: Callable[[UserScene], str] | None = None,
) -> UserScene:
    """Write a text and return its scene, as plain MuJoCo loads the file.

    Args:
        scene: the scene.
        settings: that the text has.
        text: what is read back.
        place: where it is written.
        finish: returns the text that stays, the same with a comment on what a run of the file gave.

    Raises:
        InputError: where MuJoCo refuses what was written, or reads something else than was meant.
        OutputError: where it cannot be written.
    """
    with written_beside(place) as beside:
        beside.write_text(text, encoding="utf-8", newline="")
        try:
            model = plain_model(str(beside))
        except MechsimError as error:
            raise InputError(
                f"{scene.path}: the tuned text is refused: {error}; tune it beside its file"
            ) from None
        other = differing(settings.applied(scene.model), model)
        if other:
            raise InputError(
                f"{scene.path}: read back, the tuned text differs in {', '.join(other[:3])}; {WHOLE}"
            )
        outside = _outside(scene, model, place)
        if finish is not None:
            beside.write_text(finish(outside), encoding="utf-8", newline="")
    return outside


def _outside(scene: UserScene, model: mujoco.MjModel, place: Path) -> UserScene:
    return replace(scene, path=str(place), model=model, still=None, key=KEY if scene.own_start else scene.key)


@quiet()
def plain_model(path: str) -> mujoco.MjModel:
    """Return the model of a file as plain MuJoCo compiles it; without assets whose files are missing."""
    try:
        return mujoco.MjModel.from_xml_path(path)
    except ValueError:
        return plainly_compiled(parse_file(path)[0])


def differing(meant: mujoco.MjModel, found: mujoco.MjModel) -> list[str]:
    """Return the names of what differs between two models in a way that a run may feel."""
    out: list[str] = []
    for name in dir(meant):
        if name.startswith(("_", *_APART)) or name in _SIZES or name.endswith("pathadr"):
            continue
        out += [name] if _unlike(getattr(meant, name), getattr(found, name)) else []
    for name in dir(meant.opt):
        if not name.startswith("_") and _unlike(getattr(meant.opt, name), getattr(found.opt, name)):
            out.append(f"option {name}")
    return out


def _unlike(a: object, b: object) -> bool:
    if isinstance(a, int | float):
        return not _close(np.array([float(a)]), np.array([float(b)]))  # pyright: ignore[reportArgumentType]
    if isinstance(a, np.ndarray) and a.dtype.kind in "fiub":
        assert isinstance(b, np.ndarray)
        return a.shape != b.shape or not _close(a.astype(np.float64), b.astype(np.float64))
    return False


def _close(a: Array, b: Array) -> bool:
    return bool(np.all(np.abs(a - b) <= SAME * np.maximum(1.0, np.abs(a)))) or bool(np.array_equal(a, b))


def changes(scene: UserScene, settings: PlainSettings) -> Mapping[str, str]:
    """Return what settings change of a scene, setting -> value in words."""
    told = settings.without_idle(scene.model).as_dict()
    return {
        name: _numbers(value) if isinstance(value, tuple) else _word(value) for name, value in told.items()
    }


FUNCTIONS = "acos, asin, atan, atan2, cos, exp, log, pi, sin, sqrt, tan"
# option -> its value as MuJoCo's Python has it
NUMBERS: dict[str, Callable[[object], str]] = {
    "integrator": lambda value: f"mujoco.mjtIntegrator.mjINT_{str(value).upper()}",
    "solver": lambda value: f"mujoco.mjtSolver.mjSOL_{str(value).upper()}",
    "jacobian": lambda value: f"mujoco.mjtJacobian.mjJAC_{str(value).upper()}",
}


def feeding(scene: UserScene, said: Mapping[str, str]) -> list[str]:
    """Return the lines that give MuJoCo its inputs before each step, t being the time and h the step.

    Args:
        scene: the scene, its model with the settings by which it is stepped.
        said: joint or actuator -> its program as an expression of t.
    """
    model = scene.model
    lines = [f"data.ctrl[{of}] = {said[name]}" for name, of in zip(scene.ctrl, scene.fed, strict=True)]
    for name, dof in zip(scene.drive, scene.driven_dofs, strict=True):
        force = f"data.qfrc_applied[{dof}] = {scene.wheels[name][0]!r}"
        if model.opt.integrator == RK4:
            lines.append(f"{force} * (rate({name!r}, t + h) - rate({name!r}, t)) / h")
        else:
            place = int(model.jnt_qposadr[scene.driven_joints[name]])
            lines.append(f"{force} * ((q({name!r}, t + h) - data.qpos[{place}]) / h - data.qvel[{dof}]) / h")
    return lines


def python_of(
    scene: UserScene,
    file: Path,
    said: Mapping[str, str],
    *,
    changed: Mapping[str, object] | None = None,
    heading: str = "Runs a tuned scene in plain MuJoCo.",
) -> str:
    """Return a script that runs a tuned file in plain MuJoCo; its `steps()` yields the data after every step.

    Args:
        scene: the scene of the file, its model with the settings by which it is stepped.
        file: its path; the script lies beside it.
        said: joint or actuator -> its program as an expression of t.
        changed: settings that differ from the file's, as `PlainSettings` has them.
        heading: its docstring.
    """
    lines = [f'"""{heading}"""', "", f"from math import {FUNCTIONS}  # noqa: F401"]
    lines += ["from pathlib import Path", "", "import mujoco"]
    tables = any("table(" in one for one in said.values())
    lines += ["import numpy as np", "from scipy.interpolate import make_interp_spline"] if tables else []
    lines += ["", f'model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("{file.name}")))']
    lines += _changed(changed or {})
    if tables:
        lines += _table_lines()
    if scene.drive:
        lines += _program_lines(scene, said)
    lines += ["", "", f"def steps(duration={scene.duration!r}):"]
    lines += ['    """Yield MuJoCo\'s data after every step."""']
    lines += ["    data, h = mujoco.MjData(model), model.opt.timestep"]
    if scene.key is not None:
        lines.append(f"    mujoco.mj_resetDataKeyframe(model, data, model.key({scene.key!r}).id)")
    lines += ["    for step in range(round(duration / h)):", "        t = step * h"]
    lines += [f"        {line}" for line in feeding(scene, said)]
    lines += ["        mujoco.mj_step(model, data)", "        yield data", "", ""]
    lines += ['if __name__ == "__main__":', "    for data in steps():", "        pass"]
    lines += ["    print(data.time, data.qpos)", ""]
    return "\n".join(lines)


def _changed(settings: Mapping[str, object]) -> list[str]:
    """Return the lines that change settings of a loaded model."""
    lines: list[str] = []
    for name, value in settings.items():
        if name in FLAGS:
            bit, off = FLAGS[name]
            field = "disableflags" if off else "enableflags"
            lines.append(f"model.opt.{field} {f'|= {bit}' if value != off else f'&= ~{bit}'}  # {name}")
        elif name in ("solref", "solimp"):
            lines.append(f"model.eq_{name}[:] = {value!r}")
        elif name == "compliance":
            lines += [
                "# softness is scaled by these weights, and no file can say them",
                f"model.body_invweight0[:] *= {value:g}",
                f"model.dof_invweight0[:] *= {value:g}",
            ]
        else:
            number = NUMBERS[name](value) if name in NUMBERS else repr(value)
            lines.append(f"model.opt.{name} = {number}")
    return lines


def _program_lines(scene: UserScene, said: Mapping[str, str]) -> list[str]:
    """Return the functions that say where prescribed joints are, and how fast."""
    lines = ["", "", "def q(joint, t):", '    """Where a prescribed joint is."""']
    lines += [f"    if joint == {name!r}:\n        return {said[name]}" for name in scene.drive]
    lines += ["    raise KeyError(joint)"]
    if scene.model.opt.integrator == RK4:
        near = "8 * (q(joint, t + d) - q(joint, t - d)) - q(joint, t + 2 * d) + q(joint, t - 2 * d)"
        lines += ["", "", "def rate(joint, t, d=1e-4):", '    """How fast it is there."""']
        lines += [f"    return ({near}) / (12 * d)"]
    return lines


def _table_lines() -> list[str]:
    """Return the function that reads a program from a table of t and value, joined as mechsim joins it."""
    return [
        "",
        "",
        "def table(path):",
        '    """Return a function of t from the columns of a file."""',
        '    columns = np.genfromtxt(path, delimiter=",", names=True)',
        '    value = next(name for name in columns.dtype.names if name not in ("t", "time"))',
        "    return make_interp_spline(columns[columns.dtype.names[0]], columns[value], k=5)",
    ]
