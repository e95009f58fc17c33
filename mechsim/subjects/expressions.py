"""Arithmetic in text: numbers, names of parameters and the usual functions, bounded in size."""

import ast
import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mechsim.errors import InputError

# characters of an expression, and how deep its brackets may nest
LONGEST, DEEPEST = 500, 50
# beyond this an exponent is a slip
LARGEST_EXPONENT = 64.0

_SIGNS: dict[type[ast.AST], Callable[[float], float]] = {ast.UAdd: lambda x: x, ast.USub: lambda x: -x}
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
    "abs": (math.fabs, 1),
    "min": (lambda *x: min(x), None),
    "max": (lambda *x: max(x), None),
}
_OF_ANGLES: dict[str, Callable[[float], float]] = {"sin": math.sin, "cos": math.cos, "tan": math.tan}
_TO_ANGLES: dict[str, tuple[Callable[..., float], int]] = {
    "asin": (math.asin, 1),
    "acos": (math.acos, 1),
    "atan": (math.atan, 1),
    "atan2": (math.atan2, 2),
}
FUNCTIONS = (*_OF_ANGLES, *_TO_ANGLES, *_PLAIN)
KNOWN = f"known are + - * / ** ( ), pi and {', '.join(FUNCTIONS)}"


@dataclass(frozen=True, slots=True)
class Expressions:
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
        if len(text) > LONGEST:
            raise InputError(f"has {len(text)} characters; write {LONGEST} at most")
        try:
            tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise InputError(f"is no expression; {KNOWN}") from None
        try:
            found = self._of(tree, 0)
        except ZeroDivisionError:
            raise InputError("divides by zero; change a parameter") from None
        except (ValueError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError("has no value that is a finite real number; change a parameter") from None
        if not math.isfinite(found):
            raise InputError("has no value that is a finite real number; change a parameter")
        return found

    def _of(self, node: ast.AST, depth: int) -> float:
        if depth > DEEPEST:
            raise InputError(f"nests more than {DEEPEST} deep; make it simpler, or use a parameter")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return float(value)
            case ast.Name(id=name):
                return self._named(name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _SIGNS:
                return _SIGNS[type(op)](self._of(operand, depth + 1))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](self._of(left, depth + 1), self._of(right, depth + 1))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._called(name, args, depth)
            case _:
                raise InputError(f"holds {ast.unparse(node)!r}, which is no arithmetic; {KNOWN}")

    def _named(self, name: str) -> float:
        if name in self.names:
            return self.names[name]
        if name == "pi":
            return math.pi
        close = difflib.get_close_matches(name, self.names, n=1)
        meant = f"; did you mean {close[0]!r}?" if close else ""
        listed = ", ".join(self.names) or "none"
        raise InputError(f"names {name!r}, which is no parameter given before{meant}; known are {listed}")

    def _called(self, name: str, args: list[ast.expr], depth: int) -> float:
        if name not in FUNCTIONS:
            raise InputError(f"calls {name!r}, which is no function here; {KNOWN}")
        if name in _OF_ANGLES and self.angle != 1.0 and any(_has_pi(one) for one in args):
            raise InputError(
                f"gives {name} a part of pi, but the file's angles are not in rad; write 45 for 45 deg"
            )
        values = [self._of(one, depth + 1) for one in args]
        wanted = 1 if name in _OF_ANGLES else {**_TO_ANGLES, **_PLAIN}[name][1]
        if len(values) != wanted and (wanted is not None or not values):
            raise InputError(f"gives {name} {len(values)} numbers; give {wanted or '1 or more'}")
        if name in _OF_ANGLES:
            return _OF_ANGLES[name](values[0] * self.angle)
        if name in _TO_ANGLES:
            return _TO_ANGLES[name][0](*values) / self.angle
        return _PLAIN[name][0](*values)


def _power(base: float, exponent: float) -> float:
    if not abs(exponent) <= LARGEST_EXPONENT:
        raise InputError(f"has an exponent of {exponent:g}; give {LARGEST_EXPONENT:g} at most")
    return math.pow(base, exponent)


def _has_pi(node: ast.AST) -> bool:
    return any(isinstance(one, ast.Name) and one.id == "pi" for one in ast.walk(node))
