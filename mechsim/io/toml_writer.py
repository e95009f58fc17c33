"""Mechanisms as TOML text that reads back to the last bit."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.io.law_text import MotionLaw, WrittenLoad
from mechsim.io.toml_forces import FRICTION_NUMBERS, MOTORS
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.actuators import NO_LIMIT, Actuator, no_control
from mechsim.mechanism.clearances import Clearance
from mechsim.mechanism.coupling_functions import TabledFunction, WrittenFunction
from mechsim.mechanism.forces import Forces, Location
from mechsim.mechanism.joint_friction import BRISTLES
from mechsim.mechanism.joints import Coupling, Joint
from mechsim.mechanism.load_profile import LoadProfile
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.mechanism.motors import Geared, Motor
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, SoftStop, SpringLaw

if TYPE_CHECKING:
    from mechsim.mechanism.curves import CouplingFunction

_BARE = re.compile(r"[A-Za-z0-9_-]+")
# limit in place of an infinite one on one side
UNLIMITED = 1e30


def _value(value: Any) -> str:
    """Return text, a truth value, a number to the last bit, a list or an inline table in TOML."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_lines(value))} }}"
    if not isinstance(value, int | float):
        return f"[{', '.join(map(_value, value))}]"
    text = f"{float(value):.17g}"
    return text if any(character in text for character in ".e") else f"{text}.0"


def _key(*names: str) -> str:
    """Return names as a dotted key."""
    return ".".join(name if _BARE.fullmatch(name) else _value(name) for name in names)


def _lines(entries: Mapping[Any, Any]) -> Iterator[str]:
    """Yield the entries of a table; a key is a name, or the names of a dotted key."""
    for name, value in entries.items():
        yield f"{_key(name) if isinstance(name, str) else _key(*name)} = {_value(value)}"


def _table(entries: Mapping[Any, Any], *names: str) -> Iterator[str]:
    """Yield a table with its header."""
    yield from ("", f"[{_key(*names)}]", *_lines(entries))


def _tables(tables: Mapping[str, Mapping[Any, Any]]) -> Iterator[str]:
    """Yield the tables that have entries."""
    for name, entries in tables.items():
        yield from _table(entries, name) if entries else ()


def to_toml(source: Mechanism | KinematicSolver) -> str:
    """Return a mechanism as TOML text, in metres and radians, numbers with 17 digits.

    Args:
        source: the mechanism, or a solver with its motion laws, forces and formula.

    Raises:
        InputError: for a motion law or load that is neither text nor constant.
    """
    solver = KinematicSolver(source) if isinstance(source, Mechanism) else source
    mechanism, laws, forces = solver.mechanism, solver.motion_laws, solver.forces or Forces()
    head = {"name": mechanism.name, "drivers": mechanism.drivers} | _start(mechanism)
    lines = [*_lines(head if laws.crank else head | {"duration": laws.duration})]
    lines += _tables(
        {
            "motion_laws": {} if laws.crank else _motion_laws(laws),
            "formula": {"python": solver.formula} if solver.formula else {},
            "forces": {} if solver.forces is None else _forces(forces),
            "initial": {tuple(name.split(".")): value for name, value in solver.initial.items()},
            "display": {} if mechanism.up is None else {"up": mechanism.up},
        }
    )
    for link in mechanism.links:
        inertia = link.inertia and files.attributes(link.inertia, "mass", "centre", "moments")
        table = files.attributes(link, "outline", "polygon") | {"inertia": inertia}
        lines += _table(_stated(table, outline=(), polygon=False, inertia=None), "links", link.name)
    clearances = {clearance.joint: _clearance(clearance) for clearance in forces.clearances}
    for joint in mechanism.joints:
        table = _joint(joint) | _limits(joint, solver) | clearances.get(joint.name, {})
        lines += _table(table, "joints", joint.name)
    lossy = {mechanism.named_laws[each.coupling]: each for each in forces.friction if each.coupling}
    losses = {
        (str(law.left), str(law.right)): {"efficiency": 1.0 / (1.0 + friction.coefficient / abs(law.ratio))}
        for law, friction in lossy.items()
    }
    names = [coupling.name for coupling in mechanism.couplings]
    for i, gear in enumerate(mechanism.gears):
        name = "gear" if len(mechanism.gears) == 1 else f"gear{i + 1}"
        while name in names:
            name += "_"
        table = files.attributes(gear, "driver", "driven", "ratio", "phase", "pressure_angle")
        table |= losses.get((gear.driven, gear.driver), {})
        lines += _table(_stated(table, pressure_angle=0.0), "couplings", name)
    for coupling in mechanism.couplings:
        table, gap = _coupling(coupling), f"{coupling.name}.gap"
        table |= {"restitution": solver.restitution[gap]} if gap in solver.restitution else {}
        table |= losses.get((str(coupling.left), str(coupling.right)), {})
        lines += _table(table, "couplings", coupling.name)
    points = {name: {"link": link, "at": position} for name, (link, position) in mechanism.points.items()}
    guess = {
        link: {"at": np.asarray(pose.position).tolist(), "rotation": np.asarray(pose.rotation).tolist()}
        for link, pose in mechanism.guess.items()
    }
    lines += _tables({"locked": mechanism.locked, "points": points, "guess": guess})
    return "\n".join(lines) + "\n"


