"""A dynamic model as data of the C code in `c/`, which evaluates and integrates its equations of motion.

The C code states the equations of `EquationsOfMotion` for one state; tests compare both for every element.
A model with an element that is not listed here has no such data.
"""

import ctypes
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.kinematics.loops.constraints import Cut
from mechsim.kinetics.equations_of_motion import EquationsOfMotion
from mechsim.kinetics.model import REPEATED
from mechsim.mechanism.forces import Friction, Location, located
from mechsim.mechanism.instructions import (
    CONTROLLER,
    EXPRESSION,
    INSTRUCTION,
    TIME,
    Instructions,
    NotCompiledError,
    Variable,
    c_source,
)
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Vector
from mechsim.mechanism.nonlinear_springs import Bushing, SoftStop
from mechsim.numerics.arrays import Array
from mechsim.numerics.c_library import loaded_library

# attributes of the forces that the C code contains; another one must be empty
FORCES = {
    *("gravity", "friction", "springs", "joint_springs", "nonlinear_springs", "bushings", "loads", "couples"),
    *("crank_torque", "flywheel", "motor", "controllers", "actuators", "armature", "clearances"),
}

# `motion` of a resistance
SLIDE, ROTATION, BALL, FIRST_AXIS = range(4)
# a number other than zero in a text, outside of names
_NUMBER = re.compile(r"(?<![\w.])(?=[\d.]*[1-9])[\d.]+(?:e[-+]?\d+)?")
# types of numbers in C -> those of numpy and ctypes
_NUMBERS: dict[str, tuple[str, Any]] = {"int": ("i4", ctypes.c_int), "double": ("f8", ctypes.c_double)}


@cache
def c_sources() -> str:
    """Return the C code that evaluates and integrates equations of motion."""
    folder = Path(__file__).parent / "c"
    names = "equations.c", "integration.c"
    return c_source() + "".join((folder / name).read_text(encoding="utf-8") for name in names)


@cache
def structures() -> dict[str, str]:
    """Return the members of each structure in the C code, as text."""
    return {name: text for text, name in re.findall(r"typedef struct \{([^}]*)\} (\w+);", c_sources())}


@cache
def members_of(structure: str) -> tuple[tuple[str, str, tuple[int, ...]], ...]:
    """Return name, type and shape of each member of a structure in the C code; names of pointers have a *."""
    text = re.sub(r"/\*.*?\*/|\bconst\b", "", structures()[structure], flags=re.DOTALL)
    result: list[tuple[str, str, tuple[int, ...]]] = []
    for kind, names in (declaration.split(maxsplit=1) for declaration in text.split(";")[:-1]):
        for name, sizes in re.findall(r"(\*?\w+)((?:\[\d+\])*)", names):
            result.append((name, kind, tuple(map(int, re.findall(r"\d+", sizes)))))
    return tuple(result)


@cache
def record(structure: str) -> np.dtype[Any]:
    """Return a structure of the C code, without pointers, as a type of numpy."""
    return np.dtype(
        [
            (name, _NUMBERS[kind][0] if kind in _NUMBERS else record(kind), shape)
            for name, kind, shape in members_of(structure)
        ],
        align=True,
    )


def c_fields(structure: str) -> list[tuple[str, Any]]:
    """Return the members of a structure of numbers, vectors and pointers for ctypes."""
    fields = list[tuple[str, Any]]()
    for name, kind, shape in members_of(structure):
        number = ctypes.c_void_p if name[0] == "*" else _NUMBERS[kind][1]
        fields.append((name.strip("*"), number * shape[0] if shape else number))
    return fields


class ModelData(ctypes.Structure):
    """`Model` of `c/equations.c`."""

    _fields_ = c_fields("Model")


@dataclass(frozen=True, slots=True)
class CompiledModel:
    """A dynamic model for the C code.

    Attributes:
        data: the structure that the C code reads.
        tables: arrays to which it points.
        library: the compiled code.
        structure: its elements without their numbers.
    """

    data: ModelData
    tables: dict[str, np.ndarray[Any, Any]]
    library: ctypes.CDLL
    structure: str


def library() -> ctypes.CDLL:
    """Return the compiled C code.

    Raises:
        MissingToolError: if there is no C compiler.
        OutputError: if the cache is not writable.
    """
    # a sixth faster than by -O2, with the same results (validation/peers/released.py)
    return loaded_library("forward_dynamics", c_sources(), None, "-O3")


