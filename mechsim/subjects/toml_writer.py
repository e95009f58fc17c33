"""Any mechanism as TOML that reads back to the same one, to the last bit."""

import json
import re
from collections.abc import Iterable, Iterator

import numpy as np

from mechsim.model.couplings import Gear
from mechsim.model.mechanism import End, Joint, Link, Mechanism, Pose

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_of(mechanism: Mechanism) -> str:
    """Return a mechanism as text in TOML, in metres and radians, numbers with 17 digits."""
    lines = [f"name = {_text(mechanism.name)}", f"drivers = [{', '.join(map(_text, mechanism.drivers))}]"]
    lines.append(f"start = {_number(mechanism.start)}")
    for link in mechanism.links:
        lines += ["", f"[links.{_key(link.name)}]", *_link(link)]
    for joint in mechanism.joints:
        lines += ["", f"[joints.{_key(joint.name)}]", *_joint(joint)]
    for i, gear in enumerate(mechanism.gears):
        lines += ["", f"[couplings.{_key(_gear_name(mechanism, i))}]", *_gear(gear)]
    if mechanism.points:
        lines += ["", "[points]"]
    for name, (link, place) in mechanism.points.items():
        lines.append(f"{_key(name)} = {{ link = {_text(link)}, at = {_list(place)} }}")
    if mechanism.guess:
        lines += ["", "[guess]"]
    for link, pose in mechanism.guess.items():
        lines.append(f"{_key(link)} = {_pose(pose)}")
    return "\n".join(lines) + "\n"


def _link(link: Link) -> Iterator[str]:
    if link.outline:
        yield f"outline = [{', '.join(_list(point) for point in link.outline)}]"
    if link.inertia is not None:
        moments = ", ".join(_list(row) for row in link.inertia.moments)
        mass, centre = _number(link.inertia.mass), _list(link.inertia.centre)
        yield f"inertia = {{ mass = {mass}, centre = {centre}, moments = [{moments}] }}"


def _joint(joint: Joint) -> Iterator[str]:
    yield f"kind = {_text(joint.kind)}"
    yield f"a = {_end(joint.a)}"
    yield f"b = {_end(joint.b)}"
    if joint.cross_angle != np.pi / 2:
        yield f"cross_angle = {_number(joint.cross_angle)}"


def _end(end: End) -> str:
    assert end.mark is not None
    places = f"at = {_list(end.point)}, axis = {_list(end.axis)}, mark = {_list(end.mark)}"
    return f"{{ link = {_text(end.link)}, {places} }}"


def _gear(gear: Gear) -> Iterator[str]:
    yield f"driver = {_text(gear.driver)}"
    yield f"driven = {_text(gear.driven)}"
    yield f"ratio = {_number(gear.ratio)}"
    yield f"phase = {_number(gear.phase)}"


def _gear_name(mechanism: Mechanism, index: int) -> str:
    return "gear" if len(mechanism.gears) == 1 else f"gear{index + 1}"


def _pose(pose: Pose) -> str:
    rows = ", ".join(_list(row) for row in np.asarray(pose.rotation).tolist())
    return f"{{ at = {_list(np.asarray(pose.position).tolist())}, rotation = [{rows}] }}"


def _list(values: Iterable[float]) -> str:
    return f"[{', '.join(_number(value) for value in values)}]"


def _number(value: float) -> str:
    text = f"{float(value):.17g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _text(value: str) -> str:
    return json.dumps(value)


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)