def _motion_laws(laws: MotionLaws) -> dict[str, str]:
    texts: dict[str, str] = {}
    for name, state in laws.by_name.items():
        if not isinstance(state, MotionLaw):
            raise InputError(f"the motion law of {name} is a function without text; give it as text")
        texts[name] = _absolute(state.text)
    return texts


def _forces(forces: Forces) -> dict[Any, Any]:
    """Return the table of forces; keys of inner tables are dotted."""
    table: dict[Any, Any] = {"gravity": forces.gravity}
    if forces.crank_torque is not None:
        table["crank_torque"] = _components(forces.crank_torque, "the load on the crank")[0]
    if forces.flywheel:
        table["flywheel"] = forces.flywheel
    table |= {("controllers", *item.coordinate.split(".")): item.text for item in forces.controllers}
    if forces.motor is not None:
        table["motor"] = _motor(forces.motor)
    table |= {("armature", *name.split(".")): inertia for name, inertia in forces.armature.items()}
    table |= {("motors", actuator.name): _actuator(actuator) for actuator in forces.actuators}
    for friction in (friction for friction in forces.friction if not friction.coupling):
        values = files.attributes(
            friction, "viscous", "coulomb", "static", "stribeck", *BRISTLES, *FRICTION_NUMBERS
        )
        table["friction", friction.joint] = {name: value for name, value in values.items() if value}
    named = {spring.name for spring in forces.nonlinear_springs}
    numbers = (i for i in count(1) if f"spring{i}" not in named)
    for i, spring in zip(numbers, forces.springs, strict=False):
        constants = files.attributes(spring, "stiffness", "rest", "damping")
        table["springs", f"spring{i}"] = _ends((spring.a, spring.b)) | constants
    for spring in forces.nonlinear_springs:
        if isinstance(spring.law, SpringLaw):
            table["springs", spring.name] = _nonlinear_spring(spring, spring.law)
    matrices = {item.name: files.attributes(item, "stiffness", "damping") for item in forces.bushings}
    table |= {("bushings", item.name): _sides(item) | matrices[item.name] for item in forces.bushings}
    springs = {("joint_springs", item.joint): item for item in forces.joint_springs}
    table |= {key: files.attributes(spring, "stiffness", "rest") for key, spring in springs.items()}
    for i, load in enumerate(forces.loads, 1):
        force = _components(load.force, f"the load on {load.location}")
        table["loads", f"load{i}"] = {"at": _point(load.location), "force": force}
    for couple in forces.couples:
        table["couples", couple.link] = _components(couple.moment, f"the couple on {couple.link}")
    return table


def _nonlinear_spring(spring: NonlinearSpring, law: SpringLaw) -> dict[str, Any]:
    ends = {"joint": spring.ends} if isinstance(spring.ends, str) else _ends(spring.ends)
    force = _without_names(law) if law.table is None else _absolute(law.table.text)
    table = ends | files.attributes(law, "stiffness", "rest", "damping", "preload") | {"force": force}
    return _stated(table, stiffness=0.0, rest=0.0, damping=0.0, preload=0.0, force="")


def _actuator(actuator: Actuator) -> dict[str, Any]:
    """Return a motor of kind "general"; infinite limits are left out."""
    if isinstance(actuator.control, MotionLaw):
        text = _absolute(actuator.control.text)
    elif actuator.control is no_control:
        text = "0"
    else:
        raise InputError(f"the control of {actuator.name} is a function without text; give it as text")
    table: dict[str, Any] = {"kind": "general", "control": text}
    if actuator.ends is None:
        table |= {"gear": dict(actuator.gear), "rotor": actuator.inertia}
    else:
        table |= _ends(actuator.ends) | {"gear": actuator.pull}
    table |= files.attributes(actuator, "gain", "bias", "direct", "start")
    if actuator.inflow is not None:
        table["inflow"] = actuator.inflow
    for name in ("control_range", "state_range", "force_range"):
        low, high = getattr(actuator, name)
        if (low, high) != NO_LIMIT:
            table[name] = [max(low, -UNLIMITED), min(high, UNLIMITED)]
    return table


def _motor(motor: Motor) -> dict[str, Any]:
    if isinstance(motor, Geared):
        return _motor(motor.motor) | {"gear": motor.ratio}
    kind, keys = next((kind, keys) for kind, (make, keys) in MOTORS.items() if type(motor) is make)
    return {"kind": kind, **dict(zip(keys, astuple(motor), strict=True))}


def _components(profile: LoadProfile, what: str) -> Sequence[float | str]:
    """Return a load along each axis, as a number or as text."""
    if isinstance(profile.value, WrittenLoad):
        texts = [component.text for component in profile.value.components]
        return [_absolute(text) if isinstance(text, str) else text for text in texts]
    if profile.over is not None:
        raise InputError(f"{what} is a function of {profile.over} without text; give it as text")
    return profile.evaluate(np.zeros(1)).ravel().tolist()


