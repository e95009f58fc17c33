"""Writing of tuned settings into the text of a scene, and of a script that runs it; reading the file back."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from mechsim.errors import InputError, MechsimError
from mechsim.files import atomic_path
from mechsim.simulation.mjcf import edited_text
from mechsim.simulation.mjcf.compiling import plainly_compiled, quiet
from mechsim.simulation.mjcf.included_files import moved_to, read_text, with_included
from mechsim.simulation.mjcf_reader.fixed_bodies import FixedBodies
from mechsim.simulation.mjcf_reader.parsed_file import parse_file
from mechsim.simulation.plain_settings import FLAGS, OPTIONS, PlainSettings
from mechsim.studies.scene.scene import RK4, UserScene

# keyframe at the start of a prescribed motion
KEY = "mechsim_start"
# largest relative difference of a number after reading it back
READ_TOLERANCE = 1e-12
MERGE_HINT = "write one file without includes (mujoco.MjSpec.from_file(...).to_xml()) and tune that"
# fields that do not affect a run
_IGNORED_FIELDS = ("key", "name", "text", "bvh", "oct_", "paths", "stat", "vis", "tex", "mat_")
_IGNORED_SIZES = ("nbuffer", "nkey", "nnames", "npaths", "nnames_map", "signature")
# script that runs a tuned file in plain MuJoCo
SCRIPT = Path(__file__).with_name("tuned_script.py.txt")


@dataclass(frozen=True)
class TunedText:
    """The text of a scene with other settings.

    Attributes:
        before: the original text, with the included files that change.
        after: the text to be written.
        included: names of the included files that change.
    """

    before: str
    after: str
    included: tuple[str, ...]


def tuned_text(scene: UserScene, settings: PlainSettings, comment: Sequence[str], folder: Path) -> TunedText:
    """Return the text of a scene with settings, virtual drive inertia and initial keyframe.

    Args:
        scene: the scene.
        settings: settings that a file can contain.
        comment: lines of a comment at the beginning.
        folder: folder of the written file.

    Raises:
        InputError: if the text lacks an equality or joint to change, as for an attached model.
    """
    source = Path(scene.path).resolve().parent
    values = settings.as_dict()
    compliance = {name: _numbers(values[name]) for name in ("solref", "solimp") if name in values}
    options = {name: _word(values[name]) for name in OPTIONS if name in values}
    flags = {name: values[name] for name in FLAGS if name in values}
    if scene.joint_laws:
        options.setdefault("tolerance", _word(float(scene.model.opt.tolerance)))

    def concerned(root: edited_text.Element) -> bool:
        sections = {child.tag for child in root.children}
        joints = {joint.attributes.get("name") for joint in root.every("joint")}
        return bool(
            (compliance and sections & {"equality"})
            or ((options or flags) and "option" in sections)
            or joints & {*scene.joint_laws}
            or (scene.fixed_bodies and ("keyframe" in sections or _bodies(root, scene.fixed_bodies.poses)))
        )

    before, included = with_included(read_text(scene.path), source, concerned)
    before = moved_to(before, source, folder)
    edited = edited_text.EditedText(before)
    if compliance:
        if len(edited_text.equality_elements(edited.root)) != scene.model.neq:
            raise InputError(
                f"{scene.path}: {scene.model.neq - len(edited_text.equality_elements(edited.root))} of its "
                f"equality constraints are missing in its text, as those of attached models; {MERGE_HINT}"
            )
        edited_text.set_compliance(edited, compliance)
    edited_text.set_options(edited, options, flags)
    if scene.fixed_bodies is not None:
        _fix_bodies(scene, edited, scene.fixed_bodies)
    for name, (inertia, _) in scene.drive_inertias.items():
        edited.set(_joint(scene, edited.root, name), "armature", _word(inertia))
    if scene.own_start:
        state = dict(zip(("qpos", "qvel"), scene.start, strict=True))
        keyframe = scene.keyframe_values if scene.key is not None else {}
        values = {
            name: _numbers(value.tolist()) for name, value in (state | dict(keyframe)).items() if len(value)
        }
        edited_text.put_key(edited, KEY, values)
    if comment:
        edited_text.put_comment(edited, comment)
    return TunedText(before, edited.result, included)


def _joint(scene: UserScene, root: edited_text.Element, name: str) -> edited_text.Element:
    for joint in root.every("joint"):
        if joint.attributes.get("name") == name and joint.within("worldbody") is not None:
            return joint
    raise InputError(f"{scene.path}: its text has no joint named {name!r}; name the driven joint in the text")


def _bodies(root: edited_text.Element, names: Collection[str]) -> list[edited_text.Element]:
    return [body for body in root.every("body") if body.attributes.get("name") in names]


def _fix_bodies(scene: UserScene, edited: edited_text.EditedText, fixed: FixedBodies) -> None:
    """Remove the joints of fixed bodies, and their coordinates in keyframes; exclude their contacts."""
    if fixed.excluded:
        pairs = (f"  <exclude body1={quoteattr(a)} body2={quoteattr(b)}/>\n" for a, b in fixed.excluded)
        edited.put_first(edited.root, f"<contact>\n{''.join(pairs)}</contact>")
    for body in _bodies(edited.root, fixed.poses):
        name = body.attributes["name"]
        joints = [child for child in body.children if child.tag in ("joint", "freejoint")]
        if not fixed.order[name] < len(joints):
            raise InputError(f"{scene.path}: the text of {name} does not contain its joints; {MERGE_HINT}")
        edited.remove(joints[fixed.order[name]])
        if name in fixed.moved:
            rotated = {"euler", "axisangle", "xyaxes", "zaxis"} & {*body.attributes}
            if rotated or fixed.order[name] or body.within("frame") is not None:
                raise InputError(f"{scene.path}: {name} cannot be moved in its text; {MERGE_HINT}")
            edited.set(body, "pos", _numbers(fixed.poses[name][:3].tolist()))
            edited.set(body, "quat", _numbers(fixed.poses[name][3:].tolist()))
    for key in edited.root.every("key"):
        for attribute, kept in (("qpos", fixed.qpos), ("qvel", fixed.qvel)):
            if attribute in key.attributes:
                values = np.array(key.attributes[attribute].split(), dtype=np.float64)
                edited.set(key, attribute, _numbers(values[kept].tolist()))


def _numbers(values: Sequence[float]) -> str:
    return " ".join(_word(float(value)) for value in values)


def _word(value: object) -> str:
    """Return a value as MJCF text; numbers have full precision."""
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e6 else repr(value)
    return str(value)


@quiet()
def write_scene(
    scene: UserScene,
    settings: PlainSettings,
    text: str,
    path: Path,
    finish: Callable[[UserScene], str] | None = None,
) -> UserScene:
    """Write a text and return its scene, as plain MuJoCo loads the file.

    Args:
        scene: the scene.
        settings: settings contained in the text.
        text: the text to write and read back.
        path: path of the file.
        finish: returns the final text: the same text with a comment on the result of a run of the file.

    Raises:
        InputError: if MuJoCo rejects the file, or reads other values than were written.
        OutputError: if the file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
        try:
            model = plain_model(str(temporary))
        except MechsimError as error:
            raise InputError(
                f"{scene.path}: MuJoCo rejects the tuned text: {error}; write it to the folder of the scene"
            ) from None
        differences = differing(settings.applied(scene.model), model)
        if differences:
            raise InputError(
                f"{scene.path}: the tuned text, read back, differs in {', '.join(differences[:3])}; "
                f"{MERGE_HINT}"
            )
        key = KEY if scene.own_start else scene.key
        written_scene = replace(scene, path=str(path), model=model, fixed_bodies=None, key=key)
        if finish is not None:
            temporary.write_text(finish(written_scene), encoding="utf-8", newline="")
    return written_scene


