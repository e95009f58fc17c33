"""A dynamic model as an FMU: efforts on joints are inputs; coordinates, points and energies are outputs."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mechsim.codegen.fmu import FmuModel, Variable
from mechsim.codegen.fmu_kinematics import gravity_parameters
from mechsim.codegen.solver_code import template
from mechsim.errors import InputError
from mechsim.kinetics.compiled_model import CompiledModel, c_sources, library, members_of
from mechsim.kinetics.compiled_motion import collocation_rule
from mechsim.kinetics.dynamic_run import TOLERANCE, Initial, initial_values, require_regular
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, equations_of_motion
from mechsim.kinetics.forward_dynamics import Integration
from mechsim.kinetics.gaps import opens, released
from mechsim.kinetics.initial_state import initial_state
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.passive_rotation import with_determined_motion
from mechsim.mechanism.forces import located
from mechsim.mechanism.instructions import CONTROLLER, INSTRUCTION
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.nonlinear_springs import SpringLaw
from mechsim.numerics.arrays import Array

# duration of the runs of an FMU by default, in [s]
DURATION = 1.0
ENERGIES = ("kinetic", "potential")


def dynamic_fmu(model: DynamicModel, initial: Mapping[str, Initial], duration: float = DURATION) -> FmuModel:
    """Return a dynamic model, released from an initial state, as an FMU.

    Args:
        model: the model.
        initial: coordinates and rates at the start, as `mechsim.dynamics.run` takes them.
        duration: duration of a run in [s], which decides whether the motion is stiff.

    Raises:
        InputError: for a model with events, such as impacts, and for one that the C code does not contain.
        MissingToolError: if there is no C compiler.
    """
    run, compiled = _prepared(released(model), initial, duration)
    equations, mechanism = run.equations, model.mechanism
    tree = equations.loops.tree
    inputs, tables = _with_inputs(equations, compiled)
    parameters = dict(_parameters(equations, tables))
    members = [*(where for _, where in inputs), *(where for where, _ in parameters.values())]
    states, index, units = zip(*_states(equations, run.state), strict=True)
    points = [
        (point, *located(mechanism, point)) for point, (link, _) in mechanism.points.items() if link != GROUND
    ]
    integers = {
        "RANK": equations.rank,
        "IMPLICIT": int(run.implicit),
        "SIZE": len(run.state),
        "COUNT": tree.count,
        "POSITIONS": tree.count + 4 * len(tree.balls),
        "POINTS": len(points),
    }
    reals = {
        "TOLERANCE": run.tolerance,
        "LONGEST": run.longest,
        "NEAREST": run.nearest_pivot(),
        "DURATION": duration,
    }
    lines = [
        c_sources(),
        *_tables(tables, compiled, len(inputs)),
        "enum { " + ", ".join(f"{key} = {value}" for key, value in integers.items()) + " };",
        *(f"#define {key} {_number(value)}" for key, value in reals.items()),
        _array("size_t", "PLACES", [f"offsetof(Tables, {where})" for where in members]),
        _array("double", "INITIAL_STATE", run.state),
        _array("int", "INDEX", index),
        _array("double", "UNIT", units),
        _array("double", "NONE", np.zeros(len(equations.frictions))),
        _array("double", "PHASES", run.right.mode.phases),
        _array("double", "RULE", collocation_rule()),
        _array("int", "POINT_LINK", [tree.index[link] for _, link, _ in points]),
        _array("double", "POINT_PLACE", np.reshape([position for *_, position in points], (-1, 3)), "[3]"),
        template("fmu_dynamics.c", {}),
    ]
    outputs = [
        Variable(f"{point}.{prefix}{axis}", f"m{per}", description=f"{what} of a point")
        for point, _, _ in points
        for what, prefix, per in (("position", "", ""), ("velocity", "v", "/s"))
        for axis in "xyz"
    ]
    outputs += [Variable(energy, "J", description=f"{energy} energy") for energy in ENERGIES]
    return FmuModel(
        mechanism.name,
        [variable for variable, _ in inputs],
        [variable for _, variable in parameters.values()],
        states,
        [_derivative(state) for state in states],
        outputs,
        "\n".join(lines),
        duration,
    )


def _prepared(
    model: DynamicModel, initial: Mapping[str, Initial], duration: float
) -> tuple[Integration, CompiledModel]:
    """Return a run from an initial state, and its model in C."""
    name = model.mechanism.name
    values = initial_values(model, initial)
    equations = equations_of_motion(model, dict.fromkeys([*values.coordinates, *values.rates], 0.0))
    if event := _event(equations):
        raise InputError(
            f"{name}: the compiled dynamics have no events, and {event} needs them; leave that out, or "
            "leave out --dynamics for the positions"
        )
    q, rates = initial_state(equations, values)
    start = equations.kinematics(q, rates)
    require_regular(start)
    # a missing compiler is an error here, and not in a run
    library()
    run = Integration(with_determined_motion(start), TOLERANCE)
    compiled = run.prepared(duration)
    if compiled is None:
        raise InputError(f"{name}: {run.note}; leave it out")
    return run, compiled


def _event(equations: EquationsOfMotion) -> str:
    """Return an element of a model whose motion has events; empty if there is none."""
    model, forces = equations.model, equations.model.forces
    ranges = [*getattr(model.solver, "ranges", {}), *forces.stop_ranges]
    if ranges:
        return f"the limit of joint {ranges[0]!r}"
    if opens(model.mechanism):
        return "a contact, rope or backlash that opens"
    if equations.frictions:
        return f"Coulomb friction in joint {equations.frictions[0].joint.name!r}"
    springs = [spring for spring in forces.nonlinear_springs if not isinstance(spring.law, SpringLaw)]
    springs += [spring for spring in forces.nonlinear_springs if getattr(spring.law, "table", None)]
    return f"spring {springs[0].name!r}" if springs else ""


def _coordinates(equations: EquationsOfMotion) -> list[tuple[str, int]]:
    """Return names and indices of the free coordinates that are no rotations of balls."""
    tree, chosen = equations.loops.tree, {*equations.free} - {*equations.loops.tree.ball_indices}
    return [(name, i) for name, i in tree.index_of.items() if i in chosen]


def _states(equations: EquationsOfMotion, state: Array) -> Iterator[tuple[Variable, int, float]]:
    """Yield each continuous state, its index, and its unit in the equations."""
    tree, units, unit_of = equations.loops.tree, equations.loops.units, equations.model.mechanism.unit
    rates = tree.count + 4 * len(tree.balls)
    for first, letter, per in ((0, "q", ""), (rates, "v", "/s")):
        for name, i in _coordinates(equations):
            value = float(state[first + i] * units[i])
            yield Variable(f"{name}.{letter}", unit_of(name) + per, value), first + i, float(units[i])
        for k, ball in enumerate(tree.balls):
            quaternion = f"{ball.joint.name}.quaternion", "wxyz", "", tree.count + 4 * k
            spin = f"{ball.joint.name}.w", "xyz", "rad/s", rates + ball.first_angle
            name, axes, unit, start = spin if first else quaternion
            for i, axis in enumerate(axes, start):
                yield Variable(f"{name}.{axis}", unit, float(state[i])), i, 1.0
    names = [a.name for a in equations.model.forces.actuators if a.inflow is not None]
    for i, name in enumerate(names, rates + tree.count):
        yield Variable(f"{name}.activation", "", float(state[i])), i, 1.0


def _derivative(state: Variable) -> Variable:
    """Return the derivative of a state: an acceleration of a rate, and der(...) of others."""
    if state.name.endswith(".v"):
        return Variable(f"{state.name[:-1]}a", f"{state.unit}2")
    unit = "rad/s2" if state.unit == "rad/s" else f"{state.unit}/s" if state.unit else "1/s"
    return Variable(f"der({state.name})", unit)


def _with_inputs(
    equations: EquationsOfMotion, compiled: CompiledModel
) -> tuple[list[tuple[Variable, str]], dict[str, np.ndarray[Any, Any]]]:
    """Return an effort on each coordinate with its place, and the tables with a controller for each."""
    names, tables = _coordinates(equations), compiled.tables
    first = len(tables["instruction"])
    added = {
        "instruction": np.zeros(len(names), INSTRUCTION),
        "controller": np.array([(i, (first + k, 1)) for k, (_, i) in enumerate(names)], CONTROLLER),
    }
    unit_of = equations.model.mechanism.effort_unit
    inputs = [
        (
            Variable(f"{name}.effort", unit_of(name).replace(" ", "."), 0.0, "added to the model's own"),
            f"instruction[{first + k}].value",
        )
        for k, (name, _) in enumerate(names)
    ]
    joined = {name: np.concatenate([tables[name], rows]) for name, rows in added.items()}
    return inputs, tables | joined


def _parameters(
    equations: EquationsOfMotion, tables: Mapping[str, np.ndarray[Any, Any]]
) -> Iterator[tuple[str, tuple[str, Variable]]]:
    """Yield name -> place in the tables, and parameter."""
    model = equations.model
    forces, mechanism = model.forces, model.mechanism

    def row(
        table: str, i: int, field: str, name: str, unit: str, k: int | None = None
    ) -> tuple[str, tuple[str, Variable]]:
        value = tables[table][i][field]
        index = "" if k is None else f"[{k}]"
        start = float(value if k is None else value[k])
        return name, (f"{table}[{i}].{field}{index}", Variable(name, unit, start))

    for k, gravity in enumerate(gravity_parameters(forces.gravity)):
        yield gravity.name, (f"gravity[{k}]", gravity)
    for link in (link.name for link in mechanism.links if link.name in equations.loops.tree.index):
        i = equations.loops.tree.index[link]
        yield row("inertias", i, "mass", f"{link}.mass", "kg")
        for k, axis in enumerate("xyz"):
            yield row("inertias", i, "centre", f"{link}.centre.{axis}", "m", k)
        for k, axis in enumerate("xyz"):
            yield row("inertias", i, "moments", f"{link}.inertia.{axis}{axis}", "kg.m2", 4 * k)
    for i in range(len(tables["spring"])):
        for field, unit in (("stiffness", "N/m"), ("rest", "m"), ("damping", "N.s/m")):
            yield row("spring", i, field, f"spring{i + 1}.{field}", unit)
    frictions = [
        (joint.coordinates[i] if i < len(joint.coordinates) else f"{joint.name}.{i}", joint, i)
        for joint, friction in ((mechanism.joint(f.joint), f) for f in forces.friction)
        for i, _ in enumerate(friction.sizes(KINDS[joint.kind]))
    ]
    for i, (name, joint, k) in enumerate(frictions):
        unit = "N.s/m" if k < len(KINDS[joint.kind].slides) else "N.m.s/rad"
        yield row("resistance", i, "viscous", f"{name}.viscous", unit)
    for i, spring in enumerate(forces.joint_springs, len(frictions)):
        unit = mechanism.unit(spring.joint)
        yield row(
            "resistance", i, "stiffness", f"{spring.joint}.stiffness", "N/m" if unit == "m" else "N.m/rad"
        )
        yield row("resistance", i, "rest", f"{spring.joint}.rest", unit)


def _number(value: float) -> str:
    return "INFINITY" if value == np.inf else "-INFINITY" if value == -np.inf else repr(float(value))


def _initializer(value: Any) -> str:
    """Return the initializer in C of a record, an array or a number."""
    if isinstance(value, np.void):
        return "{" + ", ".join(_initializer(value[name]) for name in value.dtype.names or ()) + "}"
    if isinstance(value, np.ndarray):
        return "{" + ", ".join(map(_initializer, value)) + "}"
    return str(value) if isinstance(value, int | np.integer | str) else _number(value)


def _array(kind: str, name: str, values: Any, more: str = "") -> str:
    """Return a constant array; C has no empty arrays."""
    entries = [_initializer(value) for value in values] or ["{0}" if more else "0"]
    return f"static const {kind} {name}[]{more} = {{{', '.join(entries)}}};"


def _tables(
    tables: Mapping[str, np.ndarray[Any, Any]], compiled: CompiledModel, inputs: int
) -> Iterator[str]:
    """Yield the tables of a model, with the numbers that inputs and parameters replace, and their use."""
    data, fields = compiled.data, members_of("Model")
    counts = {name: getattr(data, name) for name, kind, _ in fields if kind == "int"}
    counts["controllers"] += inputs
    types = {name[1:]: kind for name, kind, _ in fields if name[0] == "*"}
    flat = {
        name: tables[name].ravel() if kind == "double" else tables[name]
        for name, kind in types.items()
        if tables[name].size
    }
    yield "/* the data of the model */\ntypedef struct {"
    yield from (f"    {types[name]} {name}[{len(table)}];" for name, table in flat.items())
    yield "    double gravity[3], torque, torque_slope;\n} Tables;\n"
    yield "static const Tables TABLES = {"
    for name, table in flat.items():
        rows = ",\n        ".join(_initializer(row) for row in table)
        yield f"    .{name} = {{\n        {rows}}},"
    yield f"    .gravity = {_initializer(np.array(data.gravity))},"
    yield f"    .torque = {_number(data.torque)},\n    .torque_slope = {_number(data.torque_slope)}}};\n"
    yield "static void connect(Model *model, const Tables *tables) {"
    yield from (f"    model->{name} = {count};" for name, count in counts.items())
    for name in types:
        yield f"    model->{name} = {f'tables->{name}' if name in flat else 'NULL'};"
    yield "    memcpy(model->gravity, tables->gravity, sizeof tables->gravity);"
    yield "    model->torque = tables->torque, model->torque_slope = tables->torque_slope;\n}\n"
