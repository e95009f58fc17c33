"""Joints of kind curve in a TOML file, written with other joints: a point on a curve of another link.

A curve is x(s), y(s), z(s) in the frame of link a. A body without mass and rotation slides on this link along
three axes that are functions of s, the coordinate of the joint; a ball joint connects it with link b. The
equations are those of Haug, 1989, ch. 9: r_B - r_A - A c(s) = 0; without friction the force is normal to c'.
"""

import re
from collections.abc import Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.model.links import GROUND, VIRTUAL_PREFIX

CURVE = "curve"
_MASSLESS = {"inertia": {"mass": 0.0, "centre": [0.0] * 3, "moments": [0.0] * 3}}


def has_curves(document: Mapping[str, Any]) -> bool:
    """Whether a file has curves, or joints on curves."""
    joints = document.get("joints")
    entries: list[Any] = list(joints.values()) if isinstance(joints, dict) else []
    return "curves" in document or any(isinstance(row, dict) and row.get("kind") == CURVE for row in entries)


def with_curves(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the contents of a file, whose keys are checked, with other joints in place of those on curves.

    Raises:
        InputError: for a joint on a curve that the file does not contain, keys that such a joint does not
            have, or a curve without a joint.
    """
    written, joints = {key: value for key, value in document.items() if key != "curves"}, {}
    used: set[str] = set()
    links, couplings = dict(document.get("links", {})), dict(document.get("couplings", {}))
    for name, joint in document.get("joints", {}).items():
        if joint["kind"] != CURVE:
            joints[name] = joint
            continue
        side, curves = dict(joint["a"]), document.get("curves", {})
        key = side.pop("curve", "")
        curve = curves.get(key)
        if curve is None or {*side} != {"link"} or {*joint} != {"kind", "a", "b"}:
            raise InputError(
                f"joint {name!r} is of kind curve; give only a = {{ link, curve }} and b = {{ link, at }}, "
                f"with a curve of the file ({', '.join(curves) or 'it has none'})"
            )
        used.add(key)
        carrier = f"{VIRTUAL_PREFIX}{name}"
        along = {"link": f"{carrier}.s", "axis": [1.0, 0.0, 0.0]}
        links |= {carrier: _MASSLESS, f"{carrier}.s": _MASSLESS}
        joints[name] = {"kind": "prismatic", "a": {**along, "link": GROUND}, "b": along}
        joints[carrier] = {"kind": "cartesian", "a": side, "b": {"link": carrier}}
        joints[f"{name}.point"] = {"kind": "spherical", "a": {"link": carrier}, "b": joint["b"]}
        for axis in "xyz":
            text = re.sub(r"\bs\b", "q", str(curve.get(axis, "0"))) + " + 0*q"
            couplings[f"{name}.{axis}"] = {"driver": name, "driven": f"{carrier}.{axis}", "function": text}
    if unused := document.get("curves", {}).keys() - used:
        raise InputError(
            f"no joint is on the curve {min(unused)}; name it in side a of a joint, or leave it out"
        )
    return written | {"links": links, "joints": joints} | ({"couplings": couplings} if couplings else {})
