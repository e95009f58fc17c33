"""Expressions in text: one grammar and evaluator for parameters, motion laws, loads, controllers, quantities.

Values are numbers, arrays (n,), arrays with complex steps, or jets with two derivatives.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError, several
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, angle_of, jet_where

Powers = tuple[float, ...]
DIMENSIONLESS: Powers = (0.0, 0.0, 0.0, 0.0)

# base units of a derived unit: powers of kg, m, s and rad
_POWERS: dict[str, Powers] = {
    "1": (0, 0, 0, 0),
    "kg": (1, 0, 0, 0),
    "m": (0, 1, 0, 0),
    "s": (0, 0, 1, 0),
    "rad": (0, 0, 0, 1),
    "N": (1, 1, -2, 0),
    "J": (1, 2, -2, 0),
    "W": (1, 2, -3, 0),
}
_NAMED = ("1", "m", "rad", "m/s", "rad/s", "m/s2", "rad/s2", "N", "N m", "W", "kg m2", "kg", "s")
_DESCRIPTIONS = {"1": "a plain number", "m": "a length", "rad": "an angle", "N": "a force", "N m": "a moment"}


def unit_powers(unit: str) -> Powers:
    """Return the powers of kg, m, s and rad in a unit such as "N m" or "m/s2"."""
    total = np.zeros(4)
    above, _, below = unit.partition("/")
    for sign, side in ((1.0, above), (-1.0, below)):
        for factor in side.split():
            match = re.fullmatch(r"([A-Za-z1]+?)(-?\d*)", factor)
            assert match is not None
            total += sign * float(match[2] or 1) * np.array(_POWERS[match[1]])
    return tuple(total.tolist())


def unit_text(powers: Sequence[float]) -> str:
    """Return the unit with these powers of kg, m, s and rad, by its usual name if it has one."""
    if powers[0]:
        # torque times angle is work: drop rad
        powers = (*powers[:3], 0.0)
    named = {unit_powers(unit): unit for unit in reversed(_NAMED)}
    factors = [
        f"{base}{power:g}" if power != 1.0 else base
        for base, power in zip(("kg", "m", "s", "rad"), powers, strict=True)
        if power
    ]
    return named.get(tuple(powers), " ".join(factors))


def without_time(powers: Sequence[float]) -> Powers:
    """Return the powers of a unit in an expression of t, where the time counts as a plain number."""
    mass, length, _, angle = powers
    return (mass, length, 0.0, angle)


def described(powers: Sequence[float]) -> str:
    """Return in words what a value with these powers of kg, m, s and rad measures."""
    for unit, description in _DESCRIPTIONS.items():
        if tuple(powers) in (unit_powers(unit), without_time(unit_powers(unit))):
            return description
    return f"a value in {unit_text(powers)}"


# largest number of characters of an expression, and of nested brackets
MAX_CHARACTERS, MAX_DEPTH = 500, 50
# largest exponent; larger ones are typing errors
MAX_EXPONENT = 64.0


# what was added to a quantity with a unit although it has none
Mixed = Literal["", "number", "variable"]


@dataclass(frozen=True, slots=True)
class Term:
    """A value in an expression.

    Attributes:
        value: number, array or jet.
        powers: powers of kg, m, s and rad in its unit.
        without_unit: kind of addend without a unit that was added to a quantity with one; it counts in SI.
    """

    value: Any
    powers: Powers = DIMENSIONLESS
    without_unit: Mixed = ""

    @property
    def dimensionless(self) -> bool:
        """Whether the value has no unit."""
        return not any(self.powers)

    @property
    def description(self) -> str:
        """What the value measures, in words."""
        return described(self.powers)

    @property
    def zero(self) -> bool:
        """Whether the value and its derivatives are zero; a zero needs no unit."""
        return _is_zero(self.value)


@dataclass(frozen=True, slots=True)
class Function:
    """A function that expressions may call.

    Attributes:
        value: the function of its arguments.
        count: number of arguments; None allows one or more.
        unit: "number" takes and returns plain numbers; "angle" takes angles; "inverse" returns an angle;
            "same" returns the unit of its arguments; "ratio" takes arguments of one unit and returns an
            angle.
    """

    value: Callable[..., Any]
    count: int | None = 1
    unit: Literal["number", "angle", "inverse", "same", "ratio"] = "number"


def _extreme(sign: float, *values: Any) -> Any:
    result = values[0]
    for other in values[1:]:
        result = _chosen(sign * _real(result) <= sign * _real(other), result, other)
    return result


def _absolute(value: Any) -> Any:
    return _chosen(_real(value) < 0.0, -value, value)


def _arctan2(y: Any, x: Any) -> Any:
    if isinstance(y, Jet) or isinstance(x, Jet):
        direction: tuple[Any, Any] = _jet(y, x), _jet(x, y)
        return np.arctan2(*direction)
    return angle_of(y, x)


def _is_zero(value: Any) -> bool:
    if isinstance(value, Jet):
        return all(_is_zero(entry) for entry in (value.value, value.rate, value.second))
    return not np.any(value)


def _real(value: Any) -> Any:
    return _real(value.value) if isinstance(value, Jet) else np.real(value)


def _chosen(which: Any, first: Any, second: Any) -> Any:
    if isinstance(first, Jet) or isinstance(second, Jet):
        return jet_where(which, _jet(first, second), _jet(second, first))
    return np.where(which, first, second)


def _jet(value: Any, like: Any) -> Jet:
    """Return a value as a jet; a constant gets the shape of `like`."""
    return value if isinstance(value, Jet) else like * 0.0 + value


FUNCTIONS: dict[str, Function] = {
    "sin": Function(np.sin, unit="angle"),
    "cos": Function(np.cos, unit="angle"),
    "tan": Function(np.tan, unit="angle"),
    "asin": Function(np.arcsin, unit="inverse"),
    "acos": Function(np.arccos, unit="inverse"),
    "atan": Function(np.arctan, unit="inverse"),
    "atan2": Function(_arctan2, 2, "ratio"),
    "sqrt": Function(np.sqrt),
    "exp": Function(np.exp),
    "log": Function(np.log),
    "abs": Function(_absolute, unit="same"),
    "min": Function(lambda *values: _extreme(1.0, *values), None, "same"),
    "max": Function(lambda *values: _extreme(-1.0, *values), None, "same"),
}
_ALLOWED = f"write it with + - * / ** ( ), pi, {', '.join(FUNCTIONS)}"


@lru_cache  # of the same file with other parameters
def parse_expression(text: str) -> ast.expr:
    """Return the syntax tree of an expression.

    Raises:
        InputError: for text that is no expression or too long; the caller puts the subject before the
            message.
    """
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"has {len(text)} characters; write {MAX_CHARACTERS} at most")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(f"is no expression; {_ALLOWED}") from None


@dataclass(frozen=True, slots=True)
class Evaluator:
    """Evaluates the syntax tree of an expression.

    Attributes:
        names: name -> value; raises InputError for an unknown name.
        angle: unit of angles in [rad] that sin takes and atan returns.
    """

    names: Callable[[str], Term]
    angle: float = 1.0

    def evaluate(self, node: ast.AST, depth: int = 0) -> Term:
        """Return the value of an expression.

        Raises:
            InputError: for a node that is no arithmetic or nests too deep; the caller puts the subject before
                the message.
            ArithmeticError, ValueError: where the expression has no value.
        """
        if depth > MAX_DEPTH:
            raise InputError(f"nests more than {MAX_DEPTH} deep; make it simpler, or use a parameter")
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return Term(float(value))
            case ast.Name(id="pi"):
                return Term(math.pi)
            case ast.Name(id=name):
                return self.names(name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.evaluate(operand, depth + 1)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                term = self.evaluate(operand, depth + 1)
                return replace(term, value=-term.value)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                rule, combine = _OPERATORS[type(op)]
                return rule(combine, self.evaluate(left, depth + 1), self.evaluate(right, depth + 1))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
                return self._call(name, args, depth + 1)
            case _:
                raise InputError(f"contains {ast.unparse(node)!r}; only arithmetic is allowed: {_ALLOWED}")

    def _call(self, name: str, arguments: Sequence[ast.AST], depth: int) -> Term:
        function = FUNCTIONS.get(name)
        if function is None:
            raise InputError(f"calls {name!r}, which is no known function; {_ALLOWED}")
        terms = [self.evaluate(argument, depth) for argument in arguments]
        if len(terms) != function.count and (function.count is not None or not terms):
            raise InputError(
                f"gives {name} {several(len(terms), 'number')}; give {function.count or '1 or more'}"
            )
        if function.unit in ("same", "ratio"):
            shared = _of_shared_unit(terms)
            value = _plain(function.value(*(term.value for term in terms)))
            return replace(shared, value=value) if function.unit == "same" else self._angle(value)
        (term,) = terms
        if name == "sqrt":
            return Term(_plain(np.sqrt(term.value)), tuple(0.5 * power for power in term.powers))
        if any(term.powers[:3]):
            raise InputError(f"gives {name} {term.description}; give it a plain number")
        if function.unit == "angle" and self.angle != 1.0:
            nodes = (node for argument in arguments for node in ast.walk(argument))
            if any(isinstance(node, ast.Name) and node.id == "pi" for node in nodes):
                raise InputError(
                    f"gives {name} an argument with pi, but angles in this file are in degrees: "
                    "write 45, not pi/4"
                )
            term = Term(term.value * self.angle)
        value = _plain(function.value(term.value))
        return self._angle(value) if function.unit == "inverse" else Term(value)

    def _angle(self, value: Any) -> Term:
        """Return an angle in [rad] in the evaluator's unit of angles."""
        return Term(value, _RADIAN) if self.angle == 1.0 else Term(value / self.angle)


