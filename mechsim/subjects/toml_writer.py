"""Mechanisms as TOML text that reads back to the last bit."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from mechsim import files
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Location
from mechsim.model.joints import Coupling, End, Gear, Joint
from mechsim.model.links import Link, Pose
from mechsim.model.load_profile import LoadProfile
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import MotionLaws
from mechsim.model.motors import ConstantTorque, Geared, Motor, PlainMotor, TorqueSpeedLine
from mechsim.subjects.law_text import MotionLaw, WrittenLoad

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def listed(values: Iterable[float]) -> str:
    """Return numbers as a list."""
    return f"[{', '.join(number(value) for value in values)}]"


def number(value: float) -> str:
    """Return a number that reads back to the last bit."""
    text = f"{float(value):.17g}"
    return text if any(character in text for character in ".e") else f"{text}.0"


def quoted(value: str) -> str:
    """Return text in quotes."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("\x7f", "\\u007f")


def key(name: str) -> str:
    """Return a name as a key."""
    return name if _BARE.fullmatch(name) else quoted(name)


def driving_lines(solver: LoopForm) -> Iterator[str]:
    """Yield the lines of motion laws, forces and formula.

    Raises:
        InputError: for a motion law or load without text.
    """
    if not solver.motion_laws.crank:
        yield from _motion_law_lines(solver.motion_laws)
    if solver.formula:
        yield from ("", "[formula]", f"python = {quoted(solver.formula)}")
    if solver.forces is not None:
        yield from _force_lines(solver.forces)


def _motion_law_lines(laws: MotionLaws) -> Iterator[str]:
    yield f"duration = {number(laws.duration)}"
    yield from ("", "[motion_laws]")
    for name, state in laws.by_name.items():
        if not isinstance(state, MotionLaw):
            raise InputError(f"the motion law of {name} is a function without text; give it as text")
        yield f"{key(name)} = {quoted(_absolute(state.text))}"


def _force_lines(forces: Forces) -> Iterator[str]:
    yield from ("", "[forces]", f"gravity = {listed(forces.gravity)}")
    if forces.crank_torque is not None:
        yield f"crank_torque = {_components(forces.crank_torque, 'the load on the crank')[0]}"
    if forces.flywheel:
        yield f"flywheel = {number(forces.flywheel)}"
    for controller in forces.controllers:
        coordinate = ".".join(key(name) for name in controller.coordinate.split("."))
        yield f"controllers.{coordinate} = {quoted(controller.text)}"
    if forces.motor is not None:
        yield f"motor = {_table(_motor(forces.motor))}"
    for friction in forces.friction:
        fields = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")
        nonzero = {field: number(getattr(friction, field)) for field in fields if getattr(friction, field)}
        yield f"friction.{key(friction.joint)} = {_table(nonzero)}"
    for i, spring in enumerate(forces.springs, 1):
        numbers = {field: number(getattr(spring, field)) for field in ("stiffness", "rest", "damping")}
        yield f"springs.spring{i} = {_table({'a': _point(spring.a), 'b': _point(spring.b), **numbers})}"
    for spring in forces.joint_springs:
        numbers = {field: number(getattr(spring, field)) for field in ("stiffness", "rest")}
        yield f"joint_springs.{key(spring.joint)} = {_table(numbers)}"
    for i, load in enumerate(forces.loads, 1):
        force = ", ".join(_components(load.force, f"the load on {load.location}"))
        yield f"loads.load{i} = {_table({'at': _point(load.location), 'force': f'[{force}]'})}"
    for couple in forces.couples:
        moment = ", ".join(_components(couple.moment, f"the couple on {couple.link}"))
        yield f"couples.{key(couple.link)} = [{moment}]"


def _motor(motor: Motor) -> dict[str, str]:
    if isinstance(motor, Geared):
        return {**_plain_motor(motor.motor), "gear": number(motor.ratio)}
    return _plain_motor(motor)


def _plain_motor(motor: PlainMotor) -> dict[str, str]:
    if isinstance(motor, ConstantTorque):
        return {"kind": quoted("constant"), "torque": number(motor.value)}
    if isinstance(motor, TorqueSpeedLine):
        return {"kind": quoted("line"), "stall": number(motor.stall), "no_load": number(motor.no_load)}
    fields = {field: number(getattr(motor, field)) for field in ("voltage", "resistance", "constant")}
    return {"kind": quoted("dc"), **fields}


def _components(profile: LoadProfile, what: str) -> list[str]:
    """Return the text of a load along each axis."""
    if isinstance(profile.value, WrittenLoad):
        texts = [component.text for component in profile.value.components]
        return [quoted(_absolute(text)) if isinstance(text, str) else number(text) for text in texts]
    if profile.over is not None:
        raise InputError(f"{what} is a function of {profile.over} without text; give it as text")
    return [number(text) for text in profile.evaluate(np.zeros(1)).ravel()]


def _absolute(text: str) -> str:
    """Return the text of a motion law or a load with an absolute path if it is a file."""
    return str(Path(text).resolve()) if text.lower().endswith(files.EXTENSIONS) else text


def _point(point: Location) -> str:
    if isinstance(point, str):
        return quoted(point)
    return f"{{ link = {quoted(point[0])}, at = {listed(point[1])} }}"


def _table(fields: Mapping[str, str]) -> str:
    return f"{{ {', '.join(f'{name} = {value}' for name, value in fields.items())} }}"


def to_toml(source: Mechanism | LoopForm) -> str:
    """Return a mechanism as TOML text, in metres and radians, numbers with 17 digits.

    Args:
        source: the mechanism, or a solver with its motion laws, forces and formula.

    Raises:
        InputError: for a motion law or load that is neither text nor constant.
    """
    mechanism = source if isinstance(source, Mechanism) else source.mechanism
    lines = [f"name = {quoted(mechanism.name)}", f"drivers = [{', '.join(map(quoted, mechanism.drivers))}]"]
    lines += _start(mechanism)
    if isinstance(source, LoopForm):
        lines += driving_lines(source)
        if source.initial:
            lines += ["", "[initial]", *_initial(source.initial)]
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


def _initial(initial: Mapping[str, float]) -> Iterator[str]:
    """Yield the coordinates and rates of the initial state."""
    for quantity, value in initial.items():
        coordinate, _, component = quantity.rpartition(".")
        names = ".".join(key(name) for name in coordinate.split("."))
        yield f"{names}.{component} = {number(value)}"


def _start(mechanism: Mechanism) -> Iterator[str]:
    """Yield the driver positions at the guess: the crank angle, or a table."""
    guess_coordinates = dict(mechanism.guess_coordinates)
    if mechanism.has_crank:
        if not guess_coordinates:
            yield f"start = {number(mechanism.start)}"
            return
        guess_coordinates = {mechanism.crank.name: mechanism.start, **guess_coordinates}
    if guess_coordinates:
        yield f"start = {{ {', '.join(_values(guess_coordinates))} }}"


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
    assert end.reference is not None
    fields = f"at = {listed(end.point)}, axis = {listed(end.axis)}, reference = {listed(end.reference)}"
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