@quiet()
def plain_model(path: str) -> mujoco.MjModel:
    """Return the model of a file as plain MuJoCo compiles it, without assets whose files are missing."""
    try:
        return mujoco.MjModel.from_xml_path(path)
    except ValueError:
        return plainly_compiled(parse_file(path)[0])


def differing(expected: mujoco.MjModel, actual: mujoco.MjModel) -> list[str]:
    """Return the names of fields and options that differ between two models and can affect a run."""
    fields = [
        name
        for name in dir(expected)
        if not name.startswith(("_", *_IGNORED_FIELDS))
        and name not in _IGNORED_SIZES
        and not name.endswith("pathadr")
    ]
    options = [name for name in dir(expected.opt) if not name.startswith("_")]
    pairs = {name: (getattr(expected, name), getattr(actual, name)) for name in fields}
    pairs |= {f"option {name}": (getattr(expected.opt, name), getattr(actual.opt, name)) for name in options}
    return [name for name, (a, b) in pairs.items() if _differ(a, b)]


def _differ(a: object, b: object) -> bool:
    if not isinstance(a, int | float) and not (isinstance(a, np.ndarray) and a.dtype.kind in "fiub"):
        return False
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.shape != second.shape:
        return True
    equal = np.abs(first - second) <= READ_TOLERANCE * np.maximum(1.0, np.abs(first))
    return not (equal.all() or np.array_equal(first, second))


def setting_changes(scene: UserScene, settings: PlainSettings) -> Mapping[str, str]:
    """Return the settings that change a scene: setting -> value as text."""
    values = settings.changes_to(scene.model).as_dict().items()
    return {name: _numbers(value) if isinstance(value, tuple) else _word(value) for name, value in values}


def control_lines(scene: UserScene, expressions: Mapping[str, str]) -> list[str]:
    """Return the lines of Python that set MuJoCo's inputs before each step; t is the time, h the step.

    Args:
        scene: the scene; its model has the settings of the run.
        expressions: joint or actuator -> its motion law as an expression of t.
    """
    model = scene.model
    lines = [
        f"data.ctrl[{index}] = {expressions[name]}"
        for name, index in zip(scene.ctrl, scene.controlled, strict=True)
    ]
    for name, dof in zip(scene.joint_laws, scene.driven_dofs, strict=True):
        force = f"data.qfrc_applied[{dof}] = {scene.drive_inertias[name][0]!r}"
        if model.opt.integrator == RK4:
            lines.append(f"{force} * (rate({name!r}, t + h) - rate({name!r}, t)) / h")
        else:
            address = int(model.jnt_qposadr[scene.driven_joints[name]])
            lines.append(
                f"{force} * ((q({name!r}, t + h) - data.qpos[{address}]) / h - data.qvel[{dof}]) / h"
            )
    return lines


def python_of(scene: UserScene, file: Path, expressions: Mapping[str, str]) -> str:
    """Return a script that runs a tuned file in plain MuJoCo; its `steps()` yields the data after every step.

    Args:
        scene: scene of the file; its model has the settings of the run.
        file: path of the file; the script is written to the same folder.
        expressions: joint or actuator -> its motion law as an expression of t.
    """
    laws = [f"    if joint == {name!r}:\n        return {expressions[name]}\n" for name in scene.joint_laws]
    reset = f"    mujoco.mj_resetDataKeyframe(model, data, model.key({scene.key!r}).id)\n"
    return SCRIPT.read_text(encoding="utf-8").format(
        file=file.name,
        laws="".join(laws),
        duration=scene.duration,
        reset="" if scene.key is None else reset,
        controls="".join(f"        {line}\n" for line in control_lines(scene, expressions)),
    )
