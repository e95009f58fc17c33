"""Mechanisms as TOML text that reads back to the last bit."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.io.law_text import MotionLaw, WrittenLoad
from mechsim.io.toml_forces import FRICTION_NUMBERS
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.actuators import NO_LIMIT, Actuator, no_control
from mechsim.mechanism.coupling_functions import TabledFunction, WrittenFunction
from mechsim.mechanism.forces import Forces, Location
from mechsim.mechanism.joint_friction import BRISTLES
from mechsim.mechanism.joints import Coupling, End, Gear, Joint
from mechsim.mechanism.links import Link
from mechsim.mechanism.load_profile import LoadProfile
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.mechanism.motors import ConstantTorque, Geared, Motor, TorqueSpeedLine
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


def to_toml(source: Mechanism | KinematicSolver) -> str:
    """Return a mechanism as TOML text, in metres and radians, numbers with 17 digits.

    Args:
        source: the mechanism, or a solver with its motion laws, forces and formula.

    Raises:
        InputError: for a motion law or load that is neither text nor constant.
    """
    mechanism = source if isinstance(source, Mechanism) else source.mechanism
    lines = [*_lines({"name": mechanism.name, "drivers": mechanism.drivers}), *_lines(_start(mechanism))]
    if not isinstance(source, Mechanism):
        lines += _solver_lines(source)
    if mechanism.up is not None:
        lines += _table({"up": mechanism.up}, "display")
    for link in mechanism.links:
        lines += _table(_link(link), "links", link.name)
    solver = None if isinstance(source, Mechanism) else source
    for joint in mechanism.joints:
        table = _joint(joint) | _limits(joint, solver) | _clearance(joint, solver)
        lines += _table(table, "joints", joint.name)
    names = [coupling.name for coupling in mechanism.couplings]
    losses = _efficiencies(mechanism, solver)
    for i, gear in enumerate(mechanism.gears):
        table = _gear(gear) | losses.get((gear.driven, gear.driver), {})
        lines += _table(table, "couplings", _gear_name(mechanism, i, names))
    bouncing = {} if solver is None else solver.restitution
    for coupling in mechanism.couplings:
        restitution = bouncing.get(f"{coupling.name}.gap")
        table = _coupling(coupling) | ({} if restitution is None else {"restitution": restitution})
        table |= losses.get((str(coupling.left), str(coupling.right)), {})
        lines += _table(table, "couplings", coupling.name)
    points = {name: {"link": link, "at": position} for name, (link, position) in mechanism.points.items()}
    guess = {
        link: {"at": np.asarray(pose.position).tolist(), "rotation": np.asarray(pose.rotation).tolist()}
        for link, pose in mechanism.guess.items()
    }
    for name, entries in (("locked", mechanism.locked), ("points", points), ("guess", guess)):
        lines += _table(entries, name) if entries else ()
    return "\n".join(lines) + "\n"


def _solver_lines(solver: KinematicSolver) -> Iterator[str]:
    """Yield the lines of motion laws, formula, forces and initial state."""
    if not solver.motion_laws.crank:
        yield from _lines({"duration": solver.motion_laws.duration})
        yield from _table(_motion_laws(solver.motion_laws), "motion_laws")
    if solver.formula:
        yield from _table({"python": solver.formula}, "formula")
    if solver.forces is not None:
        yield from _table(_forces(solver.forces), "forces")
    if solver.initial:
        yield from _table({tuple(name.split(".")): x for name, x in solver.initial.items()}, "initial")


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
        ends = {"a": _point(spring.a), "b": _point(spring.b)}
        table["springs", f"spring{i}"] = ends | files.attributes(spring, "stiffness", "rest", "damping")
    for spring in forces.nonlinear_springs:
        if isinstance(spring.law, SpringLaw):
            table["springs", spring.name] = _nonlinear_spring(spring, spring.law)
    table |= {("bushings", bushing.name): _bushing(bushing) for bushing in forces.bushings}
    springs = {("joint_springs", item.joint): item for item in forces.joint_springs}
    table |= {key: files.attributes(spring, "stiffness", "rest") for key, spring in springs.items()}
    for i, load in enumerate(forces.loads, 1):
        force = _components(load.force, f"the load on {load.location}")
        table["loads", f"load{i}"] = {"at": _point(load.location), "force": force}
    for couple in forces.couples:
        table["couples", couple.link] = _components(couple.moment, f"the couple on {couple.link}")
    return table


def _nonlinear_spring(spring: NonlinearSpring, law: SpringLaw) -> dict[str, Any]:
    ends = {"joint": spring.ends}
    if not isinstance(spring.ends, str):
        ends = {side: _point(end) for side, end in zip("ab", spring.ends, strict=True)}
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
    table: dict[str, Any] = {
        "kind": "general",
        "control": text,
    }
    if actuator.ends is None:
        table |= {"gear": dict(actuator.gear), "rotor": actuator.inertia}
    else:
        table |= {side: _point(end) for side, end in zip("ab", actuator.ends, strict=True)}
        table["gear"] = actuator.pull
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
    if isinstance(motor, ConstantTorque):
        return {"kind": "constant", "torque": motor.value}
    if isinstance(motor, TorqueSpeedLine):
        return {"kind": "line", **files.attributes(motor, "stall", "no_load")}
    return {"kind": "dc", **files.attributes(motor, "voltage", "resistance", "constant")}


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


def _link(link: Link) -> dict[str, Any]:
    inertia = None if link.inertia is None else files.attributes(link.inertia, "mass", "centre", "moments")
    table = files.attributes(link, "outline", "polygon") | {"inertia": inertia}
    return _stated(table, outline=(), polygon=False, inertia=None)


def _joint(joint: Joint) -> dict[str, Any]:
    ends = {"a": _end(joint.a), "b": _end(joint.b)}
    table = {"kind": joint.kind, **ends, **files.attributes(joint, "cross_angle", "lead", "length")}
    return _stated(table, cross_angle=np.pi / 2, lead=0.0, length=0.0)


def _limits(joint: Joint, solver: KinematicSolver | None) -> dict[str, Any]:
    """Return the limits of a joint's coordinates: ranges with their restitution, and soft stops."""
    limits: dict[str, Any] = {}
    if solver is None:
        return limits
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


