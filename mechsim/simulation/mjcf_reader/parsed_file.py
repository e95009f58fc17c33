"""Parses and compiles files and objects of MuJoCo; errors in one line with file and line number."""

import os
import re
import stat
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import Any
from xml.parsers import expat

import mujoco
import numpy as np

from mechsim.errors import InputError, cut
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE
from mechsim.simulation.mjcf.compiling import compiled, quiet

# a mesh that bounds no volume
_FLAT = re.compile(r"mesh volume is too small: (\S+)")
# minimum mass and moment of inertia of a moving body, in [kg] and [kg m2]
MIN_MASS, MIN_INERTIA = 1e-6, 1e-12


def with_possible_inertias(spec: mujoco.MjSpec, message: str) -> str:
    """Let MuJoCo repair inertias that break the triangle inequality, and raise those that are zero.

    Meshes that bound no volume weigh as shells.

    Args:
        spec: changed in place.
        message: of MuJoCo.

    Returns:
        The change, as text; empty where the error has another cause.
    """
    text = " ".join(message.split())
    if "A + B >= C" in text and not spec.compiler.balanceinertia:
        spec.compiler.balanceinertia = 1
        return (
            "moments of inertia break the triangle inequality and MuJoCo refuses the file: read as with "
            '<compiler balanceinertia="true"/>, which evens them out'
        )
    if "must be larger than mjMINVAL" in text and spec.compiler.boundmass < MIN_MASS:
        spec.compiler.boundmass, spec.compiler.boundinertia = MIN_MASS, MIN_INERTIA
        return (
            "a moving body has no mass or no inertia and MuJoCo refuses the file: read as with "
            f'<compiler boundmass="{MIN_MASS:g}" boundinertia="{MIN_INERTIA:g}"/>'
        )
    flat = _FLAT.search(text)
    if flat and (mesh := spec.mesh(flat[1])) and mesh.inertia != mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        return f'mesh {flat[1]!r} bounds no volume and MuJoCo refuses it: read as with inertia="shell"'
    return ""


def minimum_mass(remarks: Iterable[str]) -> float:
    """Return the mass in [kg] to which bodies without any were raised, by the remarks; 0 where none was."""
    return MIN_MASS if any("boundmass" in remark for remark in remarks) else 0.0


_FILE = re.compile(r"(?:opening|open|find|load|read)\w* (?:file |resource )?'([^']+)'", re.IGNORECASE)
# inertia of a body whose meshes are missing, in [kg] and [kg m2]
PLACEHOLDER_MASS, PLACEHOLDER_INERTIA = 1.0, 1e-3
# kinds of assets: name in messages -> list of the specification
ASSETS = {"meshes": "meshes", "textures": "textures", "height fields": "hfields", "skins": "skins"}


def without_missing(spec: mujoco.MjSpec, message: str) -> str:
    """Leave out the assets of the kind whose file MuJoCo did not find.

    Args:
        spec: changed in place.
        message: of MuJoCo.

    Returns:
        What was left out, as text; empty where the error names no file of an asset.
    """
    match = _FILE.search(message)
    if not match:
        return ""
    missing = match[1]
    for kind, attribute in ASSETS.items():
        assets = list(getattr(spec, attribute))
        if any(_same_file(missing, name) for asset in assets for name in _files(asset)):
            _detach(spec, kind)
            for asset in assets:
                spec.delete(asset)
            return f"file {missing} is missing: read without its {kind}"
    return ""


def _files(asset: Any) -> list[str]:
    return [name for name in (asset.file, *getattr(asset, "cubefiles", ())) if name]


def _same_file(missing: str, name: str) -> bool:
    return missing == name or missing.replace("\\", "/").endswith(name.replace("\\", "/").lstrip("./"))


def _detach(spec: mujoco.MjSpec, kind: str) -> None:
    """Remove the references to a kind of assets."""
    if kind == "meshes":
        _no_shapes(spec, [geom for geom in spec.geoms if geom.meshname])
    elif kind == "height fields":
        _no_shapes(spec, [geom for geom in spec.geoms if geom.hfieldname])
    elif kind == "textures":
        for material in spec.materials:
            material.textures = [""] * len(material.textures)


