"""Parses and compiles files and objects of MuJoCo."""

import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import mujoco
import numpy as np

from mechsim.errors import InputError, cut
from mechsim.mechanism.finding import Finding
from mechsim.mechanism.links import GROUND, Vector
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled, quiet, warnings_of_mujoco
from mechsim.simulation.mjcf_reader import repairs
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean, listed
from mechsim.simulation.mjcf_reader.file_errors import MAX_SHOWN, readable_error, require_numbers
from mechsim.simulation.mjcf_reader.file_text import UrdfFile, root_of


@dataclass(frozen=True, eq=False)
class ExactAngles:
    """A file or an object in which rounded angles between axes of joints are made exact.

    Attributes:
        source: the file or object, which remains unchanged.
        changes: name of a joint; side "a" for its body relative to the parent, "b" for its axis in the body;
            and, in the frame of the parent's or the body's link, its shift in [m] and rotation in [rad].
            Hinges and slides rotate; sites of equalities are shifted.
        finding: what is corrected.
    """

    source: "MujocoInput"
    changes: Sequence[tuple[str, str, Vector, Vector]]
    finding: Finding


# path of an MJCF or URDF file, a URDF file with its loops, an object of MuJoCo, or one of these corrected
MujocoInput: TypeAlias = str | UrdfFile | mujoco.MjSpec | mujoco.MjModel | ExactAngles
SLEEP, IPC = int(mujoco.mjtEnableBit.mjENBL_SLEEP), int(mujoco.mjtEnableBit.mjENBL_IPC)