def _absolute(text: str) -> str:
    """Return the text of a motion law or a load with an absolute path if it is a file."""
    return str(Path(text).resolve()) if text.lower().endswith(files.EXTENSIONS) else text


def _point(point: Location) -> str | dict[str, Any]:
    return point if isinstance(point, str) else {"link": point[0], "at": point[1]}


def _ends(ends: tuple[Location, Location]) -> dict[str, Any]:
    """Return the points of a force between two."""
    return {side: _point(end) for side, end in zip("ab", ends, strict=True)}


def _start(mechanism: Mechanism) -> dict[str, Any]:
    """Return the driver positions at the guess: the crank angle, or a table."""
    positions = dict(mechanism.guess_coordinates)
    if mechanism.has_crank:
        if not positions:
            return {"start": mechanism.start}
        positions = {mechanism.crank.name: mechanism.start, **positions}
    return {"start": positions} if positions else {}


def _stated(entries: dict[str, Any], **defaults: Any) -> dict[str, Any]:
    """Return entries without those that have the value which a reader assumes."""
    return {name: value for name, value in entries.items() if name not in defaults or value != defaults[name]}


def _joint(joint: Joint) -> dict[str, Any]:
    table = {"kind": joint.kind, **_sides(joint), **files.attributes(joint, "cross_angle", "lead", "length")}
    return _stated(table, cross_angle=np.pi / 2, lead=0.0, length=0.0)


def _limits(joint: Joint, solver: KinematicSolver) -> dict[str, Any]:
    """Return the limits of a joint's coordinates: ranges with their restitution, and soft stops."""
    limits: dict[str, Any] = {}
    for name in joint.coordinates:
        pairs = zip(("lower", "upper"), solver.ranges.get(name, NO_LIMIT), strict=True)
        entry = {side: value for side, value in pairs if abs(value) < np.inf}
        if name in solver.restitution:
            entry["restitution"] = solver.restitution[name]
        for spring in () if solver.forces is None else solver.forces.nonlinear_springs:
            if spring.ends == name and isinstance(spring.law, SoftStop):
                entry["upper" if spring.law.side > 0.0 else "lower"] = spring.law.limit
                entry |= files.attributes(spring.law, "stiffness", "damping")
        if entry:
            limits |= entry if name == joint.name else {name.removeprefix(f"{joint.name}."): entry}
    return {"limits": limits} if limits else {}


def _clearance(clearance: Clearance) -> dict[str, Any]:
    table = files.attributes(clearance, "radius", "restitution", "stiffness", "exponent", "law")
    defaults = {"restitution": None, "stiffness": 0.0, "exponent": 1.5, "law": "lankarani-nikravesh"}
    return {"clearance": _stated(table, **defaults)}


def _sides(item: Joint | Bushing) -> dict[str, Any]:
    """Return both sides of a joint or a bushing."""
    return {
        side: {"link": end.link, "at": end.point, "axis": end.axis, "reference": end.reference}
        for side, end in (("a", item.a), ("b", item.b))
    }


def _coupling(coupling: Coupling) -> dict[str, Any]:
    if coupling.rope:
        return {"rope": coupling.left_terms, "length": coupling.coefficients[0]}
    sides = {"driven": coupling.left, "driver": coupling.right}
    if (belt := coupling.belt) is not None:
        pulley = {} if belt.tensioner is None else {"at": belt.tensioner, "radius": belt.tensioner_radius}
        table = {"radii": belt.radii, "crossed": coupling.ratio < 0.0, "phase": coupling.coefficients[0]}
        table |= {"length": belt.length, "tensioner": pulley, "backlash": coupling.backlash}
        return _stated(sides | table, crossed=False, phase=0.0, length=0.0, backlash=0.0, tensioner={})
    table = sides | files.attributes(coupling, "coefficients", "zeros", "turns", "pressure_angle", "backlash")
    table |= _function(coupling.function)
    defaults = {"driver": {}, "zeros": (0.0, 0.0), "turns": False, "pressure_angle": None, "backlash": 0.0}
    return _stated(table, coefficients=(), periodic=False, **defaults)


def _function(function: "CouplingFunction | None") -> dict[str, Any]:
    """Return the keys of a function, its parameters as numbers."""
    if isinstance(function, TabledFunction):
        return {"function": _absolute(function.text), "periodic": function.periodic}
    if function is None:
        return {}
    if not isinstance(function, WrittenFunction):
        raise InputError(
            f"{function.text} cannot be written as TOML, only the function of a coupling; copy the file"
        )
    return {"function": re.sub(rf"\b{function.variable}\b", "q", _without_names(function))}


def _without_names(function: WrittenFunction | SpringLaw) -> str:
    """Return an expression with its parameters as numbers."""
    text = function.text
    for name, value in zip(function.names, function.values, strict=True):
        text = re.sub(rf"\b{re.escape(name)}\b", f"({value!r})", text)
    return text
