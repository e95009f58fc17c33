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


def with_curves(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the contents of a file with other joints in place of those on curves.

    Raises:
        InputError: for a joint on a curve that the file does not contain.
    """
    written, joints = {key: value for key, value in document.items() if key != "curves"}, {}
    links, couplings = dict(document.get("links", {})), dict(document.get("couplings", {}))
    for name, joint in document.get("joints", {}).items():
        if not isinstance(joint, dict) or joint.get("kind") != CURVE:
            joints[name] = joint
            continue
        side, curves = dict(joint.get("a", {})), document.get("curves", {})
        curve = curves.get(side.pop("curve", None))
        if curve is None or "b" not in joint or {*side} != {"link"}:
            raise InputError(
                f"joint {name!r} is of kind curve; give a = {{ link, curve }} and b = {{ link, at }}, with a "
                f"curve of the file ({', '.join(curves) or 'it has none'})"
            )
        carrier = f"{VIRTUAL_PREFIX}{name}"
        along = {"link": f"{carrier}.s", "axis": [1.0, 0.0, 0.0]}
        links |= {carrier: _MASSLESS, f"{carrier}.s": _MASSLESS}
        joints[name] = {"kind": "prismatic", "a": {**along, "link": GROUND}, "b": along}
        joints[carrier] = {"kind": "cartesian", "a": side, "b": {"link": carrier}}
        joints[f"{name}.point"] = {"kind": "spherical", "a": {"link": carrier}, "b": joint["b"]}
        for axis in "xyz":
            text = re.sub(r"\bs\b", "q", str(curve.get(axis, "0"))) + " + 0*q"
            couplings[f"{name}.{axis}"] = {"driver": name, "driven": f"{carrier}.{axis}", "function": text}
    return written | {"links": links, "joints": joints} | ({"couplings": couplings} if couplings else {})
