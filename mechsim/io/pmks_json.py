"""Files of PMKS, the Planar Mechanism Kinematic Simulator: positions of joints and the links that they join.

Source: PMKSFileFormat.md, version 1.0, and the attributes of its class Joint. The format has no unit.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mechsim.errors import InputError, require_once
from mechsim.io.planar_json import entries, in_plane, pins, point, slide
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Link
from mechsim.mechanism.mechanism import Mechanism

# keys that are read
READ = "Joints X Y Angle TypeOfJoint Links DrivingIndex"
NAMED = ()


def mechanism(name: str, content: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism of a PMKS file: R joints, and P and RP joints that slide along the ground."""
    joints: list[Joint] = []
    names: dict[str, None] = {}
    points: dict[str, tuple[str, tuple[float, float, float]]] = {}
    numbers: dict[int, str] = {}
    for number, entry in enumerate(entries(content, "Joints")):
        label = f"J{number + 1}"
        position = point((entry.get("X"), entry.get("Y")), f"the position of joint {number + 1}")
        links = _links(entry, number)
        names |= dict.fromkeys(link for link in links if link != GROUND)
        moving = next((link for link in links if link != GROUND), None)
        if moving is not None:
            points[f"P{number + 1}"] = moving, in_plane(position)
        made, block = _joints(label, entry, links, position)
        joints += made
        names |= dict.fromkeys(block)
        if made:
            numbers[number] = made[0].name
    driving = content.get("DrivingIndex", 0)
    if not isinstance(driving, int) or driving not in numbers:
        raise InputError(
            f"DrivingIndex is {driving!r}, no joint of two links; give one of "
            f"{', '.join(map(str, numbers)) or 'none'}"
        )
    links = tuple(Link(link) for link in names)
    guess = {link.name: IDENTITY for link in links}
    return Mechanism(name, links, tuple(joints), numbers[driving], points, guess=guess, up="y")


def _links(entry: Mapping[str, Any], number: int) -> list[str]:
    links = entry.get("Links")
    if not isinstance(links, list) or not links or not all(isinstance(link, str) and link for link in links):
        raise InputError(f"joint {number + 1} names no links; give Links: [NAME, NAME]")
    names = [GROUND if link.lower() == GROUND else link for link in links]
    require_once(f"joint {number + 1}", names)
    return names


def _joints(
    label: str, entry: Mapping[str, Any], links: list[str], position: tuple[float, float]
) -> tuple[list[Joint], list[str]]:
    """Return the joints of an entry, and the blocks that slide where a pin does."""
    kind = entry.get("TypeOfJoint")
    if kind == "R":
        return pins(label, links, position), []
    if kind not in ("P", "RP"):
        raise InputError(f"joint {label} is of type {kind!r}; R, P and RP joints are read")
    if GROUND not in links or len(links) != 2:
        raise InputError(
            f"{kind} joint {label} joins {', '.join(links)}; one that slides along the ground is read"
        )
    (angle, _) = point((entry.get("Angle", 0.0), 0.0), f"the angle of joint {label}")
    direction = float(np.cos(angle)), float(np.sin(angle))
    (moving,) = (link for link in links if link != GROUND)
    if kind == "P":
        return [slide(label, GROUND, moving, position, direction)], []
    block = f"{label} block"
    return [
        slide(label, GROUND, block, position, direction),
        *pins(f"{label} pin", [block, moving], position),
    ], [block]
