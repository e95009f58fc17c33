"""Joints of kind cam in a TOML file, written with other joints.

A massless body, the guide, rotates on the cam by -q about its axis, so that it keeps the directions of the
follower's guide. On it a second body moves by the cam's law of q; a ball joint connects this with the roller
or edge, a slide with a flat face. Since both have no mass, the force is normal to the profile.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.toml_values import KeyPath, Values, tabled_function, written_function
from mechsim.mechanism.cams import PERIODIC, Cam, LiftLaw, SegmentedLaw
from mechsim.mechanism.contacts import Contact
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.links import VIRTUAL_PREFIX
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
