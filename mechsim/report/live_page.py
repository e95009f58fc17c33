"""A mechanism for an interactive page: its generated JavaScript solver, with dimensions that vary."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mechsim.codegen.assembly import SolvedAssembly, assembly
from mechsim.codegen.geometry import ParametricGeometry, parametric_geometry
from mechsim.codegen.kinematics import VaryingNumbers
from mechsim.codegen.solver_code import javascript, solver_code
from mechsim.files import read_text
from mechsim.io.file_expressions import parameter_name
from mechsim.io.toml_reader import TomlModel, parsed_source
from mechsim.io.toml_values import TomlSource, values_of
from mechsim.io.toml_writer import to_toml
from mechsim.kinematics.designs import DesignFamily, Dimension
from mechsim.kinematics.loops.start import with_closed_guess
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import Forces, Location, forces_of, located
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.load_profile import LoadProfile
from mechsim.mechanism.masses import PIN_LENGTH, RELATIVE_DIAMETER, STEEL
from mechsim.mechanism.mechanism import COINCIDENT, Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.pictures.view.pose_grid import LivePage

# range of a slider: of a length or a number relative to its value; of an angle about its value, in
# [rad]; of a zero length relative to the mechanism's size
LOW, HIGH, ANGLE, AROUND_ZERO = 0.5, 1.5, np.deg2rad(45.0), 0.25
# sizes of the rods from which masses are computed
MASSES = {"density": STEEL, "thickness": RELATIVE_DIAMETER, "pin": PIN_LENGTH, "one_place": COINCIDENT}
# a number of a TOML file, or a text
VALUE = r"""("[^"]*"|'[^']*'|[^,\]{}#\s]+)"""
# what precedes the value in a table of a parameter with its source
STATED = r"(?:\{[^}]*?\bvalue\s*=\s*)?"


def live_page(model: Any, solver: KinematicSolver, designs: DesignFamily, speed: float) -> LivePage:
    """Return the data with which a page solves a mechanism.

    Args:
        model: the opened model, from `open_model`.
        solver: its mechanism.
        designs: its dimensions.
        speed: rate of a single driven angle in [rad/s], for speeds and torque.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: where the drivers leave joints or tracked points undetermined, or are too many.
        InputError: for a mechanism without drivers.
    """
    solved = assembly(solver)
    full = solved.interval is None
    solved = replace(solved, interval=None)
    geometry = _matching(parametric_geometry(model, designs), solved, designs)
    varying, values, assignments = _numbers(geometry, solved, designs)
    code = replace(solver_code(solved, varying, values if len(values) else None), prefix="live")
    lines = [f"  {line}" for line in (*geometry.statements, *assignments)]
    head = [javascript(code), "function live_geometry(d, g) {", "  const p = {};"]
    loads = [*_loads(solver.mechanism, forces_of(solver))] if code.inertias is not None else []
    toml, kept = _toml(model, solver, geometry, loads)
    data = {
        "links": [link.name for link in solver.mechanism.links],
        "drivers": [*_drivers(solved, solver, full)],
        "dimensions": [_dimension(dimension, solver.mechanism) for dimension in geometry.dimensions],
        "joints": [_joint(joint, varying) for joint in solved.mechanism.joints],
        "points": [
            {"name": name, "link": link, "at": list(local), "index": varying.points.get(name, -1)}
            for name, (link, local) in solver.mechanism.points.items()
        ],
        "outlines": {link.name: link.outline for link in solved.mechanism.links},
        "rods": [*_rods(solved)] if code.inertias is not None else [],
        "masses": dict(MASSES),
        "transmission": [*_transmissions(solver.mechanism)],
        "loads": [load for load in loads if load["name"] in kept],
        "constant": [load for load in loads if load["name"] not in kept and load["kind"] != "mass"],
        "uncounted": _uncounted(solver),
        "speed": speed,
        "size": solver.mechanism.characteristic_length,
        "toml": toml,
    }
    return LivePage("\n".join([*head, *lines, "}"]), data, designs.describe)


