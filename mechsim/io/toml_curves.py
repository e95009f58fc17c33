"""Joints of kind curve in a TOML file, written with other joints: a point on a curve of another link.

A curve is x(s), y(s), z(s) in the frame of link a. A body without mass and rotation slides on this link along
three axes that are functions of s, the coordinate of the joint; a ball joint connects it with link b. The
equations are those of Haug, 1989, ch. 9: r_B - r_A - A c(s) = 0; without friction the force is normal to c'.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.files import read_in_si
from mechsim.io.toml_cams import GuidedJoint, cam_joints, cam_of
from mechsim.io.toml_links import MASSLESS
from mechsim.io.toml_values import Values, written_function
from mechsim.mechanism.contacts import Contact
from mechsim.mechanism.coupling_functions import PlainFunction, TabledFunction, WrittenFunction
from mechsim.mechanism.curve_checks import require_followable
from mechsim.mechanism.curves import CurveAxis, GuideCurve
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX
from mechsim.numerics.arrays import REVOLUTION

CURVE_KEYS = {"kind", "a", "b", "roller", "side", "limits"}
# side of a roller -> sign of its offset to the left; of closed curves relative to their outside
_SIDES = {"left": 1.0, "right": -1.0, "outside": 1.0, "inside": -1.0}


def with_curves(
    values: Values, document: Mapping[str, Any], read_document: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Coupling], dict[str, Contact]]:
    """Return the contents of a file with other joints in place of those on curves, couplings, and contacts.

    Args:
        values: reader of the file's numbers.
        document: contents of the file, whose keys are checked.
        read_document: the same in SI.

    Raises:
        InputError: for a joint on a curve that the file does not contain, keys that such a joint does not
            have, a curve without a joint, or one that no point or roller can follow.
    """
    joints, written = dict[str, Any](), dict[str, GuidedJoint]()
    curves = {name: _curve(values, name, entry) for name, entry in read_document.get("curves", {}).items()}
    cams = {name: cam_of(values, name, entry) for name, entry in read_document.get("cams", {}).items()}
    for name, joint in document.get("joints", {}).items():
        with values.source.error_context(("joints", name)):
            if joint["kind"] == "cam":
                written[name] = cam_joints(name, joint, cams, read_document.get("cams", {}))
            elif joint["kind"] == "curve":
                written[name] = _curve_joints(name, joint, curves, read_document["joints"][name])
            elif alone := {"roller", "side"} & {*joint}:
                raise InputError(f"{min(alone)} of joint {name!r} is of a joint of kind curve only")
        joints |= written[name].joints if name in written else {name: joint}
    for key, entries in (("curve", curves), ("cam", cams)):
        used = {joint["a"].get(key) for joint in document.get("joints", {}).values()}
        if unused := entries.keys() - used:
            raise InputError(
                f"no joint is on the {key} {min(unused)}; name it in side a of a joint, or leave it out"
            )
    rest = {key: value for key, value in document.items() if key not in ("curves", "cams")}
    massless = {link: MASSLESS for made in written.values() for link in made.massless}
    links = {"links": document.get("links", {}) | massless, "joints": joints}
    couplings = [coupling for made in written.values() for coupling in made.couplings]
    return rest | links, couplings, {name: made.contact for name, made in written.items()}


def _curve_joints(
    name: str, joint: Mapping[str, Any], curves: Mapping[str, GuideCurve], read_joint: Mapping[str, Any]
) -> GuidedJoint:
    """Return the joints of a joint on a curve."""
    side = dict(joint["a"])
    key = side.pop("curve", "")
    if key not in curves or {*side} != {"link"} or not {*joint} <= CURVE_KEYS:
        raise InputError(
            f"joint {name!r} is of kind curve; give only a = {{ link, curve }}, b = {{ link, at }}, "
            f"roller, side and limits, with a curve of the file ({', '.join(curves) or 'it has none'})"
        )
    curve = _with_roller(curves[key], name, read_joint)
    require_followable(curve)
    carrier, force_joint = f"{VIRTUAL_PREFIX}{name}", f"{name}.point"
    along = {"link": f"{carrier}.s", "axis": [1.0, 0.0, 0.0]}
    slide: dict[str, Any] = {"kind": "prismatic", "a": {**along, "link": GROUND}, "b": along}
    if "limits" in joint:
        slide["limits"] = joint["limits"]
    elif curve.bounded:
        # a point stops at the ends of its curve
        slide["limits"] = dict(zip(("lower", "upper"), (f"{end!r} m" for end in curve.interval), strict=True))
    joints = {
        name: slide,
        carrier: {"kind": "cartesian", "a": side, "b": {"link": carrier}},
        force_joint: {"kind": "spherical", "a": {"link": carrier}, "b": joint["b"]},
    }
    couplings: list[Coupling] = []
    for i, axis in enumerate("xyz"):
        sides = f"{name}.{axis}", f"{carrier}.{axis}"
        if i < len(curve.axes):
            plain = isinstance(curve.axes[i], WrittenFunction) and not (curve.offset or curve.bounded)
            function = curve.axes[i] if plain else CurveAxis(curve, i)
            couplings.append(Coupling(*sides, name, (), function=function))
        else:
            couplings.append(Coupling(*sides, {}, (0.0,)))
    contact = Contact(side["link"], force_joint, name, side["link"], curve, bool(curve.offset))
    return GuidedJoint((carrier, f"{carrier}.s"), joints, tuple(couplings), contact)


def _curve(values: Values, name: str, entry: Mapping[str, Any]) -> GuideCurve:
    """Return a curve of a file, given by expressions of s or by a table."""
    closed, stated = entry.get("closed", False), entry.get("range")
    with values.source.error_context(("curves", name)):
        if "table" in entry:
            if {*entry} & {"x", "y", "z", "range"}:
                raise InputError(f"curve {name!r} has a table and x, y, z or range; give one of them")
            axes = _tabled(str(values.source.sibling(entry["table"])), closed)
            return GuideCurve(name, axes, axes[0].interval, closed, bounded=not closed)
        if stated is not None and not stated[0] < stated[1]:
            raise InputError(
                f"curve {name!r} has the range {stated[0]:g} to {stated[1]:g}; give the lower end of s first"
            )
        if not {*entry} & {*"xyz"}:
            raise InputError(f"curve {name!r} has no x, y, z and no table; give expressions of s, or a table")
        functions = tuple(
            written_function(values, f"{entry.get(axis, '0')} + 0*s", ("curves", name, axis), "s")
            for axis in ("xyz" if "z" in entry else "xy")
        )
        interval = stated or ((0.0, REVOLUTION) if closed else (-np.pi, np.pi))
        return GuideCurve(name, functions, interval, closed, bounded=bool(stated) and not closed)


def _tabled(path: str, closed: bool) -> tuple[PlainFunction, ...]:
    """Return splines through a table with x, y, maybe z and s, by default the length of the chords."""
    columns = read_in_si(path, dict.fromkeys("xyz", "m"))
    names = [axis for axis in "xyz" if axis in columns]
    if names[:2] != ["x", "y"] or not {*columns} <= {*"sxyz"}:
        raise InputError(
            f"table {path!r} has columns {', '.join(columns)}; give x and y, and if needed z and s"
        )
    points = np.array([columns[axis] for axis in names])
    chords = np.linalg.norm(np.diff(points), axis=0)
    s = columns.get("s", np.concatenate([[0.0], np.cumsum(chords)]))
    return tuple(
        TabledFunction(path, tuple(s.tolist()), tuple(row.tolist()), closed, variable="s") for row in points
    )


def _with_roller(curve: GuideCurve, name: str, joint: Mapping[str, Any]) -> GuideCurve:
    """Return the path of the centre of a joint's roller; the curve itself without one."""
    radius, side = joint.get("roller", 0.0), joint.get("side", "outside" if curve.closed else "left")
    subject = f"joint {name!r}"
    if radius == 0.0:
        if "side" in joint:
            raise InputError(f"{subject} has a side without a roller; give the radius of the roller")
        return curve
    if not radius > 0.0:
        raise InputError(
            f"{subject} has a roller of {radius:g} m; give a radius above 0, and the side left or right"
        )
    if len(curve.axes) == 3:
        raise InputError(
            f"{subject} has a roller on the spatial curve {curve.name!r}; leave out z, or the roller"
        )
    if side in ("outside", "inside") and not curve.closed:
        raise InputError(
            f"has a roller {side} of curve {curve.name!r}, which is not closed; give left or right"
        )
    outwards = curve.outside() if side in ("outside", "inside") else 1.0
    return replace(curve, offset=_SIDES[side] * outwards * radius)
