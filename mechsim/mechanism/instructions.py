"""Expressions and actuators as data of the C code in `expressions.c`, which both methods of dynamics run."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import MechsimError
from mechsim.mechanism.actuators import Actuator, no_control
from mechsim.mechanism.bristle_friction import BristleFriction
from mechsim.mechanism.cams import LAWS, SegmentedLaw
from mechsim.mechanism.expressions import Instruction, Table
from mechsim.mechanism.load_profile import LoadProfile
from mechsim.mechanism.motors import Controller
from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SpringLaw

# instructions of `expressions.c`, in its order; variables are times, coordinates and their rates
VARIABLES = ("number", "time", "coordinate", "rate")
CODES = (
    *VARIABLES,
    *("Neg", "Add", "Sub", "Mult", "Div", "Pow", "sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sqrt", "exp", "log", "abs", "min", "max", "table", "segments"),
)
# what a table has beyond its ends, in the order of `expressions.c`
BEYOND = ("repeated", "undefined", "continued")
# the largest number of values on its stack
MAX_VALUES = 64
INSTRUCTION = np.dtype([("code", "i4"), ("index", "i4"), ("value", "f8")], align=True)
EXPRESSION = np.dtype([("first", "i4"), ("length", "i4")], align=True)
CONTROLLER = np.dtype([("coordinate", "i4"), ("effort", EXPRESSION)], align=True)
ACTUATOR = np.dtype(
    [
        ("control", EXPRESSION),
        ("has_state", "i4"),
        *((name, "f8", n) for name, n in (("gain", 3), ("bias", 3), ("direct", 2), ("inflow", 4))),
        *((name, "f8", 2) for name in ("control_range", "state_range", "force_range")),
        ("bristles", "f8", 6),
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
        """Add a table, as `of_table` of `expressions.c` reads it, and return where it lies."""
        first, integral = len(self.numbers), table.spline.antiderivative()
        order, count = integral.c.shape
        self.numbers += [float(count), float(order), float(BEYOND.index(table.beyond)), table.advance]
        self.numbers += [*integral.x.tolist(), *integral.c.T.ravel().tolist()]
        return first

    def add_segments(self, law: SegmentedLaw) -> int:
        """Add the law of a cam, as `of_segments` of `expressions.c` reads it, and return where it lies."""
        first, kinds = len(self.numbers), [[*LAWS].index(kind) for kind in law.kinds]
        rows = zip(law.ends, np.diff(law.ends), law.levels, np.diff(law.levels), kinds, strict=False)
        self.numbers += [float(len(kinds)), *(float(value) for row in rows for value in row)]
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
            kind, index, value = instruction.name, instruction.operands, 0.0
            if kind == "variable":
                own = variables if isinstance(variables, tuple) else variables[instruction.value]
                kind, index, value = own
            elif kind == "number":
                value = float(instruction.value)
            elif kind == "table":
                value = float(self.add_table(instruction.value))
            elif kind == "segments":
                value = float(self.add_segments(instruction.value))
            self.rows.append((CODES.index(kind), index, value))
        return first, len(self.rows) - first

    def add_load(self, profile: LoadProfile, angle: Variable) -> list[tuple[int, int]]:
        """Add the components of a load over time or angle, with the variable of the angle."""
        variable = angle if profile.over == "angle" else TIME
        return [
            self.add(component, variable, f"a load over {profile.over}") for component in profile.instructions
        ]

    def add_controller(
        self, controller: Controller, variable: Callable[[str, str], Variable]
    ) -> tuple[int, int]:
        """Add the effort of a controller, with the variable of each coordinate and "q" or "v"."""
        variables = {f"state_{k}_": variable(*pair) for k, pair in enumerate(controller.inputs)}
        return self.add(controller.instructions, {**variables, "t": TIME}, "a controller")

    def add_spring(self, spring: NonlinearSpring) -> dict[str, Any]:
        """Add the law of a nonlinear spring and return its record."""
        law = spring.law
        row: dict[str, Any] = {"table": -1, "rest": law.reference}
        row |= {"stiffness": law.stiffness, "damping": law.damping}
        if isinstance(law, SpringLaw):
            if law.table is not None:
                table = Table(law.table.spline, "continued")
                row["table"], row["over_rate"] = self.add_table(table), law.over == "v"
            variables: dict[str, Variable] = {"l": ("coordinate", 0, 0.0), "v": ("rate", 0, 1.0)}
            values = zip(law.names, law.values, strict=True)
            variables |= {name: ("number", 0, value) for name, value in values}
            row["preload"] = law.preload
            row["expression"] = self.add(law.instructions, variables, f"spring {spring.name}")
        return row

    def add_control(self, actuator: Actuator) -> tuple[int, int]:
        """Add the control of an actuator."""
        zero, control = (Instruction("number", 0.0),), actuator.control
        instructions = zero if control is no_control else getattr(control, "instructions", None)
        return self.add(instructions, TIME, f"the control of actuator {actuator.name}")

    def add_actuators(self, actuators: Sequence[Actuator]) -> np.ndarray[Any, Any]:
        """Add the controls of actuators and return the actuators.

        Raises:
            NotCompiledError: for a kind with another law.
        """
        table = np.zeros(len(actuators), ACTUATOR)
        for row, actuator in zip(table, actuators, strict=True):
            if type(actuator) not in (Actuator, BristleFriction):
                raise NotCompiledError(f"the law of {actuator.name}")
            for name in ACTUATOR.names or ():
                if hasattr(actuator, name) and name != "control":
                    row[name] = getattr(actuator, name) or 0.0
            row["control"] = self.add_control(actuator)
            row["has_state"] = actuator.inflow is not None
        return table


def c_source() -> str:
    """Return the C code that evaluates expressions and actuators."""
    return Path(__file__).with_name("expressions.c").read_text(encoding="utf-8")
