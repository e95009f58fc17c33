"""Any mechanism as TOML that reads back to the same one, to the last bit."""

from collections.abc import Iterator, Mapping

import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.model.couplings import Coupling, Gear
from mechsim.model.joints import End, Joint
from mechsim.model.links import Link, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.toml_driving import driving_lines
from mechsim.subjects.toml_text import key, listed, number, quoted


def to_toml(source: Mechanism | LoopForm) -> str:
    """Return a mechanism as text in TOML, in metres and radians, numbers with 17 digits.

    Args:
        source: the mechanism, or what moves: then with its programs, forces and formula.

    Raises:
        InputError: for a program or a load that is no text and no constant.
    """
    mechanism = source if isinstance(source, Mechanism) else source.mechanism
    lines = [f"name = {quoted(mechanism.name)}", f"drivers = [{', '.join(map(quoted, mechanism.drivers))}]"]
    lines += _start(mechanism)
    if isinstance(source, LoopForm):
        lines += driving_lines(source)
    if mechanism.up is not None:
        lines += ["", "[display]", f"up = {quoted(mechanism.up)}"]
    for link in mechanism.links:
        lines += ["", f"[links.{key(link.name)}]", *_link(link)]
    for joint in mechanism.joints:
        lines += ["", f"[joints.{key(joint.name)}]", *_joint(joint)]
    names = [coupling.name for coupling in mechanism.couplings]
    for i, gear in enumerate(mechanism.gears):
        lines += ["", f"[couplings.{key(_gear_name(mechanism, i, names))}]", *_gear(gear)]
    for coupling in mechanism.couplings:
        lines += ["", f"[couplings.{key(coupling.name)}]", *_coupling(coupling)]
    if mechanism.locked:
        lines += ["", "[locked]", *_values(mechanism.locked)]
    if mechanism.points:
        lines += ["", "[points]"]
    for name, (link, position) in mechanism.points.items():
        lines.append(f"{key(name)} = {{ link = {quoted(link)}, at = {listed(position)} }}")
    if mechanism.guess:
        lines += ["", "[guess]"]
    for link, pose in mechanism.guess.items():
        lines.append(f"{key(link)} = {_pose(pose)}")
    return "\n".join(lines) + "\n"


def _start(mechanism: Mechanism) -> Iterator[str]:
    """Yield where the drivers stand at the guess: the crank's angle, or a table."""
    counted = dict(mechanism.counted)
    if mechanism.has_crank:
        if not counted:
            yield f"start = {number(mechanism.start)}"
            return
        counted = {mechanism.crank.name: mechanism.start, **counted}
    if counted:
        yield f"start = {{ {', '.join(_values(counted))} }}"


def _values(values: Mapping[str, float]) -> Iterator[str]:
    for name, value in values.items():
        yield f"{key(name)} = {number(value)}"


def _link(link: Link) -> Iterator[str]:
    if link.outline:
        yield f"outline = [{', '.join(listed(point) for point in link.outline)}]"
    if link.inertia is not None:
        moments = ", ".join(listed(row) for row in link.inertia.moments)
        mass, centre = number(link.inertia.mass), listed(link.inertia.centre)
        yield f"inertia = {{ mass = {mass}, centre = {centre}, moments = [{moments}] }}"


def _joint(joint: Joint) -> Iterator[str]:
    yield f"kind = {quoted(joint.kind)}"
    yield f"a = {_end(joint.a)}"
    yield f"b = {_end(joint.b)}"
    if joint.cross_angle != np.pi / 2:
        yield f"cross_angle = {number(joint.cross_angle)}"
    if joint.lead:
        yield f"lead = {number(joint.lead)}"


def _end(end: End) -> str:
    assert end.mark is not None
    fields = f"at = {listed(end.point)}, axis = {listed(end.axis)}, mark = {listed(end.mark)}"
    return f"{{ link = {quoted(end.link)}, {fields} }}"


def _gear(gear: Gear) -> Iterator[str]:
    yield f"driver = {quoted(gear.driver)}"
    yield f"driven = {quoted(gear.driven)}"
    yield f"ratio = {number(gear.ratio)}"
    yield f"phase = {number(gear.phase)}"
    if gear.pressure_angle:
        yield f"pressure_angle = {number(gear.pressure_angle)}"


def _gear_name(mechanism: Mechanism, index: int, names: list[str]) -> str:
    name = "gear" if len(mechanism.gears) == 1 else f"gear{index + 1}"
    while name in names:
        name += "_"
    return name


def _coupling(coupling: Coupling) -> Iterator[str]:
    yield f"driven = {_side(coupling.left)}"
    if coupling.right:
        yield f"driver = {_side(coupling.right)}"
    yield f"coefficients = {listed(coupling.coefficients)}"
    if coupling.zeros != (0.0, 0.0):
        yield f"zeros = {listed(coupling.zeros)}"
    if coupling.turns:
        yield "turns = true"
    if coupling.pressure_angle is not None:
        yield f"pressure_angle = {number(coupling.pressure_angle)}"


def _side(side: str | Mapping[str, float]) -> str:
    return quoted(side) if isinstance(side, str) else f"{{ {', '.join(_values(side))} }}"


def _pose(pose: Pose) -> str:
    rows = ", ".join(listed(row) for row in np.asarray(pose.rotation).tolist())
    return f"{{ at = {listed(np.asarray(pose.position).tolist())}, rotation = [{rows}] }}"
