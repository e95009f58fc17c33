"""MJCF text in which every number that physics depends on reads back as the same double."""

import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np

from mechsim.simulation.mjcf.compiling import plainly_compiled

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
