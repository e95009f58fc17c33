"""Parses and compiles files and objects of MuJoCo."""

import os
import re
import stat
import tempfile
import warnings
from collections.abc import Iterable
from typing import Any, TypeAlias

import mujoco

from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import compiled, quiet
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean, listed
from mechsim.simulation.mjcf_reader.file_errors import readable_error
from mechsim.simulation.mjcf_reader.repairs import (
    copy_shapes,
    has_replaceable_meshes,
    remove_meshes,
    remove_textures,
    with_possible_inertias,
    without_missing,
)
from mechsim.simulation.mjcf_reader.urdf_loops import urdf_specification

# path of an MJCF or URDF file, or an object of MuJoCo
MujocoInput: TypeAlias = str | mujoco.MjSpec | mujoco.MjModel
# maximum size of a file in bytes
MAX_BYTES = 50_000_000
_COMMENT = re.compile(r"<!--.*?-->|<\?.*?\?>|<!DOCTYPE[^>\[]*(?:\[.*?\]\s*)?>", re.DOTALL | re.IGNORECASE)
_ROOT = re.compile(r"\s*<([A-Za-z_][\w.:-]*)")
# first line of a pointer file of Git LFS
_POINTER = "version https://git-lfs"
SLEEP, IPC = int(mujoco.mjtEnableBit.mjENBL_SLEEP), int(mujoco.mjtEnableBit.mjENBL_IPC)


@quiet()
def parse_file(source: MujocoInput) -> tuple[mujoco.MjSpec, mujoco.MjModel, list[str]]:
    """Return the specification and model of an MJCF or URDF file or an object, and remarks on omissions.

    Meshes, textures and height fields with missing files are omitted, and impossible masses are repaired:
    no joint depends on them.

    Raises:
        InputError: if a file cannot be read or MuJoCo rejects it, with file and line.
    """
    path, spec = model_label(source), _specification(source)
    remarks = _disable_sleep(path, spec)
    # compilation extends qpos of keyframes
    coordinate_counts = {key.name: len(key.qpos) for key in spec.keys}
    model, left_out = compile_repaired(path, spec)
    short = [
        f"keyframe {name!r} has {count} of {model.nq} coordinates: the rest are those of the reference"
        for name, count in coordinate_counts.items()
        if 0 < count < model.nq
    ]
    return spec, model, remarks + left_out + short


@quiet()
def parse_without_meshes(source: MujocoInput) -> tuple[mujoco.MjSpec, mujoco.MjModel | None]:
    """Return the specification of a file or an object with boxes in place of meshes, and the model with them.

    The model is None if the specification is that of the file: if it has no meshes, if their files are
    missing, or if the compiler merges bodies.

    Raises:
        InputError: as `parse_file`.
    """
    path, spec = model_label(source), _specification(source)
    _disable_sleep(path, spec)
    remove_textures(spec)
    if not has_replaceable_meshes(spec):
        return spec, None
    without_meshes = spec.copy()
    model, _ = compile_repaired(path, spec)
    if not spec.meshes:  # their files are missing
        return spec, None
    geoms = remove_meshes(without_meshes)
    copy_shapes(without_meshes, model, geoms)
    return without_meshes, model


def _specification(source: MujocoInput) -> mujoco.MjSpec:
    """Return the specification of a file or an object; the object remains unchanged."""
    if isinstance(source, str):
        return _spec_of_file(source, urdf=_root(source) == "robot")
    return source.copy() if isinstance(source, mujoco.MjSpec) else _spec_of_model(source)