def _matching(
    geometry: ParametricGeometry, solved: SolvedAssembly, designs: DesignFamily
) -> ParametricGeometry:
    """Return the geometry without formulas of frames that are not those in which the assembly is solved."""
    values = designs.values()
    wrong: set[tuple[str, str]] = set()
    for joint in solved.source.mechanism.joints:
        for side, end in (("a", joint.a), ("b", joint.b)):
            keys = [(f"{joint.name}.{side}", quantity) for quantity in ("axis", "reference")]
            if not any(key in geometry.vectors for key in keys):
                continue
            used = solved.mechanism.joint(joint.name)
            own = used.a if side == "a" else used.b
            if used.kind != joint.kind or np.abs(own.frame - end.frame).max() > 1e-9:
                wrong |= {*keys}
    affected = {
        dimension.name
        for dimension in geometry.dimensions
        for key in wrong & {*geometry.vectors}
        for formula in geometry.vectors[key]
        if formula.value({**values, dimension.name: dimension.value + 0.01}) != formula.value(values)
    }
    return replace(
        geometry,
        dimensions=tuple(own for own in geometry.dimensions if own.name not in affected),
        vectors={key: formulas for key, formulas in geometry.vectors.items() if key not in wrong},
    )


def _numbers(
    geometry: ParametricGeometry, solved: SolvedAssembly, designs: DesignFamily
) -> tuple[VaryingNumbers, Array, list[str]]:
    """Return the variable numbers, their values, and JavaScript that computes them from the dimensions."""
    sides: dict[tuple[str, str], tuple[int | None, int | None]] = {}
    values: list[float] = []
    lines: list[str] = []

    def add(own: Iterable[float], text: str) -> int:
        first = len(values)
        values.extend(own)
        lines.append(f"g.set({text}, {first});")
        return first

    def listed(key: str, quantity: str, own: tuple[float, ...] | None) -> str:
        formulas = geometry.vectors.get((key, quantity))
        if formulas is None:
            return json.dumps(own)
        return f"[{', '.join(formula.javascript for formula in formulas)}]"

    for joint in solved.source.mechanism.joints:
        for side, end in (("a", joint.a), ("b", joint.b)):
            key, first, frame = f"{joint.name}.{side}", None, None
            if (key, "at") in geometry.vectors:
                first = add(end.point, listed(key, "at", end.point))
            if any((key, quantity) in geometry.vectors for quantity in ("axis", "reference")):
                reference = listed(key, "reference", end.reference if end.has_reference else None)
                axis = listed(key, "axis", end.axis)
                frame = add(end.frame.ravel().tolist(), f"frameOf({axis}, {reference})")
            if first is not None or frame is not None:
                sides[joint.name, side] = first, frame
    points = {
        name: add(local, listed(name, "at", local))
        for name, (_, local) in solved.source.mechanism.points.items()
        if (name, "at") in geometry.vectors
    }
    return VaryingNumbers(sides, points), np.array(values), lines


def _drivers(solved: SolvedAssembly, solver: KinematicSolver, full: bool) -> Iterator[dict[str, Any]]:
    """Yield name, unit, start and range of each driver, and whether its range is a closed ring."""
    mechanism = solver.mechanism
    limits = solver.ranges
    for name, index in zip(solved.drivers, solved.driven, strict=True):
        start, angle = float(solved.start.values[index, 0]), mechanism.unit(name) == "rad"
        ring = angle and full and mechanism.has_crank and name not in limits
        reach = np.pi if angle else mechanism.characteristic_length
        low, high = (-np.pi, np.pi) if ring else (start - reach, start + reach)
        least, most = limits.get(name, (-np.inf, np.inf))
        yield {
            "name": name,
            "unit": "rad" if angle else "m",
            "start": (start + np.pi) % REVOLUTION - np.pi if ring else start,
            "nodes": [max(low, least), min(high, most)],
            "ring": ring,
        }