class ParsedFile(NamedTuple):
    """A file or an object as MuJoCo reads it.

    Attributes:
        spec: its specification.
        model: its model; see the function that returns it.
        remarks: sentences on omissions and repairs.
        unread: findings on what is not read, and MuJoCo's warnings.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel | None
    remarks: list[str]
    unread: list[Finding]


@quiet()
def parse_file(source: MujocoInput) -> ParsedFile:
    """Return an MJCF or URDF file or an object with its compiled model.

    Meshes, textures and height fields with missing files are omitted, and impossible masses are repaired:
    no joint depends on them.

    Raises:
        InputError: if a file cannot be read, MuJoCo rejects it, or a number is not finite or too large.
    """
    path, (spec, unread) = model_label(source), _specification(source)
    remarks = _disable_sleep(path, spec)
    # compilation extends qpos of keyframes
    coordinate_counts = {key.name: len(key.qpos) for key in spec.keys}
    model, left_out = compile_repaired(path, spec, unread)
    require_numbers(path, spec, model, model.qpos0)
    short = [
        f"keyframe {name!r} has {count} of {model.nq} coordinates: the rest are those of the reference"
        for name, count in coordinate_counts.items()
        if 0 < count < model.nq
    ]
    return ParsedFile(spec, model, remarks + left_out + short, unread)


@quiet()
def parse_without_meshes(source: MujocoInput) -> ParsedFile:
    """Return a file or an object with boxes in place of meshes, and the model with them.

    The model is None if the specification is that of the file: if it has no meshes, if their files are
    missing, or if the compiler merges bodies.

    Raises:
        InputError: as `parse_file`.
    """
    path, (spec, unread) = model_label(source), _specification(source)
    _disable_sleep(path, spec)
    repairs.remove_textures(spec)
    if not repairs.has_replaceable_meshes(spec):
        return ParsedFile(spec, None, [], unread)
    without_meshes = spec.copy()
    model, _ = compile_repaired(path, spec)
    if not spec.meshes:  # their files are missing
        return ParsedFile(spec, None, [], unread)
    geoms = repairs.remove_meshes(without_meshes)
    repairs.copy_shapes(without_meshes, model, geoms)
    return ParsedFile(without_meshes, model, [], unread)


def _specification(source: MujocoInput) -> tuple[mujoco.MjSpec, list[Finding]]:
    """Return the specification of a file or an object, which remains unchanged, and what was not read."""
    if isinstance(source, ExactAngles):
        spec, unread = _specification(source.source)
        _make_exact(spec, source.changes)
        return spec, [*unread, source.finding]
    if isinstance(source, mujoco.MjSpec):
        return source.copy(), []
    if isinstance(source, mujoco.MjModel):
        return _spec_of_model(source), []
    file = source if isinstance(source, UrdfFile) else UrdfFile(source)
    urdf = root_of(file.path) == "robot"
    if file.loops is not None and not urdf:
        raise InputError(
            f"{file.path} is no URDF file, whose loops {file.loops} could close; write them as equalities"
        )
    try:
        with warnings_of_mujoco() as warned:
            if urdf:
                from mechsim.simulation.mjcf_reader.urdf_loops import urdf_specification

                spec, unread = urdf_specification(file)
            else:
                spec, unread = mujoco.MjSpec.from_file(file.path), list[Finding]()
    except InputError:
        raise
    except (ValueError, UnicodeError, mujoco.FatalError) as error:
        raise readable_error(file.path, error) from None
    return spec, unread + _warnings(warned)


def _make_exact(spec: mujoco.MjSpec, changes: Sequence[tuple[str, str, Vector, Vector]]) -> None:
    """Rotate bodies and axes of joints, and shift sites, in a specification, as in `ExactAngles`."""
    named = spec.copy()
    name_elements(named)
    model, _ = compile_repaired(spec.modelname, named)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)

    def in_body(body: int, components: Vector) -> Array:
        # the frame of a link is that of the ancestor with joints
        link, own = (data.xmat[i].reshape(3, 3) for i in (int(model.body_weldid[body]), body))
        return own.T @ link @ np.array(components)

    joints = dict(zip((joint.name for joint in named.joints), spec.joints, strict=True))
    closing = dict(zip((equality.name for equality in named.equalities), spec.equalities, strict=True))
    for name, side, shift, rotation in changes:
        if name not in joints:
            equality = closing.get(name)
            if equality is not None and equality.objtype == mujoco.mjtObj.mjOBJ_SITE:
                site = spec.site(equality.name1 if side == "a" else equality.name2)
                site.pos = site.pos + in_body(int(model.site(site.name).bodyid[0]), shift)
            continue
        joint, body, quaternion = joints[name], int(model.joint(name).bodyid[0]), np.zeros(4)
        axis = in_body(body if side == "b" else int(model.body_parentid[body]), rotation)
        mujoco.mju_axisAngle2Quat(quaternion, axis / (np.linalg.norm(axis) or 1.0), np.linalg.norm(axis))
        if side == "b":
            mujoco.mju_rotVecQuat(exact := np.zeros(3), model.jnt_axis[model.joint(name).id], quaternion)
            joint.axis = exact
        else:
            mujoco.mju_mulQuat(exact := np.zeros(4), quaternion, model.body_quat[body])
            joint.parent.quat, joint.parent.alt.type = exact, mujoco.mjtOrientation.mjORIENTATION_QUAT


def model_label(source: MujocoInput) -> str:
    """Return the label of a file or an object in messages."""
    if isinstance(source, ExactAngles):
        return model_label(source.source)
    if isinstance(source, str):
        return source
    if isinstance(source, UrdfFile):
        return source.path
    if isinstance(source, mujoco.MjSpec):
        return f"MjSpec {source.modelname!r}"
    return f"MjModel {source.names[: source.names.index(0)].decode()!r}" if 0 in source.names else "MjModel"


def _warnings(texts: Iterable[str]) -> list[Finding]:
    """Return MuJoCo's warnings as findings, except those on mimics, which are found with their line."""
    return [
        Finding(
            kind="unread",
            object="MuJoCo",
            value=1.0,
            message=f"MuJoCo warns: {cut(' '.join(text.split()), MAX_SHOWN)}",
            remedy="correct the file",
            line=None,
        )
        for text in dict.fromkeys(texts)
        if not text.startswith("<mimic>")
    ]