def _no_shapes(spec: mujoco.MjSpec, geoms: Sequence[Any]) -> None:
    """Make geoms points that touch nothing, and give bodies that had their mass from them a stand-in."""
    for geom in geoms:
        body = geom.parent
        geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
        geom.size = np.array([1e-3, 0.0, 0.0])
        geom.meshname = geom.hfieldname = geom.material = ""
        geom.contype = geom.conaffinity = 0
        if body.id and not body.explicitinertial:
            body.explicitinertial = True
            body.mass, body.inertia = PLACEHOLDER_MASS, np.full(3, PLACEHOLDER_INERTIA)
            body.ipos, body.iquat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    if spec.compiler.inertiafromgeom == int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE):
        spec.compiler.inertiafromgeom = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO)


# path of a file in MJCF or URDF, or an object
MujocoInput = str | mujoco.MjSpec | mujoco.MjModel
# a file longer than this is no description of a mechanism
MAX_BYTES = 50_000_000
# characters of MuJoCo's message that are repeated
MAX_SHOWN = 300

_COMMENT = re.compile(r"<!--.*?-->|<\?.*?\?>|<!DOCTYPE[^>\[]*(?:\[.*?\]\s*)?>", re.DOTALL | re.IGNORECASE)
_ROOT = re.compile(r"\s*<([A-Za-z_][\w.:-]*)")
# begins what Git leaves of a file that it keeps elsewhere
_POINTER = "version https://git-lfs"
_LINE = re.compile(r",?\s*line(?: number)?[ =:]+(\d+)", re.IGNORECASE)
_NOISE = re.compile(
    r"MuJoCo refuses the model: |(?:XML )?Error: |,? ?\bid -?\d+|Element name '',?"
    r"|ErrorID=\d+ \(0x[0-9a-f]+\)"
)
SLEEP, IPC = int(mujoco.mjtEnableBit.mjENBL_SLEEP), int(mujoco.mjtEnableBit.mjENBL_IPC)
_PLUGIN = re.compile(r"plugin \S+ not found")
_NOT_INCLUDED = re.compile(r"Error opening file '(.+?)' Element 'include'")
# elements that MuJoCo's XML reader takes one in the other, and what it says of more
MAX_DEPTH, _TOO_DEEP = 499, "XML_ELEMENT_DEPTH_EXCEEDED"
_ELEMENT = re.compile(r" Element (?:name )?('[^']*')")


@quiet()
def parse_file(source: MujocoInput) -> tuple[mujoco.MjSpec, mujoco.MjModel, list[str]]:
    """Return the specification of an MJCF or URDF file or an object, its model, and what was left out.

    Meshes, textures and height fields whose files are missing are left out, and impossible masses are
    repaired: no joint needs them.

    Raises:
        InputError: for a file that cannot be read or that MuJoCo refuses; names file and line.
    """
    path = model_label(source)
    if isinstance(source, str):
        _require_mjcf(source)
        spec = _spec_of_file(source)
    else:
        spec = source.copy() if isinstance(source, mujoco.MjSpec) else _spec_of_model(source)
    remarks = _disable_sleep(path, spec)
    # compiling fills them up
    coordinate_counts = {key.name: len(key.qpos) for key in spec.keys}
    model, left_out = compile_repaired(path, spec)
    short = [
        f"keyframe {name!r} has {count} of {model.nq} coordinates: the rest are those of the reference"
        for name, count in coordinate_counts.items()
        if 0 < count < model.nq
    ]
    return spec, model, remarks + left_out + short


def model_label(source: MujocoInput) -> str:
    """Return how messages name a file or an object."""
    if isinstance(source, str):
        return source
    if isinstance(source, mujoco.MjSpec):
        return f"MjSpec {source.modelname!r}"
    return f"MjModel {source.names[: source.names.index(0)].decode()!r}" if 0 in source.names else "MjModel"


def _spec_of_file(path: str) -> mujoco.MjSpec:
    try:
        with warnings.catch_warnings(action="ignore"):
            return mujoco.MjSpec.from_file(path)
    except (ValueError, UnicodeError) as error:
        raise readable_error(path, error) from None