def _dimension(dimension: Dimension, mechanism: Mechanism) -> dict[str, Any]:
    value, length = dimension.value, mechanism.characteristic_length
    if dimension.unit == "rad":
        nodes = [value - ANGLE, value + ANGLE]
    elif abs(value) > 1e-3 * length or dimension.unit != "m":
        nodes = sorted((LOW * value, HIGH * value))
    else:
        nodes = [value - AROUND_ZERO * length, value + AROUND_ZERO * length]
    return {"name": dimension.name, "unit": dimension.unit, "value": value, "nodes": nodes}


def _joint(joint: Joint, varying: VaryingNumbers) -> dict[str, Any]:
    def end(side: str, end: End) -> dict[str, Any]:
        point, frame = varying.sides.get((joint.name, side), (None, None))
        return {
            "link": end.link,
            "point": list(end.point),
            "frame": end.frame.ravel().tolist(),
            "pointIndex": -1 if point is None else point,
            "frameIndex": -1 if frame is None else frame,
        }

    kind = KINDS[joint.kind]
    unit = kind.units[0] if kind.single else None
    return {"name": joint.name, "unit": unit, "a": end("a", joint.a), "b": end("b", joint.b)}


def _rods(solved: SolvedAssembly) -> Iterator[dict[str, Any]]:
    """Yield the links whose inertia is that of rods between their joints, as in `model.masses`."""
    for i, link in enumerate(solved.source.mechanism.links):
        if link.inertia is None:
            spin = solved.spinning.get(link.name)
            yield {"link": i, "spin": None if spin is None else spin.tolist()}


def _transmissions(mechanism: Mechanism) -> Iterator[dict[str, Any]]:
    """Yield links with two joints that push a link guided by the frame: ends of the line of force, guide.

    The transmission angle is that between the line of force and the link that it turns; of a slide, what a
    right angle lacks of the angle between the line and the slide.
    """
    guides = {
        end.link: joint
        for joint in mechanism.joints
        for end, other in ((joint.a, joint.b), (joint.b, joint.a))
        if other.link == GROUND and KINDS[joint.kind].single and joint.name not in mechanism.drivers
    }
    for link in mechanism.links:
        joints = [joint for joint in mechanism.joints if link.name in (joint.a.link, joint.b.link)]
        pins = [joint for joint in joints if not KINDS[joint.kind].slides]
        if len(joints) != 2 or len(pins) != 2 or link.name in guides:
            continue
        for pin, other in (pins, pins[::-1]):
            driven = pin.b.link if pin.a.link == link.name else pin.a.link
            if driven in guides:
                yield {"link": driven, "guide": guides[driven].name, "pin": pin.name, "other": other.name}


def _loads(mechanism: Mechanism, forces: Forces) -> Iterator[dict[str, Any]]:
    """Yield the constant forces, moments, springs and masses that load the drivers.

    Each has a name, unit, value, kind, place, and the key in a TOML file that states it, with its `entry` in
    a list; an index in the key stands for the name of a load, which a file chooses.
    """
    for i, load in enumerate(forces.loads):
        where = _position(mechanism, load.location)
        name = load.location if isinstance(load.location, str) else where["link"]
        more = {"kind": "force", "unit": "N", "key": ["forces", "loads", i, "force"], **where}
        yield from _components(load.force, f"force on {name}", more)
    for couple in forces.couples:
        key = ["forces", "couples", couple.link]
        more = {"kind": "couple", "unit": "N m", "link": couple.link, "key": key}
        yield from _components(couple.moment, f"moment on {couple.link}", more)
    if forces.crank_torque is not None and forces.crank_torque.over is None:
        value = float(forces.crank_torque.evaluate([0.0])[0])
        load = {"kind": "crank", "name": "load on the crank", "unit": "N m", "value": value}
        yield {**load, "key": ["forces", "crank_torque"]}
    for i, spring in enumerate(forces.springs):
        numbers = {"value": spring.stiffness, "rest": spring.rest, "damping": spring.damping}
        ends = {"a": _position(mechanism, spring.a), "b": _position(mechanism, spring.b)}
        yield {"kind": "spring", "name": f"spring {i + 1}", "unit": "N/m", "key": [], **numbers, **ends}
    for link in mechanism.links:
        if link.inertia is not None and link.inertia.mass:
            mass = {"kind": "mass", "name": f"mass of {link.name}", "unit": "kg", "value": link.inertia.mass}
            yield {**mass, "link": link.name, "key": ["links", link.name, "inertia", "mass"]}


