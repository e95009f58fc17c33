"""Units of the parameters of a TOML file, inferred from their use, and their dependencies."""

import ast
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.model.expressions import parse_expression
from mechsim.subjects.law_text import is_profile
from mechsim.subjects.toml_keys import ROOT, AnyOf, KeyType, ListOf, Number, Profile, Table, TableOf
from mechsim.subjects.toml_values import TomlSource, is_quantity, shown
from mechsim.units import Unit, of_any_kind

# the units that a file can choose; numbers in other units are in SI
_DIMENSIONS: tuple[Unit, ...] = ("m", "rad")
_TRIGONOMETRIC, _INVERSE_TRIGONOMETRIC, _UNIT_PRESERVING = (
    ("sin", "cos", "tan"),
    ("asin", "acos", "atan", "atan2"),
    ("abs", "min", "max"),
)


def parameter_units(document: Mapping[str, Any]) -> dict[str, Unit]:
    """Return the units of parameters whose use determines them: name -> "m" or "rad".

    Args:
        document: contents of a file, which can be invalid.
    """
    parameters: dict[str, Any] = (
        document.get("parameters", {}) if isinstance(document.get("parameters"), dict) else {}
    )
    inferred = _UnitInference(parameters)
    uses = list(_uses(ROOT, {key: value for key, value in document.items() if key != "parameters"}))
    trees = {name: tree for name, text in parameters.items() if (tree := _parsed(text)) is not None}
    for _ in range(len(parameters) + 1):
        before = dict(inferred.units)
        for tree, unit in uses:
            inferred.assign(tree, unit)
        for name, tree in trees.items():
            unit = inferred.units[name]
            if unit is not None:
                inferred.assign(tree, unit)
            elif (unit_ := inferred.unit_of(tree)) in _DIMENSIONS:
                inferred.units[name] = unit_
        if inferred.units == before:
            break
    return {name: unit for name, unit in inferred.units.items() if unit in _DIMENSIONS}


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
        for tree, unit in _uses(ROOT, remaining)
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


def _uses(key: KeyType, value: Any) -> Iterator[tuple[ast.expr, Unit]]:
    """Yield the expressions of a file and their units."""
    inner: list[tuple[KeyType, Any]] = []
    match key:
        case Profile() if is_profile(value):
            pass
        case Number(unit=unit) | Profile(unit=unit):
            tree = _parsed(value)
            if tree is not None:
                yield tree, unit if unit in _DIMENSIONS else "1"
        case ListOf(item=item) if isinstance(value, list):
            inner = [(item, entry) for entry in value]
        case TableOf(value_type=item) if isinstance(value, dict):
            inner = [(item, entry) for entry in value.values()]
        case Table(keys=keys) if isinstance(value, dict):
            inner = [(keys[name], entry) for name, entry in value.items() if name in keys]
        case AnyOf(alternatives=alternatives):
            inner = [(alternative, value) for alternative in alternatives]
        case _:
            pass
    for inner_key, entry in inner:
        yield from _uses(inner_key, entry)


def _parsed(value: Any) -> ast.expr | None:
    """Return an expression; None for a plain number, a quantity, or other text."""
    if not isinstance(value, str) or is_quantity(value):
        return None
    try:
        return parse_expression(value)
    except InputError:
        return None


class _UnitInference:
    """Units of parameters as inferred so far; each expression adds to them."""

    def __init__(self, names: Iterable[str]):
        self.units: dict[str, Unit | None] = dict.fromkeys(names)

    def assign(self, node: ast.expr, unit: Unit) -> None:
        """Infer units of parameters from an expression with a known unit."""
        if isinstance(node, ast.Name) and node.id in self.units and self.units[node.id] is None:
            self.units[node.id] = unit
        for operand, operand_unit in self._operand_units(node, unit):
            self.assign(operand, operand_unit)

    def _operand_units(self, node: ast.expr, unit: Unit) -> Iterator[tuple[ast.expr, Unit]]:
        """Yield the operands of an expression with a known unit whose units follow from it."""
        match node:
            case ast.UnaryOp(operand=operand):
                yield operand, unit
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                yield left, unit
                yield right, unit
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                yield from self._factor_units(left, right, unit)
                yield from self._factor_units(right, left, unit)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                below = self.unit_of(right)
                if below == "1" or unit == "1":
                    yield left, unit if below == "1" else below or "1"
                if self.unit_of(left) == unit:
                    yield right, "1"
            case ast.Call(func=ast.Name(id=name), args=args) if name in _TRIGONOMETRIC + _UNIT_PRESERVING:
                for argument in args:
                    yield argument, "rad" if name in _TRIGONOMETRIC else unit
            case _:
                pass

    def _factor_units(self, factor: ast.expr, other: ast.expr, unit: Unit) -> Iterator[tuple[ast.expr, Unit]]:
        """Yield the other factor of a product with a known unit if one factor determines it."""
        if self.unit_of(factor) == "1":
            yield other, unit
        elif self.unit_of(factor) == unit:
            yield other, "1"

    def unit_of(self, node: ast.expr) -> Unit | None:
        """Return the unit of an expression; None if unknown."""
        match node:
            case ast.Constant():
                return "1"
            case ast.Name(id=name):
                return self.units.get(name, "1")
            case ast.UnaryOp(operand=operand):
                return self.unit_of(operand)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                first, second = self.unit_of(left), self.unit_of(right)
                return second if first in (None, "1") else first
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                both = self.unit_of(left), self.unit_of(right)
                return both[0] if both[1] == "1" else both[1] if both[0] == "1" else None
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                above, below = self.unit_of(left), self.unit_of(right)
                return above if below == "1" else "1" if above == below and above is not None else None
            case ast.Call(func=ast.Name(id=name), args=args):
                if name in _UNIT_PRESERVING:
                    return self.unit_of(args[0]) if args else None
                return (
                    "rad"
                    if name in _INVERSE_TRIGONOMETRIC
                    else "1"
                    if name in _TRIGONOMETRIC or not _has_variables(node)
                    else None
                )
            case _:
                return None if _has_variables(node) else "1"


def _has_variables(node: ast.AST) -> bool:
    return any(
        isinstance(child, ast.Name) and child.id != "pi"
        for child in ast.walk(node)
        if not any(isinstance(call, ast.Call) and call.func is child for call in ast.walk(node))
    )