def _clearance(joint: Joint, solver: KinematicSolver | None) -> dict[str, Any]:
    clearances = () if solver is None or solver.forces is None else solver.forces.clearances
    fields = "radius", "restitution", "stiffness", "exponent", "law"
    defaults = {"restitution": None, "stiffness": 0.0, "exponent": 1.5, "law": "lankarani-nikravesh"}
    tables = {item.joint: _stated(files.attributes(item, *fields), **defaults) for item in clearances}
    return {"clearance": tables[joint.name]} if joint.name in tables else {}


def _bushing(bushing: Bushing) -> dict[str, Any]:
    matrices = {name: [list(row) for row in getattr(bushing, name)] for name in ("stiffness", "damping")}
    return {"a": _end(bushing.a), "b": _end(bushing.b)} | matrices


def _end(end: End) -> dict[str, Any]:
    return {"link": end.link, "at": end.point, "axis": end.axis, "reference": end.reference}


def _gear(gear: Gear) -> dict[str, Any]:
    table = files.attributes(gear, "driver", "driven", "ratio", "phase", "pressure_angle")
    return _stated(table, pressure_angle=0.0)


def _efficiencies(
    mechanism: Mechanism, solver: KinematicSolver | None
) -> dict[tuple[str, str], dict[str, float]]:
    """Return the efficiency of couplings by driven and driving coordinate."""
    if solver is None or solver.forces is None:
        return {}
    laws = {
        friction: mechanism.named_laws[friction.coupling]
        for friction in solver.forces.friction
        if friction.coupling
    }
    return {
        (str(law.left), str(law.right)): {"efficiency": 1.0 / (1.0 + friction.coefficient / abs(law.ratio))}
        for friction, law in laws.items()
    }


def _gear_name(mechanism: Mechanism, index: int, names: list[str]) -> str:
    name = "gear" if len(mechanism.gears) == 1 else f"gear{index + 1}"
    while name in names:
        name += "_"
    return name


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