def _position(mechanism: Mechanism, location: Location) -> dict[str, Any]:
    link, position = located(mechanism, location)
    return {"link": link, "at": list(position)}


def _components(load: LoadProfile, name: str, more: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the components of a constant vector that are not zero."""
    if load.over is None:
        for i, value in enumerate(load.evaluate([0.0])[0].tolist()):
            if value:
                yield {"name": f"{name} {'xyz'[i]}", "value": value, "axis": i, "entry": i, **more}


def _uncounted(solver: KinematicSolver) -> str:
    """Return what the page leaves out of its torques, in words; empty for nothing."""
    mechanism = solver.mechanism
    forces = forces_of(solver).under_drivers({*mechanism.drivers, *mechanism.locked})
    present = {
        "friction": bool(forces.friction),
        "springs in joints": bool(forces.joint_springs),
        "springs with their own law and stops": bool(forces.nonlinear_springs),
        "bushings": bool(forces.bushings),
        "motors of joints that are not driven": bool(forces.actuators),
        "loads that vary": any(load.over is not None for load in forces.load_profiles),
    }
    return ", ".join(name for name, acts in present.items() if acts)


def _toml(
    model: Any, solver: KinematicSolver, geometry: ParametricGeometry, loads: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], list[str]]:
    """Return a TOML file in pieces, fixed lines and values to insert, and which loads are among these."""
    file = isinstance(model, TomlModel) and geometry.statements
    if file and (lines := _file_pieces(model, geometry)) is not None:
        kept = _open_loads(lines, model.source, loads)
        return {"pieces": [{"parts": line} if len(line) > 1 else line[0] for line in lines]}, kept
    mechanism = with_closed_guess(solver.mechanism)
    # a formula is read from the folder of its file only
    text = to_toml(solver.with_mechanism(mechanism, formula=""))
    lines = [[line] for line in text.splitlines()]
    kept = _open_loads(lines, parsed_source(mechanism.name, text), loads)
    pieces = [*_pieces(text.splitlines())]
    pieces = [{"parts": line} if len(line) > 1 else piece for line, piece in zip(lines, pieces, strict=True)]
    # own dimensions have names; those of other mechanisms are coordinates
    if solver.dimensions and geometry.dimensions:
        pieces = [*_with_parameters(pieces, mechanism, geometry)]
    return {"pieces": pieces}, kept


def _open_loads(lines: list[list[Any]], source: TomlSource, loads: Sequence[Mapping[str, Any]]) -> list[str]:
    """Leave the values of loads open in the lines of a file; return the names of those that it states so."""
    named = [*source.document.get("forces", {}).get("loads", {})]
    kept: list[str] = []
    # the last entry of a list first, since each opening divides its line
    for load in reversed(loads):
        key = [named[name] if isinstance(name, int) else name for name in load["key"]]
        if not key:
            continue
        line = source.line(tuple(key)) - 1
        opened = _with_open_value(lines[line], key[-1], {"load": load["name"]}, load.get("entry"))
        if opened is not None:
            lines[line] = opened
            kept.append(load["name"])
    return kept


def _with_open_value(
    pieces: Sequence[Any], key: str, value: Mapping[str, Any], entry: int | None = None
) -> list[Any] | None:
    """Return a line with the value of a key, or an entry of its list, left open; None where it has none."""
    listed = STATED if entry is None else r"\[\s*" + rf"(?:[^,]*,\s*){{{entry}}}"
    for i, piece in enumerate(pieces):
        pattern = rf"""(?<![\w-])(["']?){re.escape(key)}\1\s*=\s*{listed}{VALUE}"""
        if isinstance(piece, str) and (match := re.search(pattern, piece)):
            return [*pieces[:i], piece[: match.start(2)], value, piece[match.end(2) :], *pieces[i + 1 :]]
    return None


def _file_pieces(model: TomlModel, geometry: ParametricGeometry) -> list[list[Any]] | None:
    """Return the lines of a file with parameters in parts, the values of varying ones left open.

    None where a value is not in the line of its parameter.
    """
    values = values_of(model.source)
    lines = read_text(model.path, "a TOML file").splitlines()
    pieces: list[list[Any]] = [[line] for line in lines]
    for dimension in geometry.dimensions:
        scale = values.in_si(1.0, dimension.unit) if dimension.unit in ("m", "rad") else 1.0  # type: ignore[arg-type]
        value, own = {"dimension": dimension.name, "scale": scale}, ("parameters", dimension.name)
        # the value of a table with its source may have a line of its own
        for key in (own, (*own, "value")):
            line = model.source.line(key) - 1
            if (opened := _with_open_value(pieces[line], key[-1], value)) is not None:
                pieces[line] = opened
                break
        else:
            return None
    if "formula" in model.source.document:
        # of an inline table the line of the table
        number = model.source.line(("formula", "python")) - 1
        pieces[number] = [f"# {lines[number]}  # needs its Python file in the same folder"]
    return pieces


def _with_parameters(pieces: list[Any], mechanism: Mechanism, geometry: ParametricGeometry) -> Iterator[Any]:
    """Yield the pieces of a written mechanism with its dimensions as parameters and expressions of them."""
    header = False
    for piece in pieces:
        if not header and isinstance(piece, str) and piece.startswith("["):
            header = True
            yield "[parameters]"
            for dimension in geometry.dimensions:
                value = {"dimension": dimension.name, "scale": 1.0}
                yield {"parts": [f"{parameter_name(dimension.name)} = ", value]}
            yield from (f"{name} = {value!r}" for name, value in geometry.constants.items())
            yield ""
        if isinstance(piece, dict) and "joint" in piece:
            joint = mechanism.joint(piece["joint"])
            yield _written_end(joint.a if piece["side"] == "a" else joint.b, piece, geometry)
        elif isinstance(piece, dict) and "points" in piece:
            link, local = mechanism.points[piece["points"]]
            position = _written(piece["points"], "at", local, geometry)
            yield f"{json.dumps(piece['points'])} = {{ link = {json.dumps(link)}, at = {position} }}"
        else:
            yield piece


def _written_end(end: End, piece: Mapping[str, str], geometry: ParametricGeometry) -> str:
    """Return a side of a joint in TOML; a reference that follows from a varying axis is left out."""
    key = f"{piece['joint']}.{piece['side']}"
    entries = {"at": end.point, "axis": end.axis}
    follows = not end.has_reference and (key, "axis") in geometry.vectors
    if end.reference is not None and (not follows or (key, "reference") in geometry.vectors):
        entries["reference"] = end.reference
    written = [f"{quantity} = {_written(key, quantity, own, geometry)}" for quantity, own in entries.items()]
    return f"{piece['side']} = {{ link = {json.dumps(end.link)}, {', '.join(written)} }}"


def _written(key: str, quantity: str, own: Sequence[float], geometry: ParametricGeometry) -> str:
    """Return a vector in TOML: its expressions, or its numbers."""
    formulas = geometry.vectors.get((key, quantity))
    return json.dumps([*own] if formulas is None else [formula.toml for formula in formulas])


def _pieces(lines: list[str]) -> Iterator[Any]:
    """Yield the lines of a written mechanism; of sides, points, guesses and start, what they belong to."""
    table = ""
    for line in lines:
        if line.startswith("["):
            table = line.strip("[]")
        kind, _, rest = table.partition(".")
        name = json.loads(rest) if rest.startswith('"') else rest
        key, _, _ = line.partition(" = ")
        if kind == "joints" and key in ("a", "b"):
            yield {"joint": name, "side": key}
        elif kind in ("points", "guess") and " = " in line:
            yield {kind: json.loads(key) if key.startswith('"') else key}
        elif not table and key == "start" and "{" not in line:
            yield {"start": True}
        else:
            yield line
