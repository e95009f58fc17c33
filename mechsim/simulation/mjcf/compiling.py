"""Specification to model, without the one shortcut of MuJoCo's compiler that depends on absolute lengths."""

import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError


@contextmanager
def quiet() -> Generator[None]:
    """Silence MuJoCo's log: what it warns of is read from its counters and reported as an outcome.

    Left alone it writes MUJOCO_LOG.TXT into the current folder.
    """
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


@contextmanager
def wordless() -> Generator[None]:
    """Keep what libraries in C print themselves, as Qhull does of narrow meshes, off the console."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no console to keep it off
        yield
        return
    null_device = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null_device, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null_device)


NONE, BODY, INERTIA = (
    int(frame)
    for frame in (
        mujoco.mjtSameFrame.mjSAMEFRAME_NONE,
        mujoco.mjtSameFrame.mjSAMEFRAME_BODY,
        mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA,
    )
)


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the compiled model, its points where the specification puts them however small it is.

    The compiler takes a site or geom less than a micrometre from its body's origin, and a centre of mass
    as near, for being there: in a linkage of 5 um a joint is then off by a fifth of a link, without a
    word (docs/explanation/extremes.md). Where the two are not the same to the last bit, they are kept
    apart. What the compiler warns of, a run will meet and report.

    Raises:
        InputError: for a model that MuJoCo refuses, such as one with a massless body.
    """
    try:
        model = plainly_compiled(spec)
    except ValueError as error:
        raise InputError(f"MuJoCo refuses the model: {' '.join(str(error).split())}") from error
    for kind in ("site", "geom"):
        same_frame, positions = getattr(model, f"{kind}_sameframe"), getattr(model, f"{kind}_pos")
        centre = model.body_ipos[getattr(model, f"{kind}_bodyid")]
        distinct = (same_frame == BODY) & (positions != 0.0).any(1) | (same_frame == INERTIA) & (
            positions != centre
        ).any(1)
        same_frame[distinct] = NONE
    model.body_sameframe[(model.body_sameframe == BODY) & np.any(model.body_ipos != 0.0, axis=1)] = NONE
    return model


def plainly_compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model as MuJoCo compiles it, without what it and Qhull print on the way."""
    with warnings.catch_warnings(action="ignore"), wordless():
        return spec.compile()


# MuJoCo's own writer keeps six digits. Element -> attribute -> where the specification holds it.
EXACT = {
    "body": {"pos": "pos", "quat": "quat"},
    "inertial": {"pos": "ipos", "quat": "iquat", "mass": "mass", "diaginertia": "inertia"},
    "joint": {
        "pos": "pos",
        "axis": "axis",
        "ref": "ref",
        "armature": "armature",
        "stiffness": "stiffness",
        "springref": "springref",
        "damping": "damping",
        "frictionloss": "frictionloss",
    },
    "site": {"pos": "pos", "quat": "quat"},
    "connect": {"solref": "solref", "solimp": "solimp"},
    "tendon": {
        "stiffness": "stiffness",
        "damping": "damping",
        "springlength": "springlength",
        "frictionloss": "frictionloss",
    },
    "key": {"qpos": "qpos", "qvel": "qvel", "ctrl": "ctrl"},
    "general": {"gainprm": "gainprm", "biasprm": "biasprm", "gear": "gear"},
}
DEFAULT = {"pos": (0.0, 0.0, 0.0), "quat": (1.0, 0.0, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "ref": (0.0,)}


def to_xml(spec: mujoco.MjSpec) -> str:
    """Return a specification as MJCF text, numbers with up to 17 significant digits."""
    plainly_compiled(spec)
    root = ET.fromstring(spec.to_xml())
    option = root.find("option")
    if option is not None:
        _rewrite(option, spec.option, {"timestep": "timestep", "gravity": "gravity"})
    for body in root.iter("body"):
        owner = spec.body(body.get("name"))
        _rewrite(body, owner, EXACT["body"])
        for inertial in body.findall("inertial"):
            _rewrite_inertial(inertial, owner)
    for joint in root.findall(".//body/joint"):
        _rewrite(joint, spec.joint(joint.get("name")), EXACT["joint"])
    for site in root.findall("./worldbody//site"):
        _rewrite(site, spec.site(site.get("name")), EXACT["site"])
    for equality in root.iterfind("equality/*"):
        made = spec.equality(equality.get("name"))
        _rewrite(equality, made, EXACT["connect"])
        if equality.tag == "joint":
            equality.set("polycoef", _text(made.data[:5]))
    for tendon in root.iterfind("tendon/*"):
        _rewrite(tendon, spec.tendon(tendon.get("name")), EXACT["tendon"])
    for actuator in root.iterfind("actuator/*"):
        _rewrite(actuator, spec.actuator(actuator.get("name")), EXACT["general"])
    for key in root.iterfind("keyframe/key"):
        _rewrite(key, spec.key(key.get("name")), EXACT["key"])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _rewrite(element: ET.Element, source: Any, attributes: dict[str, str]) -> None:
    for attribute, field in attributes.items():
        values = np.atleast_1d(getattr(source, field))
        if attribute in element.attrib:
            count = len(element.attrib[attribute].split())
            element.set(attribute, _text(values[:count]))
        # the writer leaves out what is within rounding of the default
        elif attribute in DEFAULT and not np.array_equal(values, DEFAULT[attribute]):
            element.set(attribute, _text(values))


def _rewrite_inertial(inertial: ET.Element, owner: mujoco.MjsBody) -> None:
    """Write moments as the specification has them: about axes of its own, or all six about the body's."""
    full = np.asarray(owner.fullinertia)
    if not np.isfinite(full).all():
        _rewrite(inertial, owner, EXACT["inertial"])
        return
    _rewrite(inertial, owner, {"pos": "ipos", "mass": "mass"})
    for attribute in ("quat", "diaginertia"):
        inertial.attrib.pop(attribute, None)
    inertial.set("fullinertia", _text(full))


def _text(values: Any) -> str:
    # repr of a Python float is the shortest text that reads back the same
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)
