"""Files of pylinkage: joints with positions, and links that name them.

Source: pylinkage 1.3, module pylinkage.mechanism.serialization. The format has no unit.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.io.planar_json import entries, in_plane, pins, point, slide, text
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Link
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import ROUNDING

DRIVERS = ("driver", "arc_driver")
# keys that are read
READ = (
    "name joints links id type position axis line_point ref_joint1_id ref_joint2_id distance angle "
    "motor_joint"
)
NAMED = ()


def mechanism(name: str, content: Mapping[str, Any]) -> Mechanism:
    """Return the mechanism of a file that `mechanism_to_json` wrote."""
    listed = {text(entry, "id", "a joint"): entry for entry in entries(content, "joints")}
    links, driven = _links(content, listed)
    trackers = [key for key, entry in listed.items() if entry.get("type") == "tracker"]
    positions = {
        key: point(entry.get("position"), f"the position of joint {key!r}")
        for key, entry in listed.items()
        if key not in trackers
    }
    joints: list[Joint] = []
    blocks: list[str] = []
    for key, position in positions.items():
        members = [link for link, ids in links.items() if key in ids]
        if listed[key].get("type") == "prismatic":
            blocks.append(f"{key} block")
            joints.append(_slider(key, listed[key], position))
            joints += pins(
                f"{key} pin", [blocks[-1], *(link for link in members if link != GROUND)], position
            )
        elif members:
            joints += pins(key, members, position)
    names = [link for link in links if link != GROUND]
    drivers = tuple(
        joint.name
        for link, motor in driven
        for joint in joints
        if joint.links == (GROUND, link) and joint.name in (motor, f"{motor}_{link}")
    )
    points = {key: (_carrier(links, [key]), in_plane(position)) for key, position in positions.items()}
    points |= {key: _tracked(key, listed[key], links, positions) for key in trackers}
    moving = tuple(Link(link) for link in [*names, *blocks])
    return Mechanism(
        str(content.get("name") or name),
        moving,
        tuple(joints),
        drivers,
        {key: position for key, position in points.items() if position[0] != GROUND},
        guess={link.name: IDENTITY for link in moving},
        up="y",
    )


def _links(
    content: Mapping[str, Any], joints: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, list[str]], list[tuple[str, str]]]:
    """Return link -> its joints, and the pairs of a driven link and its motor joint."""
    links: dict[str, list[str]] = {GROUND: []}
    driven: list[tuple[str, str]] = []
    for entry in entries(content, "links"):
        link, listed, kind = text(entry, "id", "a link"), entry.get("joints"), entry.get("type", "link")
        if not isinstance(listed, list) or not listed:
            raise InputError(f"link {link!r} has no joints; give their ids")
        ids = [str(key) for key in listed]
        if kind not in ("ground", "link", *DRIVERS):
            raise InputError(
                f"link {link!r} is of type {kind!r}; choose from ground, link, driver, arc_driver"
            )
        motor = [str(entry.get("motor_joint"))] if kind in DRIVERS else []
        unknown = [key for key in [*ids, *motor] if key not in joints]
        if unknown:
            raise InputError(f"link {link!r} names joint {unknown[0]!r}, which is not listed; correct its id")
        if kind == "ground":
            links[GROUND] += ids
            continue
        if link in links:
            raise InputError(f"two links are called {link!r}; rename one")
        links[link] = ids
        driven += [(link, key) for key in motor]
    motors = {motor for _, motor in driven}
    links[GROUND] += [
        key
        for key, entry in joints.items()
        if key not in links[GROUND] and (entry.get("type") == "ground" or key in motors)
    ]
    return links, driven


def _slider(key: str, entry: Mapping[str, Any], position: tuple[float, float]) -> Joint:
    """Return the slide of a block along the line of a prismatic joint."""
    axis = np.array(point(entry.get("axis", (1.0, 0.0)), f"the axis of joint {key!r}"))
    through = np.array(point(entry.get("line_point", (0.0, 0.0)), f"line_point of joint {key!r}"))
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise InputError(f"the axis of joint {key!r} has length 0; give a direction")
    offset = np.array(position) - through
    distance = abs(float(axis[0] * offset[1] - axis[1] * offset[0])) / length
    if not distance <= ROUNDING * max(np.abs([*position, *through]).max(), 1e-300):
        raise InputError(
            f"joint {key!r} at {position} is {distance:g} from its line through {tuple(through.tolist())}; "
            "correct its position or line_point"
        )
    return slide(key, GROUND, f"{key} block", position, (float(axis[0]), float(axis[1])))


def _carrier(links: Mapping[str, list[str]], keys: list[str]) -> str:
    """Return a moving link with these joints; the ground where there is none."""
    carriers = (link for link, ids in links.items() if link != GROUND and {*keys} <= {*ids})
    return next(carriers, GROUND)


def _tracked(
    key: str,
    entry: Mapping[str, Any],
    links: Mapping[str, list[str]],
    positions: Mapping[str, tuple[float, float]],
) -> tuple[str, tuple[float, float, float]]:
    """Return the link and position of a tracker, polar from one joint to another."""
    first, second = (str(entry.get(f"ref_joint{number}_id")) for number in (1, 2))
    if first not in positions or second not in positions:
        raise InputError(f"tracker {key!r} refers to joints {first!r} and {second!r}; name two joints")
    carrier = _carrier(links, [first, second])
    if carrier == GROUND:
        raise InputError(f"no link has both joints of tracker {key!r}, {first!r} and {second!r}; name others")
    distance, angle = point((entry.get("distance"), entry.get("angle")), f"distance and angle of {key!r}")
    origin, towards = np.array(positions[first]), np.array(positions[second])
    base = float(np.arctan2(*(towards - origin)[::-1]))
    position = origin + distance * np.array([np.cos(base + angle), np.sin(base + angle)])
    return carrier, in_plane(position.tolist())