def _spec_of_model(model: mujoco.MjModel) -> mujoco.MjSpec:
    """Return the specification that compiles to a model, from the XML that MuJoCo loaded last.

    The saved XML has six digits; the exact numbers are then copied from the model.
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
        same = False
    if not same:
        raise InputError(
            f"{model_label(model)} is not the model that MuJoCo loaded last from XML, so that its "
            "specification is unknown; give the MjSpec or the file"
        )
    return spec


def _disable_sleep(path: str, spec: mujoco.MjSpec) -> list[str]:
    """Switch sleep off, which no state carries, and say so; refuse contacts that no state carries."""
    if spec.option.enableflags & IPC:
        raise InputError(
            f"{path} asks for IPC contacts, which poses in a row cannot carry; take the flag out"
        )
    asleep = bool(spec.option.enableflags & SLEEP)
    spec.option.enableflags &= ~SLEEP
    return ["sleep is switched off: what is at rest is computed as the rest is"] if asleep else []


@quiet()
def compile_repaired(path: str, spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, list[str]]:
    """Return the model of a specification, and what had to be left out or repaired."""
    left_out: list[str] = []
    while True:
        try:
            return compiled(spec), left_out
        except InputError as error:
            repair = without_missing(spec, str(error)) or with_possible_inertias(spec, str(error))
            if not repair:
                raise readable_error(path, error) from None
            left_out.append(repair)


def readable_error(path: str, error: Exception) -> InputError:
    """Return MuJoCo's error about a file in one line: file, line and message."""
    text = " ".join(str(error).split())
    if "XML parse error" in text and (ill_formed := _ill_formed(path)):
        return ill_formed
    line = _LINE.search(text)
    location = f"{path}, line {line[1]}" if line and int(line[1]) else path
    if include := _NOT_INCLUDED.search(text):
        folder, name = os.path.split(os.path.abspath(include[1]))
        return InputError(
            f"{location}: it includes {name}, which is not in {folder}; put it there, or correct the file"
        )
    if _TOO_DEEP in text:
        return InputError(
            f"{location}: elements are nested more than {MAX_DEPTH} deep, which MuJoCo's XML reader refuses; "
            "put the inner bodies into a file of their own and <include> it in their place"
        )
    message = " ".join(_NOISE.sub("", _LINE.sub("", text)).split()).strip(" ,;:")
    message = _ELEMENT.sub(r" (element \1)", message)
    message = cut(message, MAX_SHOWN)
    remedy = "take the plugin out of a copy" if _PLUGIN.search(message) else "correct the file"
    return InputError(f"{location}: MuJoCo refuses it: {message}; {remedy}")


def _ill_formed(path: str) -> InputError | None:
    """Return where and why a file is no well-formed XML; None where it is."""
    try:
        with open(path, "rb") as file:
            expat.ParserCreate().ParseFile(file)
    except expat.ExpatError as error:
        return InputError(
            f"{path}, line {error.lineno}, column {error.offset + 1}: no well-formed XML, "
            f"{expat.ErrorString(error.code)}; correct the file"
        )
    return None


def _require_mjcf(path: str) -> None:
    """Refuse what is no file, no text or no MJCF before MuJoCo sees it."""
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
    if root == "mujocoinclude":
        raise InputError(f"{path} is a part that other files include; name the file that includes it")
    if text.startswith(_POINTER):
        raise InputError(f"{path} is a pointer of Git LFS, not the file itself; fetch it with git lfs pull")
    if root not in ("mujoco", "robot"):
        what = f"begins with <{root}>" if root else "is no XML"
        raise InputError(f"{path} {what}; an MJCF file begins with <mujoco>, URDF with <robot>")


def name_elements(spec: mujoco.MjSpec) -> None:
    """Name the bodies, joints and equalities that have no name; a body called as the frame is renamed."""
    bodies = list(spec.bodies)[1:]
    names = {GROUND, "world", *(body.name for body in bodies)}
    for number, body in enumerate(bodies, 1):
        if not body.name:
            body.name = _free(f"body{number}", names)
    joints = [joint for body in bodies for joint in body.joints]
    _name(joints, [f"{joint.parent.name}_joint" for joint in joints])
    equalities = list(spec.equalities)
    kinds = [str(mujoco.mjtEq(equality.type).name).removeprefix("mjEQ_").lower() for equality in equalities]
    _name(equalities, [f"{kind}{number}" for number, kind in enumerate(kinds, 1)])


