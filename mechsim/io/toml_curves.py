"""Joints of kind curve or cam in a TOML file, written with other joints.

A curve is x(s), y(s), z(s) in the frame of link a. A body without mass and rotation slides on this link along
three axes that are functions of s, the coordinate of the joint; a ball joint connects it with link b. The
equations are those of Haug, 1989, ch. 9: r_B - r_A - A c(s) = 0; without friction the force is normal to c'.

Of a cam, a massless body, the guide, rotates on the cam by -q about its axis, so that it keeps the
directions of the follower's guide. On it a second body moves by the cam's law of q; a ball joint connects
this with the roller or edge, a slide with a flat face. Since both have no mass, the force is normal to the
profile.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.files import is_table, read_in_si
from mechsim.io.toml_links import MASSLESS
from mechsim.io.toml_values import KeyPath, Values, tabled_function, written_function
from mechsim.mechanism.cams import PERIODIC, Cam, LiftLaw, SegmentedLaw
from mechsim.mechanism.contacts import Contact
from mechsim.mechanism.coupling_functions import PlainFunction, TabledFunction, WrittenFunction
from mechsim.mechanism.curve_checks import require_followable
from mechsim.mechanism.curves import CurveAxis, GuideCurve
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX
from mechsim.numerics.arrays import REVOLUTION
from mechsim.units import Unit

# follower -> lengths that it has besides the base radius, and those that it may have
_LENGTHS: Mapping[tuple[str, str], tuple[tuple[str, ...], tuple[str, ...]]] = {
    ("knife", "translating"): ((), ("offset",)),
    ("roller", "translating"): (("radius",), ("offset",)),
    ("flat", "translating"): ((), ()),
    ("knife", "swinging"): (("arm", "centre_distance"), ()),
    ("roller", "swinging"): (("radius", "arm", "centre_distance"), ()),
    ("flat", "swinging"): (("centre_distance",), ("offset",)),
}


@dataclass(frozen=True)
class GuidedJoint:
    """A joint on a curve or cam, written with other joints.

    Attributes:
        massless: names of the links that only connect joints.
        joints: joints by name, as in a file.
        couplings: functions of the curve or cam.
        contact: what the file describes.
    """

    massless: tuple[str, ...]
    joints: Mapping[str, Any]
    couplings: tuple[Coupling, ...]
    contact: Contact


def cam_of(values: Values, name: str, entry: Mapping[str, Any]) -> Cam:
    """Return a cam of a file, whose keys are checked, in SI."""
    follower = dict(entry["follower"])
    kind, motion = follower.pop("kind"), follower.pop("motion", "translating")
    required, optional = _LENGTHS[kind, motion]
    path: KeyPath = ("cams", name, "follower")
    if wrong := {*required} - {*follower} or {*follower} - {*required, *optional}:
        keys = ", ".join(required) or "no length"
        may = f" and, if needed, {', '.join(optional)}" if optional else ""
        raise values.source.error(
            path, f"is {motion}, of kind {kind}, so {min(wrong)} is wrong; give {keys}{may}"
        )
    for key, length in (*follower.items(), ("base_radius", entry["base_radius"])):
        if key != "offset" and not length > 0.0:
            where = ("cams", name, key) if key == "base_radius" else (*path, key)
            raise values.source.error(where, f"is {length:g} m; give a length above 0")
    with values.source.error_context(("cams", name)):
        law = _law(values, name, entry["law"], "m" if motion == "translating" else "rad")
        return Cam(name, kind, motion, entry["base_radius"], law, **follower)


def _law(values: Values, name: str, written: Any, unit: Unit) -> LiftLaw:
    """Return the law of a cam: segments, a table of q and value, or an expression of q."""
    path: KeyPath = ("cams", name, "law")
    if isinstance(written, str) and not is_table(written):
        return written_function(values, f"{written} + 0*q", path)
    if isinstance(written, str):
        law = tabled_function(values, written, path, periodic=True, units={"q": "rad", "value": unit})
        q, lift = law.positions, law.targets
        if not (
            abs(q[-1] - q[0] - REVOLUTION) <= PERIODIC
            and abs(lift[-1] - lift[0]) <= PERIODIC * max(map(abs, lift))
        ):
            reason = f"is from {q[0]:g} to {q[-1]:g} rad with lifts {lift[0]:g} and {lift[-1]:g}"
            raise values.source.error(path, f"{reason}; give one revolution, 2 pi, with equal ends")
        return law
    ends, levels = [0.0], [0.0]
    for i, segment in enumerate(written):
        if not segment["over"] > 0.0 or ("to" in segment) != ("kind" in segment):
            reason = "is no segment; give over = an angle above 0 and, for a rise or return, to and kind"
            raise values.source.error((*path, i), reason)
        ends.append(ends[-1] + segment["over"])
        levels.append(
            values.quantity(segment["to"], unit, (*path, i, "to")) if "to" in segment else levels[-1]
        )
    if not abs(ends[-1] - REVOLUTION) <= PERIODIC or levels[-1] != 0.0:
        reason = f"ends after {np.rad2deg(ends[-1]):.6g} deg at {levels[-1]:g} {unit}; end after 360 deg at 0"
        raise values.source.error(path, reason)
    kinds = tuple(segment.get("kind", "dwell") for segment in written)
    return SegmentedLaw(f"law of cam {name}", kinds, tuple(ends), tuple(levels))


def _in_metres(x: float, y: float) -> list[str]:
    """Return a point of the plane as text, since numbers are in the units of the file."""
    return [f"{x!r} m", f"{y!r} m", "0 m"]


def cam_joints(
    name: str, joint: Mapping[str, Any], cams: Mapping[str, Cam], entries: Mapping[str, Any]
) -> GuidedJoint:
    """Return the joints of a joint of kind cam."""
    side = {key: entry for key, entry in joint["a"].items() if key != "cam"}
    cam = cams.get(joint["a"].get("cam"))
    if cam is None or not {*side} <= {"link", "at", "reference"} or not {*joint} <= {"kind", "a", "b"}:
        raise InputError(
            f"joint {name!r} is of kind cam; give only a = {{ link, cam }}, if needed at and reference, and "
            f"b = {{ link, at }}, with a cam of the file ({', '.join(cams) or 'it has none'})"
        )
    guide, lifted = f"{VIRTUAL_PREFIX}{name}.guide", f"{VIRTUAL_PREFIX}{name}"
    back, flat = {"axis": [0.0, 0.0, -1.0]}, cam.kind == "flat"
    if cam.motion == "translating":
        kind, along = "prismatic", {"axis": [0.0, 1.0, 0.0]}
        position, start, contact = (0.0 if flat else cam.offset, cam.start), along, (0.0, 0.0)
    else:
        kind, along, position = "revolute", back, (cam.centre_distance, 0.0)
        start = along | {"reference": [-np.cos(cam.start), np.sin(cam.start), 0.0]}
        contact = (0.0, -cam.offset) if flat else (cam.arm, 0.0)
    force_joint, face = (f"{name}.face", {"axis": [1.0, 0.0, 0.0]}) if flat else (f"{name}.point", {})
    joints: dict[str, Any] = {
        name: {"kind": "revolute", "a": side | back, "b": {"link": guide, **back}},
        lifted: {
            "kind": kind,
            "a": {"link": guide, "at": _in_metres(*position), **start},
            "b": {"link": lifted, **along},
        },
        force_joint: {
            "kind": "prismatic" if flat else "spherical",
            "a": {"link": lifted, "at": _in_metres(*contact), **face},
            "b": face | joint["b"],
        },
    }
    coupling = Coupling(f"{name}.law", lifted, name, (), function=cam.law, repeats=True)
    entry = entries[cam.name]
    one_sided, restitution = entry.get("closure", "force") == "force", entry.get("restitution")
    if restitution is not None and not (one_sided and 0.0 <= restitution <= 1.0):
        raise InputError(
            f"cam {cam.name!r} has the restitution {restitution:g}; give 0 to 1, to a cam with closure force"
        )
    contact_made = Contact(side["link"], force_joint, name, guide, cam, one_sided, restitution)
    return GuidedJoint((guide, lifted), joints, (coupling,), contact_made)


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
