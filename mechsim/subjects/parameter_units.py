"""What the parameters of a TOML file measure, told by where the file uses them, and what they follow from."""

import ast
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.subjects.checked_values import is_quantity, shown
from mechsim.subjects.expressions import parsed
from mechsim.subjects.key_kinds import Choice, Course, Key, Keys, Named, Number, Several
from mechsim.subjects.load_text import varies
from mechsim.subjects.toml_keys import ROOT
from mechsim.subjects.toml_source import TomlSource
from mechsim.units import Unit, of_any_kind

# numbers of other kinds than these are in SI in a file, too
_OWN: tuple[Unit, ...] = ("m", "rad")
_SINES, _ANGLES, _SAME = ("sin", "cos", "tan"), ("asin", "acos", "atan", "atan2"), ("abs", "min", "max")


def parameter_units(document: Mapping[str, Any]) -> dict[str, Unit]:
    """Return which parameters are lengths or angles, as far as their use says: name -> "m" or "rad".

    Args:
        document: what a file holds; it need not be right.
    """
    given: dict[str, Any] = (
        document.get("parameters", {}) if isinstance(document.get("parameters"), dict) else {}
    )
    found = _Found(given)
    uses = list(_uses(ROOT, {key: one for key, one in document.items() if key != "parameters"}))
    own = {name: tree for name, text in given.items() if (tree := _tree(text)) is not None}
    for _ in range(len(given) + 1):
        before = dict(found.units)
        for tree, unit in uses:
            found.told(tree, unit)
        for name, tree in own.items():
            unit = found.units[name]
            if unit is not None:
                found.told(tree, unit)
            elif (made := found.of(tree)) in _OWN:
                found.units[name] = made
        if found.units == before:
            break
    return {name: unit for name, unit in found.units.items() if unit in _OWN}


def reckoned_from(document: Mapping[str, Any]) -> dict[str, frozenset[str]]:
    """Return of each parameter of a file those that it is reckoned from, directly or by others."""
    found: dict[str, frozenset[str]] = {}
    for name, text in document.get("parameters", {}).items():
        tree = _tree(text)
        read = {one.id for one in ast.walk(tree) if isinstance(one, ast.Name)} if tree else set[str]()
        # a parameter is reckoned from those before it
        found[name] = frozenset().union(*({one} | found[one] for one in read if one in found))
    return found


def require_kinds(source: TomlSource, given: Mapping[str, Any]) -> None:
    """Refuse a parameter with a unit that is no length, or no angle, where one stands alone in the file.

    Args:
        source: of the file.
        given: parameter -> what it is, in the file or by `--set`.

    Raises:
        InputError: names the parameter, its value and what the file makes of it.
    """
    rest = {key: one for key, one in source.document.items() if key != "parameters"}
    alone = {tree.id: unit for tree, unit in _uses(ROOT, rest) if isinstance(tree, ast.Name) and unit in _OWN}
    for name in alone.keys() & given.keys():
        if not is_quantity(given[name]):
            continue
        path = ("parameters", name)
        with source.about(path):
            unit = of_any_kind(given[name], f"parameter {name}")[1]
        if unit != alone[name]:
            what, example = ("a length", "13 mm") if alone[name] == "m" else ("an angle", "30 deg")
            why = f"is {shown(given[name])}, but the file uses it as {what}; give one such as {example!r}"
            raise source.refusal(path, why)


def _uses(key: Key, value: Any) -> Iterator[tuple[ast.expr, Unit]]:
    """Yield the expressions of a file, and what each measures."""
    match key:
        case Course() if varies(value):
            return
        case Number(unit=unit) | Course(unit=unit):
            tree = _tree(value)
            if tree is not None:
                yield tree, unit if unit in _OWN else "1"
        case Several(of=of) if isinstance(value, list):
            for one in value:
                yield from _uses(of, one)
        case Named(of=of) if isinstance(value, dict):
            for one in value.values():
                yield from _uses(of, one)
        case Keys(keys=keys) if isinstance(value, dict):
            for name, one in value.items():
                if name in keys:
                    yield from _uses(keys[name], one)
        case Choice(of=of):
            for one in of:
                yield from _uses(one, value)
        case _:
            return


def _tree(value: Any) -> ast.expr | None:
    """Return an expression; None for a plain number, a quantity, or what is none."""
    if not isinstance(value, str) or is_quantity(value):
        return None
    try:
        return parsed(value)
    except InputError:
        return None


class _Found:
    """What is known of the parameters, and how expressions tell more."""

    def __init__(self, names: Iterable[str]):
        self.units: dict[str, Unit | None] = dict.fromkeys(names)

    def told(self, node: ast.expr, unit: Unit) -> None:
        """Take in that an expression measures something."""
        match node:
            case ast.Name(id=name):
                if name in self.units and self.units[name] is None:
                    self.units[name] = unit
            case ast.UnaryOp(operand=operand):
                self.told(operand, unit)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                self.told(left, unit)
                self.told(right, unit)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                for one, other in ((left, right), (right, left)):
                    known = self.of(one)
                    if known in ("1", unit):
                        self.told(other, unit if known == "1" else "1")
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                below = self.of(right)
                if below == "1" or unit == "1":
                    self.told(left, unit if below == "1" else below or "1")
                if self.of(left) == unit:
                    self.told(right, "1")
            case ast.Call(func=ast.Name(id=name), args=args):
                inside: Unit | None = "rad" if name in _SINES else unit if name in _SAME else None
                for one in args if inside is not None else ():
                    self.told(one, inside or "1")
            case _:
                return

    def of(self, node: ast.expr) -> Unit | None:
        """Return what an expression measures; None where that is not known."""
        match node:
            case ast.Constant():
                return "1"
            case ast.Name(id=name):
                return self.units.get(name, "1")
            case ast.UnaryOp(operand=operand):
                return self.of(operand)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                first, second = self.of(left), self.of(right)
                return second if first in (None, "1") else first
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                both = self.of(left), self.of(right)
                return both[0] if both[1] == "1" else both[1] if both[0] == "1" else None
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                above, below = self.of(left), self.of(right)
                return above if below == "1" else "1" if above == below and above is not None else None
            case ast.Call(func=ast.Name(id=name), args=args):
                if name in _SAME:
                    return self.of(args[0]) if args else None
                return "rad" if name in _ANGLES else "1" if name in _SINES or not _names(node) else None
            case _:
                return None if _names(node) else "1"


def _names(node: ast.AST) -> bool:
    return any(
        isinstance(one, ast.Name) and one.id != "pi" for one in ast.walk(node) if not _is_function(node, one)
    )


def _is_function(whole: ast.AST, one: ast.AST) -> bool:
    return any(isinstance(call, ast.Call) and call.func is one for call in ast.walk(whole))