def _root(path: str) -> str:
    """Return the root element of a file; reject files that are not text, or neither MJCF nor URDF."""
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path} is no regular file; name an MJCF file")
        if status.st_size > MAX_BYTES:
            raise InputError(f"{path} has {status.st_size} bytes; an MJCF file has {MAX_BYTES} at most")
        with open(path, encoding="utf-8-sig") as file:
            text = file.read()
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name one that can be read") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text in UTF-8; name an MJCF file in that encoding") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if not text.strip():
        raise InputError(f"{path} is empty; name an MJCF file")
    match = _ROOT.match(_COMMENT.sub("", text))
    root = match[1] if match else None
    if root == "robot" and "<xacro:" in text:
        raise InputError(
            f"{path} contains macros of xacro; expand it into URDF (xacro IN -o OUT.urdf) and name that file"
        )
    if root == "mujocoinclude":
        raise InputError(f"{path} is a part that other files include; name the file that includes it")
    if text.startswith(_POINTER):
        raise InputError(f"{path} is a pointer of Git LFS, not the file itself; fetch it with git lfs pull")
    if root not in ("mujoco", "robot"):
        what = f"begins with <{root}>" if root else "is no XML"
        raise InputError(f"{path} {what}; an MJCF file begins with <mujoco>, URDF with <robot>")
    return root


def model_label(source: MujocoInput) -> str:
    """Return the label of a file or an object in messages."""
    if isinstance(source, str):
        return source
    if isinstance(source, mujoco.MjSpec):
        return f"MjSpec {source.modelname!r}"
    return f"MjModel {source.names[: source.names.index(0)].decode()!r}" if 0 in source.names else "MjModel"


def _spec_of_file(path: str, *, urdf: bool) -> mujoco.MjSpec:
    try:
        with warnings.catch_warnings(action="ignore"):
            return (urdf_specification(path) if urdf else None) or mujoco.MjSpec.from_file(path)
    except InputError:
        raise
    except (ValueError, UnicodeError) as error:
        raise readable_error(path, error) from None


def _spec_of_model(model: mujoco.MjModel) -> mujoco.MjSpec:
    """Return the specification that compiles to a model, from the XML that MuJoCo loaded last.

    The saved XML has six digits; the exact numbers come from the model.
    """
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "model.xml")
            mujoco.mj_saveLastXML(path, model)
            spec = mujoco.MjSpec.from_file(path)
        compiled(spec)
        spec.copy_back(model)
        same = bytes(compiled(spec).names) == bytes(model.names)
    except (mujoco.FatalError, ValueError):
        spec, same = None, False
    if spec is None or not same:
        raise InputError(
            f"{model_label(model)} is not the model that MuJoCo loaded last from XML, so that its "
            "specification is unknown; give the MjSpec or the file"
        )
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
def compile_repaired(path: str, spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, list[str]]:
    """Return the model of a specification, and sentences on omissions and repairs."""
    left_out: list[str] = []
    while True:
        try:
            return compiled(spec), left_out
        except InputError as error:
            repair = without_missing(spec, str(error)) or with_possible_inertias(spec, str(error))
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
    names = {GROUND, "world", *(body.name for body in bodies)}
    for number, body in enumerate(bodies, 1):
        if not body.name:
            body.name = _free(f"body{number}", names)
    joints = [joint for body in bodies for joint in body.joints]
    name_unnamed(joints, [f"{joint.parent.name}_joint" for joint in joints])
    equalities = list(spec.equalities)
    kinds = [str(mujoco.mjtEq(equality.type).name).removeprefix("mjEQ_").lower() for equality in equalities]
    name_unnamed(equalities, [f"{kind}{number}" for number, kind in enumerate(kinds, 1)])


def name_unnamed(elements: Iterable[Any], proposed: Iterable[str]) -> None:
    """Give unnamed elements the proposed names, numbered where these are in use."""
    elements = list(elements)
    names = {element.name for element in elements}
    for element, name in zip(elements, proposed, strict=True):
        if not element.name:
            element.name = _free(name, names)


def _free(name: str, names: set[str]) -> str:
    """Return an unused name and add it to the names."""
    free, count = name, 1
    while free in names:
        count += 1
        free = f"{name}{count}"
    names.add(free)
    return free