_RADIAN: Powers = (0.0, 0.0, 0.0, 1.0)
Combine = Callable[[Any, Any], Any]


def _plain(value: Any) -> Any:
    """Return a NumPy scalar as a float."""
    return float(value) if not isinstance(value, Jet) and np.ndim(value) == 0 else value


def _of_shared_unit(terms: Sequence[Term]) -> Term:
    """Return the first term with the common unit of all terms; terms without a unit count in SI."""
    with_unit = [term for term in terms if not term.dimensionless]
    for term in with_unit[1:]:
        if term.powers != with_unit[0].powers:
            raise InputError(
                f"puts {with_unit[0].description} and {term.description} together; give both one unit"
            )
    powers = with_unit[0].powers if with_unit else DIMENSIONLESS
    added = [*terms, *map(_added, terms)] if with_unit else terms
    return replace(terms[0], powers=powers, without_unit=_mixed(added))


def _added(term: Term) -> Term:
    """Return a term as an addend of a quantity with a unit."""
    if not term.dimensionless or term.zero:
        return term
    varies = isinstance(term.value, Jet) or np.ndim(term.value) > 0
    return replace(term, without_unit="variable" if varies else "number")


def _mixed(terms: Sequence[Term]) -> Mixed:
    kinds = {term.without_unit for term in terms}
    return "variable" if "variable" in kinds else "number" if "number" in kinds else ""


