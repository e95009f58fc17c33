"""Links, joints and poses of a mechanism in a TOML file."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mechsim.io.toml_values import TomlSource, suggestion
from mechsim.kinematics.vector_method.rotations import turned_by
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import EZ, GROUND, Inertia, Link, Pose, Vector, vector
from mechsim.numerics.arrays import REVOLUTION

# largest number of sectors of an outline, and difference below which it is whole
MAX_REPEAT, WHOLE = 1000, 0.01
# inertia of a link that only connects joints
MASSLESS = {"inertia": {"mass": 0.0, "centre": [0.0] * 3, "moments": [0.0] * 3}}


def links_of(source: TomlSource, read: Mapping[str, Any]) -> Iterator[Link]:
    """Yield the links with tables, then those that at least two joints name."""
    declared: dict[str, Any] = read.get("links", {})
    if GROUND in declared:
        raise source.error(("links", GROUND), "is the frame, which has no table; leave it out")
    for name, entry in declared.items():
        with source.error_context(("links", name)):
            inertia = entry.get("inertia")
            polygon = entry.get("polygon", False)
            yield Link(name, _outline(source, name, entry), inertia and Inertia(**inertia), polygon)
    named = [(joint, side, entry[side]["link"]) for joint, entry in read["joints"].items() for side in "ab"]
    count = Counter(link for _, _, link in named)
    for joint, side, link in named:
        if link in declared or link == GROUND:
            continue
        if count[link] == 1:
            candidates = dict.fromkeys(name for name in (GROUND, *declared, *count) if name != link)
            reason = f"is {link!r}, which no other joint names and [links] does not contain"
            table = f"; a link of one joint needs a table, [links.{link}]"
            raise source.error(("joints", joint, side, "link"), reason + suggestion(link, candidates) + table)
    yield from (Link(name) for name in count if name not in declared and name != GROUND)


def _outline(source: TomlSource, name: str, entry: Mapping[str, Any]) -> tuple[Vector, ...]:
    """Return the points of an outline, as often as it repeats about the z axis of its link."""
    stated, points = entry.get("repeat", 1), np.reshape(entry.get("outline", ()), (-1, 3))
    # derivatives by a number of slots change it a little
    count = round(stated)
    if not (1 <= count <= MAX_REPEAT and abs(stated - count) < WHOLE):
        reason = f"is {stated:g}; give a whole number, 1 to {MAX_REPEAT}"
        raise source.error(("links", name, "repeat"), reason)
    angles = REVOLUTION / count * np.arange(count)
    rotations = turned_by(np.eye(3)[None], angles[:, None] * np.array([EZ]))
    return tuple(vector(point) for rotation in rotations for point in points @ rotation.T)


def joint_of(source: TomlSource, name: str, entry: Mapping[str, Any]) -> Joint:
    """Return a joint."""
    with source.error_context(("joints", name)):
        a, b = (end_of(entry[side]) for side in "ab")
        rest = {key: entry[key] for key in ("cross_angle", "lead", "length") if key in entry}
        return Joint(name, entry["kind"], a, b, **rest)


def end_of(entry: Mapping[str, Any]) -> End:
    """Return a frame on a link."""
    fields = {"link": "link", "at": "point", "axis": "axis", "reference": "reference"}
    return End(**{fields[key]: value for key, value in entry.items()})


def pose_of(source: TomlSource, link: str, entry: Mapping[str, Any]) -> Pose:
    """Return the guess of a link's pose."""
    rotation = np.eye(3)
    if "turn" in entry and "rotation" in entry:
        raise source.error(("guess", link), "has both turn and rotation; give one of them")
    if "turn" in entry:
        axis = np.array(entry["turn"]["axis"])
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise source.error(("guess", link, "turn"), "has an axis of length 0; give a direction")
        rotation = turned_by(rotation[None], (axis / length * entry["turn"]["angle"])[None])[0]
    elif "rotation" in entry:
        rotation = np.array(entry["rotation"])
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6 or np.linalg.det(rotation) < 0.0:
            raise source.error(("guess", link, "rotation"), "is no rotation matrix; give one, or a turn")
    return Pose(np.array(entry.get("at", (0.0, 0.0, 0.0))), rotation)
