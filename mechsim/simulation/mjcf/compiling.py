"""Compiles specifications with exact positions at any scale, and writes them as exact MJCF text."""

import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.mujoco_loading import quiet as quiet


@contextmanager
def warnings_of_mujoco() -> Generator[list[str]]:
    """Yield the list to which the warnings of MuJoCo's parser are added."""
    texts: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(texts.append)
    try:
        with warnings.catch_warnings(record=True, action="always") as caught:
            yield texts
        texts += [str(warning.message) for warning in caught]
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def without_c_output() -> Generator[None]:
    """Suppress the output of C libraries, such as Qhull's about narrow meshes."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no null device
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


# MuJoCo's message about a body whose mass or moment of inertia it takes for zero
_LIGHT = re.compile(r"must be larger than mjMINVAL Element name '([^']*)'")
NONE = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
BODY = int(mujoco.mjtSameFrame.mjSAMEFRAME_BODY)
INERTIA = int(mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA)


def compiled(spec: mujoco.MjSpec, warned: list[str] | None = None) -> mujoco.MjModel:
    """Return the compiled model with the exact positions of sites, geoms and centres of mass.

    The compiler moves a site, geom or centre of mass that is less than a micrometre from its body's origin
    to the origin. In a linkage of 5 um this moves a joint by a fifth of a link
    (docs/explanation/extremes.md).

    Args:
        spec: the specification.
        warned: the compiler's warnings are added to it.

    Raises:
        InputError: for a model that MuJoCo rejects, such as one with a massless body.
    """
    try:
        model = plainly_compiled(spec, warned)
    except ValueError as error:
        text = " ".join(str(error).split())
        light = _LIGHT.search(text)
        cause = _too_light(spec.body(light[1])) if light else text
        raise InputError(f"MuJoCo rejects the model: {cause}") from error
    for kind in ("site", "geom"):
        same_frame, positions = getattr(model, f"{kind}_sameframe"), getattr(model, f"{kind}_pos")
        centre = model.body_ipos[getattr(model, f"{kind}_bodyid")]
        for frame, origin in ((BODY, 0.0), (INERTIA, centre)):
            same_frame[(same_frame == frame) & (positions != origin).any(1)] = NONE
    model.body_sameframe[(model.body_sameframe == BODY) & np.any(model.body_ipos != 0.0, axis=1)] = NONE
    return model


def _too_light(body: mujoco.MjsBody) -> str:
    """Return the mass and least moment of inertia of a body that MuJoCo takes for zero, and a remedy."""
    least = float(np.min(body.inertia))
    if np.isfinite(body.fullinertia).all():
        # MuJoCo's order: xx, yy, zz, xy, xz, yz
        least = float(np.linalg.eigvalsh(body.fullinertia[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]])[0])
    return (
        f"{body.info} body {body.name!r} has a mass of {body.mass:.3g} kg and a moment of inertia of "
        f"{least:.3g} kg m2; both must be larger than mjMINVAL, {mujoco.mjMINVAL:g}: give larger ones, "
        "describe the mechanism a thousand times as large, or take the formulas alone (--method none)"
    )


def plainly_compiled(spec: mujoco.MjSpec, warned: list[str] | None = None) -> mujoco.MjModel:
    """Return the model as MuJoCo compiles it, without the output of MuJoCo and Qhull; `warned` as above."""
    with warnings.catch_warnings(record=True, action="always") as caught, without_c_output():
        model = spec.compile()
    if warned is not None:
        warned += [str(warning.message) for warning in caught]
    return model


# elements whose numbers MuJoCo's writer rounds to six digits: path, kind, attributes
EXACT_ATTRIBUTES = (
    (".//body/joint", "joint", "pos axis range ref armature stiffness springref damping frictionloss"),
    ("./worldbody//site", "site", "pos quat"),
    ("equality/*", "equality", "solref solimp"),
    ("tendon/*", "tendon", "stiffness damping springlength frictionloss"),
    ("actuator/*", "actuator", "gainprm biasprm gear"),
    ("keyframe/key", "key", "qpos qvel ctrl"),
)
# attributes of a joint that are angles unless it slides
ANGLES = {"range", "ref", "springref"}
# attributes of `inertial` -> field of the body's specification
INERTIAL = {"pos": "ipos", "quat": "iquat", "mass": "mass", "diaginertia": "inertia"}
DEFAULT = {"pos": (0.0, 0.0, 0.0), "quat": (1.0, 0.0, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "ref": (0.0,)}


def to_xml(spec: mujoco.MjSpec) -> str:
    """Return a specification as MJCF text, numbers with up to 17 significant digits."""
    plainly_compiled(spec)
    root = ET.fromstring(spec.to_xml())
    option = root.find("option")
    if option is not None:
        _rewrite(option, spec.option, ("timestep", "gravity"))
    for body in root.iter("body"):
        owner = spec.body(body.get("name"))
        _rewrite(body, owner, ("pos", "quat"))
        for inertial in body.findall("inertial"):
            _rewrite_inertial(inertial, owner)
    for path, kind, attributes in EXACT_ATTRIBUTES:
        for element in root.iterfind(path):
            source = getattr(spec, kind)(element.get("name"))
            _rewrite(element, source, attributes.split())
            # the text is in radians, a specification in its own unit
            if kind == "joint" and spec.compiler.degree and source.type != mujoco.mjtJoint.mjJNT_SLIDE:
                for name in ANGLES & element.attrib.keys():
                    element.set(name, _text(np.deg2rad(np.atleast_1d(getattr(source, name)))))
    for coupling in root.iterfind("equality/joint"):
        coupling.set("polycoef", _text(spec.equality(coupling.get("name")).data[:5]))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _rewrite(
    element: ET.Element, source: Any, attributes: Sequence[str], fields: Mapping[str, str] | None = None
) -> None:
    """Write attributes of an element exactly; `fields` maps them to other names in the specification."""
    for attribute in attributes:
        values = np.atleast_1d(getattr(source, (fields or {}).get(attribute, attribute)))
        if attribute in element.attrib:
            count = len(element.attrib[attribute].split())
            element.set(attribute, _text(values[:count]))
        # the writer omits values within rounding of the default
        elif attribute in DEFAULT and not np.array_equal(values, DEFAULT[attribute]):
            element.set(attribute, _text(values))


def _rewrite_inertial(inertial: ET.Element, owner: mujoco.MjsBody) -> None:
    """Write principal moments with their axes, or all six moments, as the specification does."""
    full = np.asarray(owner.fullinertia)
    if np.isfinite(full).all():
        _rewrite(inertial, owner, ("pos", "mass"), INERTIAL)
        for attribute in ("quat", "diaginertia"):
            inertial.attrib.pop(attribute, None)
        inertial.set("fullinertia", _text(full))
    else:
        _rewrite(inertial, owner, [*INERTIAL], INERTIAL)


def _text(values: Any) -> str:
    # repr of a Python float is the shortest text that reads back the same
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)