def _sum(combine: Combine, first: Term, second: Term) -> Term:
    """Return the sum or the difference of two terms."""
    return replace(_of_shared_unit([first, second]), value=combine(first.value, second.value))


def _product(combine: Combine, first: Term, second: Term) -> Term:
    """Return the product or the quotient of two terms."""
    sign = -1.0 if combine is operator.truediv else 1.0
    powers = tuple(a + sign * b for a, b in zip(first.powers, second.powers, strict=True))
    return Term(combine(first.value, second.value), powers, _mixed([first, second]))


def _power(combine: Combine, base: Term, exponent: Term) -> Term:
    if not exponent.dimensionless:
        raise InputError(f"has an exponent that is {exponent.description}; give a plain number")
    constant = isinstance(exponent.value, float)
    if constant and not abs(exponent.value) <= MAX_EXPONENT:
        raise InputError(f"has an exponent of {exponent.value:g}; give {MAX_EXPONENT:g} at most")
    if not constant and not base.dimensionless:
        raise InputError(f"takes {base.description} to a power that changes; give it a plain number")
    if constant and isinstance(base.value, float):
        value = math.pow(base.value, exponent.value)
    else:
        value = combine(base.value, exponent.value)
    factor = exponent.value if constant else 0.0
    return Term(value, tuple(power * factor for power in base.powers), base.without_unit)


