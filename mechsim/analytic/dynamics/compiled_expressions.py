"""Expressions, controllers and actuators as data of the C code in `c/expressions.c`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion
from mechsim.errors import MechsimError
from mechsim.model.actuators import no_control
from mechsim.model.expressions import Instruction, Table
from mechsim.model.load_profile import LoadProfile
from mechsim.numerics.arrays import Array

# instructions of `c/expressions.c`, in its order; variables are times, coordinates and their rates
VARIABLES = ("number", "time", "coordinate", "rate")
CODES = (
    *VARIABLES,
    *("Neg", "Add", "Sub", "Mult", "Div", "Pow", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sqrt", "exp", "log", "abs", "min", "max", "table"),
)
# what a table has beyond its ends, in the order of `c/expressions.c`
BEYOND = ("repeated", "undefined", "continued")
# the largest number of values on its stack
MAX_VALUES = 64
INSTRUCTION = np.dtype([("code", "i4"), ("index", "i4"), ("value", "f8")], align=True)
EXPRESSION = np.dtype([("first", "i4"), ("length", "i4")], align=True)
CONTROLLER = np.dtype([("coordinate", "i4"), ("effort", EXPRESSION)], align=True)
PRESCRIBED = np.dtype([("coordinate", "i4"), ("law", EXPRESSION)], align=True)
ACTUATOR = np.dtype(
    [
        ("control", EXPRESSION),
        ("has_state", "i4"),
        *((name, "f8", n) for name, n in (("gain", 3), ("bias", 3), ("direct", 2), ("inflow", 4))),
        *((name, "f8", 2) for name in ("control_range", "state_range", "force_range")),
    ],
    align=True,
)
# a variable of an expression: one of `VARIABLES`, number of its coordinate, and unit of a rate
Variable = tuple[str, int, float]
TIME: Variable = ("time", 0, 0.0)


class NotCompiledError(MechsimError):
    """A model that the C code does not contain; the message names the element."""


class Instructions:
    """The instructions of all expressions of a model.

    Attributes:
        rows: of the table for the C code: code, index and value.
        numbers: of the tables that they name.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[int, int, float]] = []
        self.numbers: list[float] = []

    def add_table(self, table: Table) -> int:
        """Add a table, as `of_table` of `c/expressions.c` reads it, and return where it lies."""
        first, integral = len(self.numbers), table.spline.antiderivative()
        order, count = integral.c.shape
        self.numbers += [float(count), float(order), float(BEYOND.index(table.beyond)), table.advance]
        self.numbers += [*integral.x.tolist(), *integral.c.T.ravel().tolist()]
        return first

    def add(
        self,
        instructions: Sequence[Instruction] | None,
        variables: Mapping[str, Variable] | Variable,
        what: str,
    ) -> tuple[int, int]:
        """Add an expression and return its first instruction and their number.

        Args:
            instructions: its evaluation; None for one that has none, as a function in Python.
            variables: name -> variable, or the only one.
            what: the element in words.

        Raises:
            NotCompiledError: if there are no instructions, or too many values at once.
        """
        first, values = len(self.rows), 0
        if instructions is None:
            raise NotCompiledError(f"{what} given by a function")
        for instruction in instructions:
            values += 1 - instruction.operands
            if values > MAX_VALUES:
                raise NotCompiledError(f"{what} with more than {MAX_VALUES} terms")
            if instruction.name == "variable":
                kind, index, value = (
                    variables if isinstance(variables, tuple) else variables[instruction.value]
                )
            elif instruction.name == "table":
                kind, index, value = "table", 1, float(self.add_table(instruction.value))
            else:
                kind, index, value = (
                    instruction.name,
                    instruction.operands,
                    0.0 if instruction.operands else float(instruction.value),
                )
            self.rows.append((CODES.index(kind), index, value))
        return first, len(self.rows) - first


def load_expressions(
    equations: EquationsOfMotion, profile: LoadProfile, added: Instructions, what: str
) -> list[tuple[int, int]]:
    """Add the components of a load over time or angle and return where they lie."""
    variable = TIME
    if profile.over == "angle":
        variable = ("number", 0, 0.0) if equations.crank is None else ("coordinate", equations.crank, 0.0)
    return [
        added.add(component, variable, f"{what} over {profile.over}") for component in profile.instructions
    ]


def controllers(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    """Return controllers, and a load on the crank that varies, as data of the C code."""
    index_of, units = equations.loops.tree.index_of, equations.loops.units
    kinds = {"q": "coordinate", "v": "rate"}
    rows: list[tuple[int, tuple[int, int]]] = []
    for controller in equations.model.forces.controllers:
        variables: dict[str, Variable] = {
            f"state_{k}_": (kinds[letter], index_of[name], float(units[index_of[name]]))
            for k, (name, letter) in enumerate(controller.inputs)
        }
        effort = added.add(controller.instructions, {**variables, "t": TIME}, "a controller")
        rows.append((index_of[controller.coordinate], effort))
    load = equations.model.forces.crank_torque
    if load is not None and load.over is not None and equations.crank is not None:
        (effort,) = load_expressions(equations, load, added, "a load")
        rows.append((equations.crank, effort))
    return np.array(rows, CONTROLLER)


def prescribed(equations: EquationsOfMotion, added: Instructions) -> np.ndarray[Any, Any]:
    """Return prescribed coordinates and their motion laws as data of the C code."""
    return np.array(
        [
            (
                equations.loops.tree.index_of[name],
                added.add(getattr(law, "instructions", None), TIME, f"the motion law of {name}"),
            )
            for name, law in equations.prescribed.items()
        ],
        PRESCRIBED,
    )


def actuators(equations: EquationsOfMotion, added: Instructions) -> tuple[np.ndarray[Any, Any], Array]:
    """Return actuators as data of the C code, and their weights of all coordinates, (actuators, count)."""
    forces, tree = equations.model.forces, equations.loops.tree
    table = np.zeros(len(forces.actuators), ACTUATOR)
    for row, actuator in zip(table, forces.actuators, strict=True):
        for name in ACTUATOR.names or ():
            if hasattr(actuator, name) and name != "control":
                row[name] = getattr(actuator, name) or 0.0
        zero = (Instruction("number", 0.0),)
        control = actuator.control
        instructions = zero if control is no_control else getattr(control, "instructions", None)
        row["control"] = added.add(instructions, TIME, f"the control of actuator {actuator.name}")
        row["has_state"] = actuator.inflow is not None
    gears = [tree.coupled(actuator.gear) for actuator in forces.actuators]
    return table, np.reshape(np.array(gears, dtype=float), (-1, tree.count))
