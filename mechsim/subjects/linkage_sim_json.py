"""Files of linkage_sim: bodies with points in their own frames, and joints between points, in SI.

Source: ARCHITECTURE.md of linkage_sim, section Serialization, schema 1.0.0.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, Inertia, Link
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.planar_json import in_plane, point

SCHEMA = "1."
KINDS = ("revolute", "prismatic", "fixed")
POINTS = ("attachment_points", "coupler_points")


def mechanism(name: str, content: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism of a file of schema 1; its drivers are the joints that the file drives."""
    version = content.get("schema_version")
    if not str(version).startswith(SCHEMA):
        raise InputError(f"schema_version is {version!r}; files of schema 1 are read")
    bodies, listed = (_objects(content, key) for key in ("bodies", "joints"))
    local = {body: _points_of(body, entry) for body, entry in bodies.items()}
    joints = {key: _joint(key, entry, local) for key, entry in listed.items() if entry.get("type") in KINDS}
    drivers: list[str] = []
    for key, entry in listed.items():
        if entry.get("type") not in (*KINDS, "revolute_driver"):
            kind = entry.get("type")
            raise InputError(f"joint {key!r} is of type {kind!r}; choose from {', '.join(KINDS)}")
        if entry.get("driven"):
            drivers.append(key)
        elif key not in joints:
            drivers += _between(joints, entry)
    points = {
        f"{body}.{label}" if label in _repeated(local) else label: (body, in_plane(position))
        for body, own in local.items()
        if body != GROUND
        for label, position in own.items()
    }
    links = tuple(_link(body, entry) for body, entry in bodies.items() if body != GROUND)
    return Mechanism(name, links, tuple(joints.values()), tuple(dict.fromkeys(drivers)), points, up="y")


def _objects(content: Mapping[str, Any], key: str) -> Mapping[str, Mapping[str, Any]]:
    objects = content[key]
    if not isinstance(objects, dict) or not all(isinstance(entry, dict) for entry in objects.values()):
        raise InputError(f"{key} is no object of objects; write {key}: {{NAME: {{...}}}}")
    return objects


def _points_of(body: str, entry: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Return the points of a body in its frame."""
    points: dict[str, tuple[float, float]] = {}
    for key in POINTS:
        named = entry.get(key, {})
        if not isinstance(named, dict):
            raise InputError(f"{key} of body {body!r} is no object; write {key}: {{NAME: [x, y]}}")
        points |= {
            label: point(position, f"point {label!r} of {body!r}") for label, position in named.items()
        }
    return points


def _repeated(points: Mapping[str, Mapping[str, Any]]) -> set[str]:
    labels = [label for own in points.values() for label in own]
    return {label for label in labels if labels.count(label) > 1}


def _joint(
    key: str, entry: Mapping[str, Any], points: Mapping[str, Mapping[str, tuple[float, float]]]
) -> Joint:
    kind = str(entry["type"])
    (angle, _) = point((entry.get("delta_theta_0", 0.0), 0.0), f"delta_theta_0 of joint {key!r}")
    axis = point(entry.get("axis_local_i", (1.0, 0.0)), f"axis_local_i of joint {key!r}")
    ends: list[End] = []
    for side, rotation in (("i", 0.0), ("j", -angle)):
        body, label = str(entry.get(f"body_{side}")), str(entry.get(f"point_{side}"))
        if label not in points.get(body, ()):
            raise InputError(f"joint {key!r} is at point {label!r} of body {body!r}, which is not listed")
        position = in_plane(points[body][label])
        cos, sin = float(np.cos(rotation)), float(np.sin(rotation))
        along = in_plane((cos * axis[0] - sin * axis[1], sin * axis[0] + cos * axis[1]))
        normal = (0.0, 0.0, 1.0)
        if kind == "prismatic":
            ends.append(End(body, position, along, normal))
        else:
            ends.append(End(body, position, normal, in_plane((cos, sin)) if kind == "fixed" else None))
    return Joint(key, kind, ends[0], ends[1])  # type: ignore[arg-type]


def _between(joints: Mapping[str, Joint], entry: Mapping[str, Any]) -> list[str]:
    """Return the revolute joint between the bodies of a driver."""
    bodies = {str(entry.get("body_i")), str(entry.get("body_j"))}
    return [
        key
        for key, joint in joints.items()
        if joint.kind == "revolute" and {joint.a.link, joint.b.link} == bodies
    ]


def _link(body: str, entry: Mapping[str, Any]) -> Link:
    """Return a body with its mass; moments about the axes in the plane are half of that about its normal."""
    mass, moment = point((entry.get("mass", 0.0), entry.get("Izz_cg", 0.0)), f"mass and Izz_cg of {body!r}")
    if not (mass > 0.0 and moment > 0.0):
        return Link(body)
    centre = in_plane(point(entry.get("cg_local", (0.0, 0.0)), f"cg_local of {body!r}"))
    half = 0.5 * moment
    return Link(body, inertia=Inertia(mass, centre, ((half, 0.0, 0.0), (0.0, half, 0.0), (0.0, 0.0, moment))))