@lru_cache(maxsize=REPEATED)
def compiled_model(equations: EquationsOfMotion) -> CompiledModel:
    """Return the equations of motion of a model for the C code.

    Raises:
        NotCompiledError: if the C code does not contain an element of the model.
        MissingToolError: if there is no C compiler.
        OutputError: if the cache is not writable.
    """
    _require_supported(equations)
    forces, loops, free = equations.model.forces, equations.loops, equations.free
    torque, derivative = _crank_torque(equations)
    moved, added = [_moved(cut) for cut in loops.cuts], Instructions()
    resistances = _resistances(equations)
    tables = {
        "branches": _branches(equations),
        "coordinates": _coordinates(equations),
        "cut": _cuts(loops.cuts),
        "moved": np.concatenate([np.empty(0, record("Moved")), *moved]),
        "coupling": _couplings(equations, added),
        "weights": np.array([[row.left_weights, row.right_weights] for row in loops.couplings], dtype=float),
        "inertias": _inertias(equations),
        "spring": spring_table(equations),
        "resistance": resistances,
        "load": _loads(equations, added),
        "controller": _controllers(equations, added),
        "prescribed": _prescribed(equations, added),
        "nonlinear_spring": _nonlinear_springs(equations, added),
        "bushing": _bushings(equations),
        "actuator": added.add_actuators(forces.actuators),
        "gear": _gears(equations),
        "pull": _pulls(equations),
        "instruction": np.array(added.rows, INSTRUCTION),
        "tables": np.array(added.numbers),
        "rotors": np.ascontiguousarray(equations.rotors),
    }
    data = ModelData(
        links=len(tables["branches"]),
        count=loops.tree.count,
        free=len(free),
        balls=len(loops.tree.balls),
        cuts=len(loops.cuts),
        couplings=len(loops.couplings),
        rows=loops.rows + len(equations.prescribed),
        springs=len(tables["spring"]),
        resistances=len(resistances),
        loads=len(tables["load"]),
        crank=-1 if equations.crank is None else equations.crank,
        controllers=len(tables["controller"]),
        actuators=len(tables["actuator"]),
        states=sum(actuator.inflow is not None for actuator in forces.actuators),
        rotating=int(tables["rotors"].any()),
        nonlinear_springs=len(tables["nonlinear_spring"]),
        loaded=int(resistances["loaded"].sum()),
        tabled=int(bool(added.numbers)),
        driven=len(equations.prescribed),
        bushings=len(tables["bushing"]),
        **{name: table.ctypes.data for name, table in tables.items()},
        gravity=(ctypes.c_double * 3)(*forces.gravity),
        torque=torque,
        torque_slope=derivative,
    )
    return CompiledModel(data, tables, library(), _structure(equations, tables))


def _structure(equations: EquationsOfMotion, tables: dict[str, np.ndarray[Any, Any]]) -> str:
    """Return the elements of a model, and which tables have rows; all numbers but zero are the same sign."""
    model, rows = equations.model, [len(table) for table in tables.values()]
    joints = [(joint.kind, joint.links) for joint in model.mechanism.joints], rows
    return _NUMBER.sub("#", repr((joints, model.mechanism.couplings, model.forces, equations.prescribed)))


def _require_supported(equations: EquationsOfMotion) -> None:
    """Raise NotCompiledError if the C code does not contain an element of the model."""
    forces, loops = equations.model.forces, equations.loops
    for field in fields(forces):
        if field.name not in FORCES and getattr(forces, field.name):
            raise NotCompiledError(field.name.replace("_", " "))
    rows = sum(cut.rows for cut in loops.cuts) + len(loops.couplings)
    if rows != loops.rows or any(type(cut) is not Cut for cut in loops.cuts):
        raise NotCompiledError("its loop equations")
    for friction in forces.friction:
        if friction.coupling:
            raise NotCompiledError(f"the efficiency of coupling {friction.coupling}")
    if equations.prescribed and any(friction.loads for friction in equations.frictions):
        raise NotCompiledError("friction by the load under prescribed motion")


