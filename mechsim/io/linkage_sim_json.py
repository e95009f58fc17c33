"""Files of linkage_sim: bodies with points in their own frames, and joints between points, in SI.

Source: ARCHITECTURE.md of linkage_sim, section Serialization, schema 1.0.0.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.io.planar_json import entries, in_plane, point
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, ORIGIN, Inertia, Link, combine
from mechsim.mechanism.mechanism import Mechanism

SCHEMA = "1."
KINDS = ("revolute", "prismatic", "fixed")
NO_MOMENTS = (ORIGIN, ORIGIN, ORIGIN)
POINTS = ("attachment_points", "mount_points", "coupler_points")
# keys that are read, and labels
READ = (
    "schema_version bodies joints drivers type driven body_i body_j point_i point_j axis_local_i "
    f"delta_theta_0 mass Izz_cg izz_cg cg_local ch_local point_masses local_pos label note {' '.join(POINTS)}"
)
NAMED = ("bodies", "joints", "drivers", *POINTS)


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
            drivers.append(_driven(key, entry, joints))
    driving = _objects({"drivers": {}, **content}, "drivers")
    drivers += [_driven(key, entry, joints) for key, entry in driving.items()]
    counts = Counter(label for own in local.values() for label in own)
    points = {
        f"{body}.{label}" if counts[label] > 1 else label: (body, in_plane(position))
        for body, own in local.items()
        if body != GROUND
        for label, position in own.items()
    }
    return Mechanism(
        name, _links(bodies), tuple(joints.values()), tuple(dict.fromkeys(drivers)), points, up="y"
    )


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


def _driven(driver: str, entry: Mapping[str, Any], joints: Mapping[str, Joint]) -> str:
    """Return the revolute joint between the bodies of a driver."""
    first, second = (str(entry.get(side)) for side in ("body_i", "body_j"))
    for key, joint in joints.items():
        if joint.kind == "revolute" and {joint.a.link, joint.b.link} == {first, second}:
            return key
    raise InputError(
        f"driver {driver!r} is between {first!r} and {second!r}, which no revolute joint joins; correct "
        "body_i and body_j"
    )


def _links(bodies: Mapping[str, Mapping[str, Any]]) -> tuple[Link, ...]:
    """Return the moving bodies with their masses; without one if the file gives no body any."""
    inertias: dict[str, Inertia | None] = {}
    for body, entry in bodies.items():
        if body != GROUND:
            try:
                inertias[body] = _inertia(entry)
            except InputError as error:
                raise InputError(f"body {body!r}: {error}") from None
    weighs = any(item and (item.mass or item.matrix.any()) for item in inertias.values())
    return tuple(Link(body, inertia=item if weighs else None) for body, item in inertias.items())


def _inertia(entry: Mapping[str, Any]) -> Inertia | None:
    """Return the mass of a body with its point masses; None without an entry.

    Moments about axes in the plane, which have no effect, are half of that about its normal.
    """
    moment_keys, centre_keys = ("Izz_cg", "izz_cg"), ("cg_local", "ch_local")
    points = entry.get("point_masses", [])
    if not points and not {"mass", *moment_keys} & entry.keys():
        return None
    mass, moment = point((entry.get("mass", 0.0), _first(entry, moment_keys, 0.0)), "mass and Izz_cg")
    centre = in_plane(point(_first(entry, centre_keys, (0.0, 0.0)), "cg_local"))
    half = 0.5 * moment
    masses = [Inertia(mass, centre, ((half, 0.0, 0.0), (0.0, half, 0.0), (0.0, 0.0, moment)))]
    for added in entries(entry, "point_masses") if points else ():
        (mass, _) = point((added.get("mass"), 0.0), "a point mass")
        position = in_plane(point(added.get("local_pos"), "local_pos of a point mass"))
        masses.append(Inertia(mass, position, NO_MOMENTS))
    return combine(masses)


def _first(entry: Mapping[str, Any], keys: tuple[str, ...], default: Any) -> Any:
    """Return the value of the first key that an entry has; files of its GUI write other keys."""
    return next((entry[key] for key in keys if key in entry), default)
