"""An MJCF file parsed and compiled, or MuJoCo's refusal in one line with file and line number."""

import os
import re
import stat
import tempfile
import warnings
from xml.parsers import expat

import mujoco

from mechsim.errors import InputError, cut
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.silence import quiet
from mechsim.simulation.mjcf_reader.missing_files import without_missing
from mechsim.simulation.mjcf_reader.repaired_inertias import with_possible_inertias

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

    Meshes, textures and height fields whose files are missing are left out, and masses that no body has are
    mended: no joint needs them.

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
    """Return the model of a specification, and what had to be left out or mended for MuJoCo to take it."""
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
    """Return MuJoCo's refusal of a file in one line: file, line, and what it said."""
    text = " ".join(str(error).split())
    if "XML parse error" in text and (ill_formed := _ill_formed(path)):
        return ill_formed
    line = _LINE.search(text)
    location = f"{path}, line {line[1]}" if line and int(line[1]) else path
    if include := _NOT_INCLUDED.search(text):
        folder, name = os.path.split(os.path.abspath(include[1]))
        return InputError(
            f"{location}: it includes {name}, which is not in {folder}; put it there, or mend its <include>"
        )
    if _TOO_DEEP in text:
        return InputError(
            f"{location}: elements are nested more than {MAX_DEPTH} deep, which MuJoCo's XML reader refuses; "
            "put the inner bodies into a file of their own and <include> it in their place"
        )
    message = " ".join(_NOISE.sub("", _LINE.sub("", text)).split()).strip(" ,;:")
    message = _ELEMENT.sub(r" (element \1)", message)
    message = cut(message, MAX_SHOWN)
    remedy = "take the plugin out of a copy" if _PLUGIN.search(message) else "mend the file"
    return InputError(f"{location}: MuJoCo refuses it: {message}; {remedy}")


def _ill_formed(path: str) -> InputError | None:
    """Return where and why a file is no well-formed XML; None where it is."""
    try:
        with open(path, "rb") as file:
            expat.ParserCreate().ParseFile(file)
    except expat.ExpatError as error:
        return InputError(
            f"{path}, line {error.lineno}, column {error.offset + 1}: no well-formed XML, "
            f"{expat.ErrorString(error.code)}; mend the file"
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