# operator -> its rule of units, and its function of values
_OPERATORS: dict[type[ast.AST], tuple[Callable[[Combine, Term, Term], Term], Combine]] = {
    ast.Add: (_sum, operator.add),
    ast.Sub: (_sum, operator.sub),
    ast.Mult: (_product, operator.mul),
    ast.Div: (_product, operator.truediv),
    ast.Pow: (_power, operator.pow),
}


def evaluate_number(text: str, names: Callable[[str], float], angle: float = 1.0) -> float:
    """Return the number to which an expression of numbers evaluates.

    Args:
        text: the expression.
        names: name -> number; raises InputError for an unknown name.
        angle: unit of angles in [rad] that sin takes and atan returns.

    Raises:
        InputError: for text that is no expression, is too long, or has no finite value; the caller puts the
            subject before the message.
    """
    try:
        with np.errstate(all="raise", under="ignore"):
            tree = parse_expression(text)
            result = float(Evaluator(lambda name: Term(float(names(name))), angle).evaluate(tree).value)
    except InputError:
        raise
    except ZeroDivisionError:
        raise InputError("divides by zero; change a parameter") from None
    except (ArithmeticError, ValueError):
        result = math.nan
    if not math.isfinite(result):
        raise InputError("has no value that is a finite real number; change a parameter")
    return result


class Instruction(NamedTuple):
    """A step of an expression's evaluation on a stack of values.

    Attributes:
        name: "number", "variable", "Neg", an operator of `ast`, or a function.
        value: the number, the variable's name, or the function of the last values of the stack.
        operands: number of these values, which the result replaces.
    """

    name: str
    value: Any
    operands: int = 0


