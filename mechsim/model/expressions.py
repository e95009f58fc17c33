"""Arithmetic in text: numbers, names of parameters and the usual functions, bounded in size."""

import ast
import difflib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from mechsim.errors import InputError

# characters of an expression, and how deep its brackets may nest
MAX_CHARACTERS, MAX_DEPTH = 500, 50
# largest exponent; a larger one is taken for an error
MAX_EXPONENT = 64.0

Value = TypeVar("Value")

_OPERATORS: dict[type[ast.AST], Callable[[float, float], float]] = {
    ast.Add: lambda x, y: x + y,
    ast.Sub: lambda x, y: x - y,
    ast.Mult: lambda x, y: x * y,
    ast.Div: lambda x, y: x / y,
    ast.Pow: lambda x, y: _power(x, y),
}
# name -> function and how many numbers it takes; None is one or more
_PLAIN: dict[str, tuple[Callable[..., float], int | None]] = {
    "sqrt": (math.sqrt, 1),
    "exp": (math.exp, 1),
    "log": (math.log, 1),
    "abs": (math.fabs, 1),
    "min": (lambda *x: min(x), None),
    "max": (lambda *x: max(x), None),
}
_TRIGONOMETRIC: dict[str, Callable[[float], float]] = {"sin": math.sin, "cos": math.cos, "tan": math.tan}
_INVERSE_TRIGONOMETRIC: dict[str, tuple[Callable[..., float], int]] = {
    "asin": (math.asin, 1),
    "acos": (math.acos, 1),
    "atan": (math.atan, 1),
    "atan2": (math.atan2, 2),
}
FUNCTIONS = (*_TRIGONOMETRIC, *_INVERSE_TRIGONOMETRIC, *_PLAIN)
_ALLOWED = f"known are + - * / ** ( ), pi and {', '.join(FUNCTIONS)}"


class ExpressionEvaluator(ABC, Generic[Value]):
    """What goes through an expression, bounded in size, and reckons with values of some kind."""

    @abstractmethod
    def constant(self, value: float) -> Value:
        """Return the value of a number."""

    @abstractmethod
    def name_value(self, name: str) -> Value:
        """Return the value of a name."""

    @abstractmethod
    def negate(self, op: ast.unaryop, value: Value) -> Value:
        """Return plus or minus a value."""

    @abstractmethod
    def combine(self, op: ast.operator, left: Value, right: Value) -> Value:
        """Return what + - * / or ** makes of two values."""

    @abstractmethod
    def call(self, name: str, values: list[Value], node: ast.Call) -> Value:
        """Return what a function makes of so many values as it takes."""

    def evaluate(self, node: ast.AST, depth: int = 0) -> Value:
        """Return the value of an expression.

        Raises:
            InputError: for what is no arithmetic or nests too deep; its sentence has no subject.
        """
        if depth > MAX_DEPTH:
            raise InputError(f"nests more than {MAX_DEPTH} deep; make it simpler, or use a parameter")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return self.constant(float(value))
            case ast.Name(id=name):
                return self.name_value(name)
            case ast.UnaryOp(op=ast.UAdd() | ast.USub() as op, operand=operand):
                return self.negate(op, self.evaluate(operand, depth + 1))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self.combine(op, self.evaluate(left, depth + 1), self.evaluate(right, depth + 1))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                if name not in FUNCTIONS:
                    raise InputError(f"calls {name!r}, which is no function here; {_ALLOWED}")
                values = [self.evaluate(argument, depth + 1) for argument in args]
                count = 1 if name in _TRIGONOMETRIC else {**_INVERSE_TRIGONOMETRIC, **_PLAIN}[name][1]
                if len(values) != count and (count is not None or not values):
                    raise InputError(f"gives {name} {len(values)} numbers; give {count or '1 or more'}")
                return self.call(name, values, node)
            case _:
                raise InputError(f"holds {ast.unparse(node)!r}, which is no arithmetic; {_ALLOWED}")


def parse_expression(text: str) -> ast.expr:
    """Return the tree of an expression.

    Raises:
        InputError: for what is no expression or is too long; its sentence has no subject.
    """
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"has {len(text)} characters; write {MAX_CHARACTERS} at most")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(f"is no expression; {_ALLOWED}") from None


@dataclass(frozen=True, slots=True)
class NumberEvaluator(ExpressionEvaluator[float]):
    """What evaluates expressions: the numbers known by name, and the unit of angles.

    Attributes:
        names: parameter -> value.
        angle: the unit of angles, as sin takes and atan gives them, in [rad].
    """

    names: Mapping[str, float]
    angle: float = 1.0

    def value(self, text: str) -> float:
        """Return the value of an expression.

        Raises:
            InputError: for what is no expression, is too large, or has no finite value; its sentence has
                no subject, which the caller knows.
        """
        tree = parse_expression(text)
        try:
            result = self.evaluate(tree)
        except ZeroDivisionError:
            raise InputError("divides by zero; change a parameter") from None
        except (ValueError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError("has no value that is a finite real number; change a parameter") from None
        if not math.isfinite(result):
            raise InputError("has no value that is a finite real number; change a parameter")
        return result

    def constant(self, value: float) -> float:
        return value

    def negate(self, op: ast.unaryop, value: float) -> float:
        return -value if isinstance(op, ast.USub) else value

    def combine(self, op: ast.operator, left: float, right: float) -> float:
        return _OPERATORS[type(op)](left, right)

    def name_value(self, name: str) -> float:
        if name in self.names:
            return self.names[name]
        if name == "pi":
            return math.pi
        close = difflib.get_close_matches(name, self.names, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        listed = ", ".join(self.names) or "none"
        raise InputError(f"names {name!r}, which is no parameter given before{hint}; known are {listed}")

    def call(self, name: str, values: list[float], node: ast.Call) -> float:
        if name in _TRIGONOMETRIC:
            if self.angle != 1.0 and any(_has_pi(argument) for argument in node.args):
                raise InputError(
                    f"gives {name} a part of pi, but the file's angles are not in rad; write 45 for 45 deg"
                )
            return _TRIGONOMETRIC[name](values[0] * self.angle)
        if name in _INVERSE_TRIGONOMETRIC:
            return _INVERSE_TRIGONOMETRIC[name][0](*values) / self.angle
        return _PLAIN[name][0](*values)


def _power(base: float, exponent: float) -> float:
    require_exponent(exponent)
    return math.pow(base, exponent)


def require_exponent(exponent: float) -> None:
    """Reject an exponent that is too large."""
    if not abs(exponent) <= MAX_EXPONENT:
        raise InputError(f"has an exponent of {exponent:g}; give {MAX_EXPONENT:g} at most")


def _has_pi(node: ast.AST) -> bool:
    return any(isinstance(child, ast.Name) and child.id == "pi" for child in ast.walk(node))
