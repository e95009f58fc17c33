"""Numbers of a description, exact to the working precision: expressions of parameters, units, programs."""

import ast
import operator
import re
from collections.abc import Mapping
from typing import Any

from mpmath import mp, mpf

LENGTHS = {"m": "1", "mm": "1e-3", "cm": "1e-2"}
OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
FORWARD = ("sin", "cos", "tan")
BACKWARD = ("asin", "acos", "atan", "atan2")
WITH_UNIT = re.compile(r"(\d+(?:\.\d*)?)(deg|rad|mm|cm|m)\b")


def length_unit(name: str) -> Any:
    """Return a unit of length in [m]."""
    return mpf(LENGTHS[name])


def angle_unit(name: str) -> Any:
    """Return a unit of angle in [rad]."""
    return mp.pi / 180 if name == "deg" else mpf(1)


def value(text: Any, names: Mapping[str, Any], angle: Any) -> Any:
    """Return the value of an expression; literals are read as decimals, not as doubles.

    Args:
        text: a number, or an expression.
        names: values by name.
        angle: the unit in which its functions take and give angles, in [rad].
    """
    source = str(text)

    def evaluated(node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return mpf(ast.get_source_segment(source, node))
        if isinstance(node, ast.Name):
            return mp.pi + 0 if node.id == "pi" else names[node.id]
        if isinstance(node, ast.UnaryOp):
            return -evaluated(node.operand) if isinstance(node.op, ast.USub) else evaluated(node.operand)
        if isinstance(node, ast.BinOp):
            return OPERATORS[type(node.op)](evaluated(node.left), evaluated(node.right))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return _called(node.func.id, [evaluated(item) for item in node.args], angle)
        raise ValueError(f"{source!r} contains an item that is no number")

    return evaluated(ast.parse(source.strip(), mode="eval").body)


def _called(name: str, entry: list[Any], angle: Any) -> Any:
    if name in FORWARD:
        return getattr(mp, name)(entry[0] * angle)
    if name in BACKWARD:
        return getattr(mp, name)(*entry) / angle
    return getattr(mp, name)(*entry)


def motion_law(text: str, names: Mapping[str, Any]) -> Any:
    """Return a function of time in [s] for a driver's program; its sines take radians."""
    units = {name: mpf(unit_size) for name, unit_size in LENGTHS.items()} | {
        "deg": mp.pi / 180,
        "rad": mpf(1),
    }
    spelled = WITH_UNIT.sub(r"(\1*unit_\2)", text)
    available = dict(names) | {f"unit_{name}": unit_size for name, unit_size in units.items()}
    return lambda t: value(spelled, available | {"t": t}, mpf(1))