def _crank_torque(equations: EquationsOfMotion) -> tuple[float, float]:
    """Return load and motor torque on the crank at rest in [N m], and its derivative by the speed."""
    forces = equations.model.forces
    if equations.crank is None:
        return 0.0, 0.0
    constant = forces.crank_torque is not None and forces.crank_torque.over is None
    load = float(forces.crank_torque.evaluate(np.zeros(1))[0]) if constant and forces.crank_torque else 0.0
    torques = forces.motor_torque(np.zeros(1))
    return load + float(torques[0]), 0.0 if forces.motor is None else float(forces.motor.derivative)


def _filled(structure: str, rows: Sequence[dict[str, Any]]) -> np.ndarray[Any, Any]:
    """Return a table of records."""
    table = np.zeros(len(rows), record(structure))
    for entry, row in zip(table, rows, strict=True):
        for name, value in row.items():
            entry[name] = value
    return table


def _branches(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    tree, rows, number = equations.loops.tree, list[dict[str, Any]](), dict[int, int]()
    for i, branch in enumerate(tree.branches):
        sides, rotation = branch.sides, np.zeros((2, 27))
        for factors, other in zip(rotation, branch.rotations, strict=False):
            factors[:] = other.ravel()
        number[branch.child] = i
        row = {
            "parent": branch.parent,
            "child": branch.child,
            "before": number.get(branch.parent, -1),
            "forward": branch.forward,
            "slides": len(branch.kind.slides),
            "turns": len(branch.kind.turns),
            "ball": branch.kind.ball,
            "first": branch.first,
            "parent_frame": sides.parent_frame.ravel(),
            "parent_point": sides.parent_point,
            "child_frame": sides.child_frame.ravel(),
            "child_point": sides.child_point,
            "rotation": rotation,
        }
        rows.append(row)
    return _filled("Branch", rows)


def _coordinates(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    tree, rows = equations.loops.tree, list[dict[str, Any]]()
    column = np.full(tree.count, -1)
    column[equations.free] = np.arange(len(equations.free))
    for branch in tree.branches:
        sides, kind = branch.sides, branch.kind
        link_a, link_b = (branch.parent, branch.child) if branch.forward else (branch.child, branch.parent)
        axes = zip((*kind.slides, *kind.turns), branch.axes, strict=True)
        for k, (name, (link, axis)) in enumerate(axes, branch.first):
            slide = k < branch.first_angle
            in_a = slide or kind.ball or (kind.crossed and name == "a")
            row = {
                "link": link,
                "carrier": link_a if in_a else link_b,
                "slide": slide,
                "centred": not slide and bool(kind.slides) and kind.ball,
                "centre_link": link_b,
                "column": column[k],
                "axis": axis,
                "centre": sides.child_point if branch.forward else sides.parent_point,
                "unit": tree.units[k],
            }
            rows.append(row)
    return _filled("Coordinate", rows)


def _side(link: int, end: End) -> tuple[int, Vector, Array]:
    return link, end.point, end.frame.ravel()


def _moved(cut: Cut) -> np.ndarray[Any, Any]:
    rows = [{"coordinate": k, "sign": np.sign(gain)} for k, gain in zip(cut.columns, cut.gains, strict=True)]
    return _filled("Moved", rows)


def _cuts(cuts: Sequence[Cut]) -> np.ndarray[Any, Any]:
    rows, first = list[dict[str, Any]](), 0
    for cut in cuts:
        of_a, of_b, units, targets = cut.products
        count, lengths = len(of_a), len(cut.lengths)
        row = {
            "a": _side(cut.sides[0], cut.joint.a),
            "b": _side(cut.sides[1], cut.joint.b),
            "rows": cut.rows,
            "first_column": first,
            "columns": len(cut.columns),
            "of_a": np.append(of_a, np.zeros(6 - count)),
            "of_b": np.concatenate([np.full(lengths, -1), of_b, np.zeros(6 - count)]),
            "unit": np.append(units, np.zeros(6 - count)),
            "target": np.append(targets, np.zeros(6 - count)),
        }
        if KINDS[cut.joint.kind].rod:
            row |= {"rod": cut.joint.length, "of_b": -1, "unit": 1.0 / cut.length}
        first += len(cut.columns)
        rows.append(row)
    return _filled("Cut", rows)


def _couplings(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    loops = equations.loops
    rows = [
        {
            "left_zero": row.coupling.zeros[0],
            "right_zero": row.coupling.zeros[1],
            "coefficients": np.append(
                row.coupling.coefficients, np.zeros(5 - len(row.coupling.coefficients))
            ),
            "unit": row.unit,
            "offset": offset / row.unit,
            "function": added.add(
                getattr(row.coupling.function, "instructions", None) if row.coupling.function else (),
                TIME,
                f"coupling {row.coupling.name}",
            ),
        }
        for row, offset in zip(loops.couplings, loops.turn_offsets, strict=True)
    ]
    return _filled("Coupling", rows)


def _inertias(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    table = np.zeros(len(equations.loops.tree.branches), record("Inertia"))
    table["mass"][equations.links], table["centre"][equations.links], moments = equations.inertias
    table["moments"][equations.links] = moments.reshape(-1, 9)
    return table


def _index(equations: EquationsOfMotion, link: str) -> int:
    return -1 if link == GROUND else equations.loops.tree.index[link]


def _point(equations: EquationsOfMotion, location: Location) -> tuple[int, Vector]:
    link, point = located(equations.model.mechanism, location)
    return _index(equations, link), point


def spring_table(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    """Return the springs between points as data of the C code."""
    rows: list[dict[str, Any]] = []
    for spring in equations.model.forces.springs:
        constants = {name: getattr(spring, name) for name in ("stiffness", "rest", "damping")}
        rows.append({"line": _line(equations, (spring.a, spring.b)), **constants})
    return _filled("Spring", rows)


def _line(equations: EquationsOfMotion, ends: tuple[Location, Location]) -> tuple[int, int, Vector, Vector]:
    """Return the links of two points, and the points in their frames."""
    (link_a, a), (link_b, b) = (_point(equations, end) for end in ends)
    return link_a, link_b, a, b


def _nonlinear_springs(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    rows: list[dict[str, Any]] = []
    for spring in equations.model.forces.nonlinear_springs:
        row: dict[str, Any] = {"coordinate": -1, "exponent": 1.0, **added.add_spring(spring)}
        if isinstance(law := spring.law, SoftStop):
            row |= {"exponent": law.exponent, "hysteresis": law.side * law.hysteresis}
        if not isinstance(spring.ends, str):
            row["line"] = _line(equations, spring.ends)
        elif spring.ends in equations.sprung:
            row["coordinate"] = equations.sprung[spring.ends]
        else:
            raise NotCompiledError(f"a spring in {spring.ends}, which is no coordinate of the tree")
        rows.append(row)
    return _filled("NonlinearSpring", rows)


def _bushings(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    return _filled(
        "Bushing",
        [
            _sides_of(equations, each)
            | {"stiffness": np.ravel(each.stiffness), "damping": np.ravel(each.damping)}
            for each in equations.model.forces.bushings
        ],
    )


def _sides_of(equations: EquationsOfMotion, joint: Joint | Bushing) -> dict[str, Any]:
    return {name: _side(_index(equations, end.link), end) for name, end in (("a", joint.a), ("b", joint.b))}


def _load_factors(equations: EquationsOfMotion, friction: Friction, joint: Joint) -> dict[int, Array]:
    """Return coordinate -> factors of force and moment, across and along the axis, in its friction, (4,)."""
    if not friction.coefficient:
        return {}
    if equations.model.mechanism.named_laws:
        raise NotCompiledError("coefficients of friction besides couplings")
    maps = {i: terms[0].sum(0) for i, terms in friction.loads(joint, np.eye(3)[2:])}
    return {i: total[[0, 2, 0, 2], [0, 2, 3, 5]] for i, total in maps.items()}


def _where(equations: EquationsOfMotion, joint: Joint) -> dict[str, int]:
    """Return the number of a joint's branch, -1 for one that closes a loop, and that of its cut."""
    loops = equations.loops
    branches = [branch.joint.name for branch in loops.tree.branches]
    if joint.name in branches:
        return {"branch": branches.index(joint.name)}
    return {"branch": -1, "cut": [cut.joint.name for cut in loops.cuts].index(joint.name)}


def _resistances(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    mechanism, forces, rows = equations.model.mechanism, equations.model.forces, list[dict[str, Any]]()
    numbers = {
        (friction.joint.name, friction.coordinate): k for k, friction in enumerate(equations.frictions)
    }
    if len(numbers) != len(equations.frictions):
        raise NotCompiledError("several frictions in one joint")
    for friction in forces.friction:
        joint = mechanism.joint(friction.joint)
        slides, loads = KINDS[joint.kind].slides, _load_factors(equations, friction, joint)
        for i, (viscous, coulomb) in enumerate(friction.sizes(KINDS[joint.kind])):
            kind = KINDS[joint.kind]
            turning = BALL if kind.ball else FIRST_AXIS + i if kind.crossed else ROTATION
            row = {
                **_sides_of(equations, joint),
                "motion": SLIDE if i < len(slides) else turning,
                "column": COLUMN[slides[i]] if i < len(slides) else 2,
                "friction": numbers.get((joint.name, i), -1),
                "viscous": viscous,
                "coulomb": coulomb,
                "at_rest": friction.ratio_at_rest,
                "stribeck": friction.stribeck,
            }
            if i in loads:
                row |= {"loaded": 1, "load": loads[i], **_where(equations, joint)}
            rows.append(row)
    for spring in forces.joint_springs:
        joint = mechanism.joint(spring.joint)
        hinge = KINDS[joint.kind].hinge
        row = {"motion": ROTATION if hinge else SLIDE, "column": 2, "friction": -1, "hinge": hinge}
        row |= {"coordinate": equations.sprung.get(spring.joint, -1), "stiffness": spring.stiffness}
        rows.append({**_sides_of(equations, joint), **row, "rest": spring.rest})
    return _filled("Resistance", rows)


def _loads(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    rows: list[dict[str, Any]] = []
    forces = equations.model.forces
    acting = [(*_point(equations, load.location), load.force, 0) for load in forces.loads]
    acting += [(_index(equations, couple.link), (0.0,) * 3, couple.moment, 3) for couple in forces.couples]
    for link, point, profile, first in acting:
        row: dict[str, Any] = {"link": link, "point": point, "varying": profile.over is not None}
        if profile.over is None:
            wrench = np.zeros(6)
            wrench[first : first + 3] = profile.evaluate(np.zeros(1))[0]
            row["wrench"] = wrench
        else:
            expressions = np.zeros(6, EXPRESSION)
            expressions[first : first + 3] = added.add_load(profile, _angle(equations))
            row["expressions"] = expressions
        rows.append(row)
    return _filled("Load", rows)


def _angle(equations: EquationsOfMotion) -> Variable:
    """Return the crank angle as a variable; zero without a crank."""
    return ("number", 0, 0.0) if equations.crank is None else ("coordinate", equations.crank, 0.0)


def _controllers(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    """Return controllers, and a load on the crank that varies."""
    index_of, units = equations.loops.tree.index_of, equations.loops.units

    def variable(name: str, letter: str) -> Variable:
        return {"q": "coordinate", "v": "rate"}[letter], index_of[name], float(units[index_of[name]])

    rows: list[tuple[int, tuple[int, int]]] = []
    for controller in equations.model.forces.controllers:
        rows.append((index_of[controller.coordinate], added.add_controller(controller, variable)))
    load = equations.model.forces.crank_torque
    if load is not None and load.over is not None and equations.crank is not None:
        (effort,) = added.add_load(load, _angle(equations))
        rows.append((equations.crank, effort))
    return np.array(rows, CONTROLLER)


def _prescribed(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    """Return prescribed coordinates and their motion laws."""
    return np.array(
        [
            (
                equations.loops.tree.index_of[name],
                added.add(getattr(law, "instructions", None), TIME, f"the motion law of {name}"),
            )
            for name, law in equations.prescribed.items()
        ],
        record("Prescribed"),
    )


def _gears(equations: EquationsOfMotion) -> Array:
    """Return the weights of all coordinates in the lengths of actuators, (actuators, count)."""
    tree = equations.loops.tree
    gears = [tree.coupled(actuator.gear) for actuator in equations.model.forces.actuators]
    return np.reshape(np.array(gears, dtype=float), (-1, tree.count))


def _pulls(equations: EquationsOfMotion) -> np.ndarray[Any, Any]:
    """Return the lines of actuators between points."""
    rows = [
        {"acts": 1, "line": _line(equations, actuator.ends), "ratio": actuator.pull} if actuator.ends else {}
        for actuator in equations.model.forces.actuators
    ]
    return _filled("Pull", rows)