@dataclass(frozen=True)
class Table:
    """A piecewise polynomial as the value of an instruction "table".

    Attributes:
        spline: a `PPoly` of scipy, of one number.
        beyond: what it has beyond its ends: it repeats, is undefined, or continues its last polynomials.
        advance: added times the position.
    """

    spline: Any
    beyond: Literal["repeated", "undefined", "continued"]
    advance: float = 0.0

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation."""
        return Instruction("variable", "x"), Instruction("table", self, 1)


def _instructions(node: ast.AST) -> Iterator[Instruction]:
    """Yield the evaluation of an expression that `Evaluator` accepts, operands first."""
    match node:
        case ast.Constant(value=value):
            yield Instruction("number", float(cast(float, value)))
        case ast.Name(id=name):
            yield Instruction("number", math.pi) if name == "pi" else Instruction("variable", name)
        case ast.UnaryOp(op=op, operand=operand):
            yield from _instructions(operand)
            if isinstance(op, ast.USub):
                yield Instruction("Neg", operator.neg, 1)
        case ast.BinOp(left=left, op=op, right=right):
            yield from (*_instructions(left), *_instructions(right))
            yield Instruction(type(op).__name__, _OPERATORS[type(op)][1], 2)
        case ast.Call(func=ast.Name(id=name), args=args):
            for argument in args:
                yield from _instructions(argument)
            yield Instruction(name, FUNCTIONS[name].value, len(args))
        case _:
            raise InputError(f"contains {ast.unparse(node)!r}; only arithmetic is allowed: {_ALLOWED}")


def instructions_of(tree: ast.AST, numbers: Mapping[str, float]) -> tuple[Instruction, ...]:
    """Return the evaluation of an expression that `Evaluator` accepts; numbers take the place of names."""
    return with_numbers(_instructions(tree), numbers)


def with_numbers(
    instructions: Iterable[Instruction], numbers: Mapping[str, float]
) -> tuple[Instruction, ...]:
    """Return an evaluation in which numbers take the place of names."""
    return tuple(
        Instruction("number", numbers[each.value])
        if each.name == "variable" and each.value in numbers
        else each
        for each in instructions
    )


@dataclass(frozen=True, slots=True)
class Expression:
    """An expression of named arrays, such as a controller of states and time.

    Attributes:
        text: the expression; all names in SI, angles in [rad].
        names: names of its variables.
        instructions: its evaluation.
    """

    text: str
    names: tuple[str, ...]
    instructions: tuple[Instruction, ...]

    def __call__(self, values: Mapping[str, ArrayLike]) -> Array:
        """Return the values (n,) at variables name -> (n,); not finite where the expression has no value."""
        arrays = {name: np.asarray(values[name], dtype=np.float64) for name in self.names}
        return np.asarray(self._evaluate(arrays), dtype=np.float64)

    def derivatives(self, values: Mapping[str, ArrayLike]) -> tuple[Array, dict[str, Array]]:
        """Return the values (n,) and their exact derivatives by each variable, (n,) each."""
        columns = [np.asarray(values[name], dtype=np.float64) for name in self.names]
        arrays = dict(zip(self.names, np.broadcast_arrays(*columns), strict=True))
        by_name: dict[str, Array] = {}
        for name, array in arrays.items():
            jet = Jet(array, np.ones_like(array), np.zeros_like(array))
            result = self._evaluate({**arrays, name: jet})
            by_name[name] = result.rate if isinstance(result, Jet) else np.zeros_like(array)
        return self(values), by_name

    def stepped(self, values: Mapping[str, Any], count: int) -> Any:
        """Return the values (count,) at variables name -> (count,), with complex steps by derivatives."""
        real = {name: np.real(value) for name, value in values.items()}
        if not any(np.iscomplexobj(value) for value in values.values()):
            return np.broadcast_to(self(real), (count,))
        result, derivatives = self.derivatives(real)
        return result + 1j * sum(change * np.imag(values[name]) for name, change in derivatives.items())

    def jet(self, values: Mapping[str, Any]) -> Jet:
        """Return the value and its derivatives along jets of variables, name -> jet or number."""
        result = self._evaluate(values)
        return result if isinstance(result, Jet) else Jet(result, 0.0, 0.0)

    def _evaluate(self, values: Mapping[str, Any]) -> Any:
        stack: list[Any] = []
        with np.errstate(all="ignore"):
            for name, value, operands in self.instructions:
                if operands:
                    stack[-operands:] = [value(*stack[-operands:])]
                else:
                    stack.append(value if name == "number" else values[value])
        return stack[0]


def compiled(text: str, names: Iterable[str]) -> Expression:
    """Return an expression of named variables after checking it.

    Args:
        text: the expression.
        names: variables it may use, besides pi and the functions.

    Raises:
        InputError: for text that is no expression or uses another name; the caller puts the subject before
            the message.
    """
    allowed, tree = tuple(names), parse_expression(text)
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    used = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and id(node) not in called]
    for name in used:
        if name not in (*allowed, "pi"):
            raise InputError(
                f"names {name!r}, which is not defined; choose from {', '.join((*allowed, 'pi'))}"
            )
    try:
        with np.errstate(all="ignore"):
            Evaluator(lambda name: Term(np.full(1, 0.5))).evaluate(tree)
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("has no value that is a finite real number") from None
    names = tuple(dict.fromkeys(name for name in used if name != "pi"))
    return Expression(text, names, instructions_of(tree, {}))


# possible variables of an expression
VARIABLES = {"t": "the time in s", "angle": "the crank's in rad", "l": "the length", "v": "its rate"}
_VARIABLE = re.compile(rf"(?<![\w.])({'|'.join(VARIABLES)})(?!\w)")


def variables(text: str) -> list[str]:
    """Return the variables in a text: t, angle."""
    return sorted(set(_VARIABLE.findall(text)))
