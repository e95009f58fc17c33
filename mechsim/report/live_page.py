"""A mechanism for an interactive page: its generated JavaScript solver, with dimensions that vary."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mechsim.analytic.designs import DesignFamily, Dimension
from mechsim.analytic.loops.start import with_closed_guess
from mechsim.analytic.solvers import KinematicSolver
from mechsim.codegen.assembly import SolvedAssembly, assembly
from mechsim.codegen.geometry import ParametricGeometry, parameter_name, parametric_geometry
from mechsim.codegen.kinematics import VaryingNumbers
from mechsim.codegen.printing import javascript
from mechsim.codegen.solver_code import solver_code
from mechsim.files import read_text
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND
from mechsim.model.masses import PIN_LENGTH, RELATIVE_DIAMETER, STEEL
from mechsim.model.mechanism import COINCIDENT, Mechanism
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.pictures.view.pose_grid import LivePage
from mechsim.subjects.toml_reader import TomlModel
from mechsim.subjects.toml_values import values_of
from mechsim.subjects.toml_writer import to_toml

# range of a slider: of a length or a number relative to its value; of an angle about its value, in
# [rad]; of a zero length relative to the mechanism's size
LOW, HIGH, ANGLE, AROUND_ZERO = 0.5, 1.5, np.deg2rad(45.0), 0.25


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
    code = solver_code(solved, varying, values if len(values) else None)
    code = replace(code, prefix="live")
    text = "\n".join(
        [
            javascript(code),
            "function live_geometry(d, g) {",
            "  const p = {};",
            *(f"  {line}" for line in (*geometry.statements, *assignments)),
            "}",
        ]
    )
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
        "masses": {
            "density": STEEL,
            "thickness": RELATIVE_DIAMETER,
            "pin": PIN_LENGTH,
            "one_place": COINCIDENT,
        },
        "transmission": [*_transmissions(solver.mechanism)],
        "speed": speed,
        "size": solver.mechanism.characteristic_length,
        "toml": _toml(model, solver, geometry),
    }
    return LivePage(text, data)


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
    if not wrong:
        return geometry
    affected = {
        dimension.name
        for dimension in geometry.dimensions
        for key in wrong & {*geometry.vectors}
        for formula in geometry.vectors[key]
        if formula.value({**values, dimension.name: dimension.value + 0.01}) != formula.value(values)
    }
    kept = tuple(dimension for dimension in geometry.dimensions if dimension.name not in affected)
    return replace(
        geometry,
        dimensions=kept,
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

    def point(key: str, own: tuple[float, ...]) -> int | None:
        return add(own, listed(key, "at", own)) if (key, "at") in geometry.vectors else None

    for joint in solved.source.mechanism.joints:
        for side, end in (("a", joint.a), ("b", joint.b)):
            key = f"{joint.name}.{side}"
            first, frame = point(key, end.point), None
            if any((key, quantity) in geometry.vectors for quantity in ("axis", "reference")):
                reference = listed(key, "reference", end.reference if end.has_reference else None)
                axis = listed(key, "axis", end.axis)
                frame = add(end.frame.ravel().tolist(), f"frameOf({axis}, {reference})")
            if first is not None or frame is not None:
                sides[joint.name, side] = first, frame
    points = {
        name: first
        for name, (_, local) in solved.source.mechanism.points.items()
        if (first := point(name, local)) is not None
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
    value = dimension.value
    if dimension.unit == "rad":
        low, high = value - ANGLE, value + ANGLE
    elif abs(value) > 1e-3 * mechanism.characteristic_length or dimension.unit != "m":
        low, high = sorted((LOW * value, HIGH * value))
    else:
        reach = AROUND_ZERO * mechanism.characteristic_length
        low, high = value - reach, value + reach
    return {"name": dimension.name, "unit": dimension.unit, "value": value, "nodes": [low, high]}


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
    links = [link.name for link in solved.source.mechanism.links]
    for link in solved.source.mechanism.links:
        if link.inertia is None:
            spin = solved.spinning.get(link.name)
            yield {"link": links.index(link.name), "spin": None if spin is None else spin.tolist()}


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


def _toml(model: Any, solver: KinematicSolver, geometry: ParametricGeometry) -> dict[str, Any]:
    """Return a TOML file in pieces: fixed lines, and values that the page inserts."""
    if isinstance(model, TomlModel) and geometry.statements:
        return {"pieces": _file_pieces(model, geometry)}
    mechanism = with_closed_guess(solver.mechanism)
    # a formula is read from the folder of its file only
    pieces = [*_pieces(to_toml(solver.with_mechanism(mechanism, formula="")).splitlines())]
    # own dimensions have names; those of other mechanisms are coordinates
    if solver.dimensions and geometry.dimensions:
        pieces = [*_with_parameters(pieces, mechanism, geometry)]
    return {"pieces": pieces}


def _file_pieces(model: TomlModel, geometry: ParametricGeometry) -> list[Any]:
    """Return the lines of a file with parameters; of a varying one the line with its value left open."""
    values = values_of(model.source)
    lines = read_text(model.path, "a TOML file").splitlines()
    pieces: list[list[Any]] = [[line] for line in lines]
    for dimension in geometry.dimensions:
        line = model.source.line(("parameters", dimension.name)) - 1
        scale = values.in_si(1.0, dimension.unit) if dimension.unit in ("m", "rad") else 1.0  # type: ignore[arg-type]
        *before, last = pieces[line]
        key = rf"""(?<![\w-])(["']?){re.escape(dimension.name)}\1\s*=\s*"""
        match = re.search(rf"""{key}("[^"]*"|'[^']*'|[^,}}#\s]+)""", last)
        if match:
            open_value = {"dimension": dimension.name, "scale": scale}
            pieces[line] = [*before, last[: match.start(2)], open_value, last[match.end(2) :]]
    if "formula" in model.source.document:
        # of an inline table the line of the table
        number = model.source.line(("formula", "python")) - 1
        pieces[number] = [f"# {lines[number]}  # needs its Python file in the same folder"]
    return [{"parts": line} if len(line) > 1 else line[0] for line in pieces]


def _with_parameters(pieces: list[Any], mechanism: Mechanism, geometry: ParametricGeometry) -> Iterator[Any]:
    """Yield the pieces of a written mechanism with its dimensions as parameters and expressions of them."""
    header = False
    for piece in pieces:
        if not header and isinstance(piece, str) and piece.startswith("["):
            header = True
            yield "[parameters]"
            for dimension in geometry.dimensions:
                yield {
                    "parts": [
                        f"{parameter_name(dimension.name)} = ",
                        {"dimension": dimension.name, "scale": 1.0},
                    ]
                }
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