def _spec_of_model(model: mujoco.MjModel) -> mujoco.MjSpec:
    """Return the specification that compiles to a model, from the XML that MuJoCo loaded last.

    The saved XML has six digits; the exact numbers come from the model.
    """
    unknown = InputError(
        f"{model_label(model)} is not the model that MuJoCo loaded last from XML, so that its "
        "specification is unknown; give the MjSpec or the file"
    )
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "model.xml")
            mujoco.mj_saveLastXML(path, model)
            spec = mujoco.MjSpec.from_file(path)
        compiled(spec)
        spec.copy_back(model)
        same = bytes(compiled(spec).names) == bytes(model.names)
    except (mujoco.FatalError, ValueError):
        raise unknown from None
    if not same:
        raise unknown
    return spec


def _disable_sleep(path: str, spec: mujoco.MjSpec) -> list[str]:
    """Disable sleep and return a sentence on it; reject IPC contacts. States do not contain either."""
    if spec.option.enableflags & IPC:
        raise InputError(
            f"{path} asks for IPC contacts, which poses in a row cannot carry; take the flag out"
        )
    asleep = bool(spec.option.enableflags & SLEEP)
    spec.option.enableflags &= ~SLEEP
    return ["sleep is switched off: what is at rest is computed as the rest is"] if asleep else []


@quiet()
def compile_repaired(
    path: str, spec: mujoco.MjSpec, unread: list[Finding] | None = None
) -> tuple[mujoco.MjModel, list[str]]:
    """Return the model of a specification, and sentences on omissions and repairs.

    Args:
        path: path of its file.
        spec: the specification, which is repaired.
        unread: findings on the compiler's warnings are added to it.
    """
    left_out: list[str] = []
    while True:
        try:
            warned: list[str] = []
            model = compiled(spec, warned)
            if unread is not None:
                unread += _warnings(warned)
            return model, left_out
        except InputError as error:
            text = str(error)
            repair = repairs.without_missing(spec, text) or repairs.with_possible_inertias(spec, text)
            if not repair:
                raise readable_error(path, error) from None
            left_out.append(repair)


def initial_qpos(path: str, model: mujoco.MjModel, key: str | None) -> Array:
    """Return the coordinates of a keyframe, or of the reference configuration, (nq,)."""
    if key is None:
        return model.qpos0.copy()
    names = [model.key(k).name for k in range(model.nkey)]
    if key not in names:
        raise InputError(
            f"{path}: there is no keyframe {key!r}{did_you_mean(key, names)}; there are {listed(names)}"
        )
    return model.key_qpos[names.index(key)].copy()


def name_elements(spec: mujoco.MjSpec) -> None:
    """Name unnamed bodies, joints and equalities; rename a body that has the name of the frame."""
    bodies = list(spec.bodies)[1:]
    name_unnamed(bodies, [f"body{number}" for number in range(1, len(bodies) + 1)], {GROUND, "world"})
    joints = [joint for body in bodies for joint in body.joints]
    name_unnamed(joints, [f"{joint.parent.name}_joint" for joint in joints])
    equalities = list(spec.equalities)
    proposed = [
        # a coupling, such as a mimic of URDF, has the names of its joints
        f"{equality.name2}-{equality.name1}"
        if equality.type == mujoco.mjtEq.mjEQ_JOINT and equality.name2
        else f"{str(mujoco.mjtEq(equality.type).name).removeprefix('mjEQ_').lower()}{number}"
        for number, equality in enumerate(equalities, 1)
    ]
    name_unnamed(equalities, proposed)


def name_unnamed(elements: Iterable[Any], proposed: Iterable[str], reserved: Iterable[str] = ()) -> None:
    """Give unnamed elements the proposed names, numbered where these are in use or reserved."""
    elements = list(elements)
    names = {*reserved, *(element.name for element in elements)}
    for element, name in zip(elements, proposed, strict=True):
        if not element.name:
            numbered = (name, *(f"{name}{count}" for count in range(2, len(names) + 3)))
            element.name = next(free for free in numbered if free not in names)
            names.add(element.name)