def _name(elements: Iterable[Any], proposed: Iterable[str]) -> None:
    elements = list(elements)
    names = {element.name for element in elements}
    for element, name in zip(elements, proposed, strict=True):
        if not element.name:
            element.name = _free(name, names)


def _free(name: str, names: set[str]) -> str:
    """Return a name that is not taken yet, and take it."""
    free, count = name, 1
    while free in names:
        count += 1
        free = f"{name}{count}"
    names.add(free)
    return free


# no mechanism is farther across, in [m], and no joint's coordinate means anything beyond it, in [m] or [rad]
MAX_LENGTH = 1e12


def require_numbers(path: str, spec: mujoco.MjSpec, model: mujoco.MjModel, start: Array) -> None:
    """Refuse a model with NaN, with numbers beyond sense, quaternions that are no turn, or no time step.

    Args:
        path: of the file.
        spec: what it says.
        model: what that compiles to.
        start: coordinates, (nq,).

    Raises:
        InputError: names file, line, the part and what it holds.
    """
    for what, element, values, limit in _numbers(spec, model):
        invalid = values[~(np.abs(values) <= limit)]
        if len(invalid) and not np.isfinite(invalid).all():
            raise _error(path, what, element, "numbers that are not finite")
        if len(invalid):
            raise _error(path, what, element, f"{invalid[0]:g}; give {limit:g} in SI at most")
    for what, elements, quaternions in (
        ("body", spec.bodies, model.body_quat),
        ("site", spec.sites, model.site_quat),
    ):
        for element in elements:
            if not np.linalg.norm(quaternions[element.id]) > 0.0:
                raise _error(path, what, element, "a quat that is no turn")
    if not np.isfinite(start).all():
        raise InputError(f"{path}: where it starts is not finite; correct ref or the keyframe")
    if not 0.0 < model.opt.timestep <= HUGE:
        raise InputError(
            f"{path}: the timestep of <option> is {model.opt.timestep:g} s, by which no run goes on; "
            "give one above 0, or leave it out for 0.002"
        )
    if not np.abs(model.opt.gravity).max() <= HUGE:
        raise InputError(f"{path}: gravity is {model.opt.gravity.tolist()}; give {HUGE:g} m/s^2 at most")


def _error(path: str, what: str, element: Any, content: str) -> InputError:
    location = ", ".join([path, *filter(None, [element.info])])
    label = f" {element.name!r}" if element.name else ""
    return InputError(f"{location}: {what}{label} holds {content}; correct the file")


def _numbers(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[tuple[str, Any, Array, float]]:
    """Yield what holds numbers: its kind, the part, the numbers and how large they may be."""
    coordinates = np.append(model.jnt_qposadr, model.nq)
    for body in spec.bodies:
        i = body.id
        yield "body", body, np.concatenate([model.body_pos[i], model.body_ipos[i]]), MAX_LENGTH
        yield "body", body, np.array([*model.body_quat[i], model.body_mass[i], *model.body_inertia[i]]), HUGE
    for joint in spec.joints:
        i, dofs = joint.id, model.dof_jntid == joint.id
        own = slice(coordinates[i], coordinates[i + 1])
        positions = [model.jnt_pos[i], model.qpos0[own], model.qpos_spring[own]]
        yield "joint", joint, np.concatenate(positions), MAX_LENGTH
        rates = [model.dof_damping[dofs], model.dof_armature[dofs], model.dof_frictionloss[dofs]]
        limit = [model.jnt_range[i], model.jnt_solref[i], model.jnt_solimp[i]]
        single = [model.jnt_axis[i], *limit, model.jnt_stiffness[[i]].ravel()]
        yield "joint", joint, np.concatenate([values_.ravel() for values_ in (*single, *rates)]), HUGE
    for site in spec.sites:
        yield "site", site, model.site_pos[site.id], MAX_LENGTH
        yield "site", site, model.site_quat[site.id], HUGE
    for equality in spec.equalities:
        own = [model.eq_data[equality.id], model.eq_solref[equality.id], model.eq_solimp[equality.id]]
        yield "equality", equality, np.concatenate(own), HUGE
