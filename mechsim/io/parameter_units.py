"""Units of the parameters of a TOML file, by their use, and their dependencies."""

import ast
from collections.abc import Iterator, Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.io.toml_keys import Key, root
from mechsim.io.toml_values import TomlSource, is_profile, is_quantity, shown
from mechsim.mechanism.expressions import parse_expression
from mechsim.units import Unit, of_any_kind

# the units that a file can choose; numbers in other units are in SI
_DIMENSIONS: tuple[Unit, ...] = ("m", "rad")


def parameter_units(document: Mapping[str, Any]) -> dict[str, Unit]:
    """Return the units of parameters that are a term of a length or an angle: name -> "m" or "rad".

    Args:
        document: contents of a file, which can be invalid.
    """
    parameters = document.get("parameters")
    entries: dict[str, Any] = parameters if isinstance(parameters, dict) else {}
    units: dict[str, Unit] = {}
    for tree, unit in _uses(root(), {key: value for key, value in document.items() if key != "parameters"}):
        units |= dict(_terms(tree, unit))
    # an expression uses parameters before it
    for name, text in reversed(entries.items()):
        if name in units and (tree := _parsed(text)) is not None:
            units |= dict(_terms(tree, units[name]))
    return {name: unit for name, unit in units.items() if name in entries and unit in _DIMENSIONS}


def parameter_dependencies(document: Mapping[str, Any]) -> dict[str, frozenset[str]]:
    """Return parameter -> all parameters of which it is a function, directly or indirectly."""
    dependencies: dict[str, frozenset[str]] = {}
    for name, text in document.get("parameters", {}).items():
        tree = _parsed(text)
        names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} if tree else set[str]()
        # an expression uses parameters before it
        dependencies[name] = frozenset().union(
            *({node} | dependencies[node] for node in names if node in dependencies)
        )
    return dependencies


def require_dimensions(source: TomlSource, parameters: Mapping[str, Any]) -> None:
    """Raise InputError for a parameter whose unit contradicts its use in the file.

    Args:
        source: the file.
        parameters: parameter -> its value, in the file or by `--set`.

    Raises:
        InputError: names the parameter, its value and its use.
    """
    remaining = {key: value for key, value in source.document.items() if key != "parameters"}
    dimension_of = {
        tree.id: unit
        for tree, unit in _uses(root(), remaining)
        if isinstance(tree, ast.Name) and unit in _DIMENSIONS
    }
    for name in dimension_of.keys() & parameters.keys():
        if not is_quantity(parameters[name]):
            continue
        path = ("parameters", name)
        with source.error_context(path):
            unit = of_any_kind(parameters[name], f"parameter {name}")[1]
        if unit != dimension_of[name]:
            what, example = ("a length", "13 mm") if dimension_of[name] == "m" else ("an angle", "30 deg")
            reason = (
                f"is {shown(parameters[name])}, but the file uses it as {what}; give one such as {example!r}"
            )
            raise source.error(path, reason)


def _uses(key: Key, value: Any, lift: Unit = "1") -> Iterator[tuple[ast.expr, Unit]]:
    """Yield the expressions of a file and their units; `lift` is the unit of a cam's lift."""
    inner: list[tuple[Key, Any]] = []
    match key:
        case {"unit": "joint"} if lift == "1":
            pass
        case {"unit": unit} if not ("over" in key and is_profile(value)):
            tree, unit = _parsed(value), lift if unit == "joint" else unit
            if tree is not None:
                yield tree, unit if unit in _DIMENSIONS else "1"
        case {"items": item} if isinstance(value, list):
            inner = [(item, entry) for entry in value]
        case {"properties": keys} if isinstance(value, dict):
            inner = [(keys[name], entry) for name, entry in value.items() if name in keys]
            if isinstance(follower := value.get("follower"), dict):
                lift = "rad" if follower.get("motion") == "swinging" else "m"
        case {"additionalProperties": item} if isinstance(value, dict):
            inner = [(item, entry) for entry in value.values()]
        case {"anyOf": alternatives}:
            inner = [(alternative, value) for alternative in alternatives]
        case _:
            pass
    for inner_key, entry in inner:
        yield from _uses(inner_key, entry, lift)


def _parsed(value: Any) -> ast.expr | None:
    """Return an expression; None for a plain number, a quantity, or other text."""
    if not isinstance(value, str) or is_quantity(value):
        return None
    try:
        return parse_expression(value)
    except InputError:
        return None


def _terms(node: ast.expr, unit: Unit) -> Iterator[tuple[str, Unit]]:
    """Yield the parameters that are terms of an expression, and their units; arguments of sin are angles."""
    match node:
        case ast.Name(id=name):
            yield name, unit
        case (
            ast.UnaryOp(operand=operand)
            | ast.BinOp(left=operand, op=ast.Mult() | ast.Div(), right=ast.Constant())
            | ast.BinOp(left=ast.Constant(), op=ast.Mult(), right=operand)
        ):
            yield from _terms(operand, unit)
        case ast.Call(func=ast.Name(id="sin" | "cos" | "tan"), args=[operand]):
            yield from _terms(operand, "rad")
        case (
            ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right)
            | ast.BinOp(left=left, op=ast.Mult(), right=ast.Call() as right)
            | ast.BinOp(left=ast.Call() as left, op=ast.Mult(), right=right)
        ):
            yield from _terms(left, unit)
            yield from _terms(right, unit)
        case _:
            return
