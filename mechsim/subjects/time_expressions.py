"""Expressions of t, or of a crank's angle, with units: a value in SI and its exact first and second rates."""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim import units
from mechsim.analytic.vector_method.jets import Jet, Values, composed
from mechsim.errors import InputError
from mechsim.model.expressions import ExpressionEvaluator, parse_expression, require_exponent
from mechsim.model.motion_laws import State
from mechsim.numerics.arrays import Array


def power(base: Values, exponent: Values) -> Values:
    """Return base ** exponent; of a constant exponent also where the base is not above zero."""
    if isinstance(exponent, Jet):
        return np.exp(exponent * log(base))  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    n = float(exponent)
    require_exponent(n)
    if not isinstance(base, Jet):
        return math.pow(float(base), n)  # pyright: ignore[reportReturnType]
    x = base.value
    first = n * x ** (n - 1.0) if n else np.zeros_like(x)
    second = n * (n - 1.0) * x ** (n - 2.0) if n * (n - 1.0) else np.zeros_like(x)
    return composed(base, x**n, first, second)


def log(x: Values) -> Values:
    """Return the natural logarithm."""
    if not isinstance(x, Jet):
        return np.log(x)
    return composed(x, np.log(x.value), 1.0 / x.value, -1.0 / x.value**2)


def tan(x: Values) -> Values:
    """Return the tangent of angles in [rad]."""
    if not isinstance(x, Jet):
        return np.tan(x)
    value = np.tan(x.value)
    derivative = 1.0 + value**2
    return composed(x, value, derivative, 2.0 * value * derivative)


def asin(x: Values) -> Values:
    """Return the angle of a sine in [rad]."""
    if not isinstance(x, Jet):
        return np.arcsin(x)
    derivative = 1.0 / np.sqrt(1.0 - x.value**2)
    return composed(x, np.arcsin(x.value), derivative, x.value * derivative**3)


def acos(x: Values) -> Values:
    """Return the angle of a cosine in [rad]."""
    return 0.5 * np.pi - asin(x)  # pyright: ignore[reportOperatorIssue]


def atan(x: Values) -> Values:
    """Return the angle of a tangent in [rad]."""
    if not isinstance(x, Jet):
        return np.arctan(x)
    derivative = 1.0 / (1.0 + x.value**2)
    return composed(x, np.arctan(x.value), derivative, -2.0 * x.value * derivative**2)


def atan2(y: Values, x: Values) -> Values:
    """Return the angle of a direction in [rad]."""
    if not isinstance(y, Jet) and not isinstance(x, Jet):
        return np.arctan2(y, x)
    return np.arctan2(_jet(y, x), _jet(x, y))  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]


def absolute(x: Values) -> Values:
    """Return the value without its sign."""
    return x * np.sign(x.value) if isinstance(x, Jet) else np.abs(x)


def minimum(values: list[Values], sign: float = 1.0) -> Values:
    """Return the least of some values at each instant; with sense -1 the largest."""
    result = values[0]
    for other in values[1:]:
        if not isinstance(result, Jet) and not isinstance(other, Jet):
            result = np.minimum(result, other) if sign > 0.0 else np.maximum(result, other)
            continue
        current, candidate = _jet(result, other), _jet(other, result)
        first = sign * (current.value - candidate.value) <= 0.0
        fields = [
            np.where(first, getattr(current, field), getattr(candidate, field)) for field in Jet.__slots__
        ]
        result = Jet(**dict(zip(Jet.__slots__, fields, strict=True)))
    return result


def _jet(x: Values, like: Values) -> Jet:
    """Return a jet, of what is none one that does not change."""
    if isinstance(x, Jet):
        return x
    if not isinstance(like, Jet):
        raise InputError("holds no t; write an expression of t in s")
    still: Array = np.zeros_like(like.value)
    return Jet(still + x, still, still)


# a number and then letters: a quantity in the midst of an expression; an exponent is part of its number
_NUMBER = r"(?<![\w.])((?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))"
_QUANTITY = re.compile(_NUMBER + r"\s*((?:[^\W\d_]|°)+)(?![\w(]|\s*\()")
# how a quantity is named in the tree
_PLACEHOLDER = "quantity_{}_"
# what a quantity of each unit measures: powers of length, angle and force; time is counted in seconds
_EXPONENTS: dict[str, tuple[float, float, float]] = {
    "m": (1.0, 0.0, 0.0),
    "rad": (0.0, 1.0, 0.0),
    "s": (0.0, 0.0, 0.0),
    "N": (0.0, 0.0, 1.0),
    "N m": (1.0, 0.0, 1.0),
}
_DESCRIPTIONS = {
    (0.0, 0.0, 0.0): "a plain number",
    (1.0, 0.0, 0.0): "a length",
    (0.0, 1.0, 0.0): "an angle",
    (0.0, 0.0, 1.0): "a force",
    (1.0, 0.0, 1.0): "a moment",
}
# what an expression may go over
VARIABLES = {"t": "the time in s", "angle": "the crank's in rad"}

_TRIGONOMETRIC: dict[str, Callable[[Values], Values]] = {
    "sin": lambda x: np.sin(x),  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    "cos": lambda x: np.cos(x),  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    "tan": tan,
}
_INVERSE_TRIGONOMETRIC: dict[str, Callable[..., Values]] = {
    "asin": asin,
    "acos": acos,
    "atan": atan,
    "atan2": atan2,
}


@dataclass(frozen=True, slots=True)
class DimensionedValue:
    """A value with its rates, and what it measures.

    Attributes:
        value: a jet, or a number that does not change.
        length: power of length.
        angle: power of angle.
        force: power of force.
        mixed: whether numbers without a unit were added to it, which are then in SI.
    """

    value: Values
    length: float = 0.0
    angle: float = 0.0
    force: float = 0.0
    mixed: bool = False

    @property
    def exponents(self) -> tuple[float, float, float]:
        """Powers of length, angle and force."""
        return self.length, self.angle, self.force

    @property
    def dimensionless(self) -> bool:
        """Whether it is a number without a unit."""
        return not any(self.exponents)

    @property
    def description(self) -> str:
        """What it measures, in words."""
        return _DESCRIPTIONS.get(self.exponents, "neither a length, an angle, a force nor a moment")


@dataclass(frozen=True, slots=True)
class TimeEvaluator(ExpressionEvaluator[DimensionedValue]):
    """What evaluates expressions of t, or of another variable.

    Attributes:
        time: t.
        variable: its name.
        names: parameter -> number, and the quantities of the expression.
    """

    time: Values
    variable: str = "t"
    names: Mapping[str, DimensionedValue] = field(default_factory=dict[str, DimensionedValue])

    def constant(self, value: float) -> DimensionedValue:
        return DimensionedValue(value)  # pyright: ignore[reportArgumentType]

    def name_value(self, name: str) -> DimensionedValue:
        if name == self.variable:
            return DimensionedValue(self.time)
        if name in self.names:
            return self.names[name]
        if name == "pi":
            return self.constant(math.pi)
        names = ", ".join(
            [self.variable, "pi", *(name_ for name_ in self.names if not _is_placeholder(name_)), "units"]
        )
        try:
            return quantity(f"1 {name}")
        except InputError:
            raise InputError(f"names {name!r}, which is nothing here; known are {names}") from None

    def negate(self, op: ast.unaryop, value: DimensionedValue) -> DimensionedValue:
        return replace(value, value=-value.value) if isinstance(op, ast.USub) else value

    def combine(self, op: ast.operator, left: DimensionedValue, right: DimensionedValue) -> DimensionedValue:
        match op:
            case ast.Mult() | ast.Div():
                sign = 1.0 if isinstance(op, ast.Mult) else -1.0
                operation = operator.mul if sign > 0.0 else operator.truediv
                length, angle, force = (
                    exponent + sign * other
                    for exponent, other in zip(left.exponents, right.exponents, strict=True)
                )
                mixed = left.mixed or right.mixed
                return DimensionedValue(
                    operation(left.value, right.value), length, _angle(angle), force, mixed
                )
            case ast.Pow():
                return _power(left, right)
            case _:
                operation = operator.add if isinstance(op, ast.Add) else operator.sub
                return _of_one_dimension(operation(left.value, right.value), [left, right])

    def call(self, name: str, values: list[DimensionedValue], node: ast.Call) -> DimensionedValue:
        x = [argument.value for argument in values]
        if name in ("abs", "min", "max"):
            return _of_one_dimension(
                absolute(x[0]) if name == "abs" else minimum(x, 1.0 if name == "min" else -1.0),
                values,
            )
        if name == "sqrt":
            return _power(values[0], DimensionedValue(0.5))  # pyright: ignore[reportArgumentType]
        if name == "atan2":
            _of_one_dimension(x[0], values)
        elif any(argument.length or argument.force for argument in values):
            raise InputError(f"gives {name} {values[0].description}; give it a plain number")
        if name in _TRIGONOMETRIC:
            return DimensionedValue(_TRIGONOMETRIC[name](x[0]))
        if name in _INVERSE_TRIGONOMETRIC:
            return DimensionedValue(_INVERSE_TRIGONOMETRIC[name](*x), angle=1.0)
        return DimensionedValue(np.exp(x[0]) if name == "exp" else log(x[0]))


def time_function(
    text: str,
    unit: str,
    *,
    default_unit: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    variable: str = "t",
    declared: str = "",
) -> tuple[str, State]:
    """Return the program that an expression of t says, and the same in SI without parameters.

    Args:
        text: the expression; t is the time in s, sines take radians, and quantities have units.
        unit: of what it gives, "m" or "rad" of a coordinate, "N" or "N m" of a load.
        default_unit: what a result without a unit is counted in, in SI.
        parameters: parameter -> its number.
        variable: one of `VARIABLES`, in place of t.
        declared: unit in which a result without one was perhaps meant; it is rejected if that is not SI.

    Raises:
        InputError: for what is no expression of t, or measures something else; its sentence has no subject.
    """
    quantities: dict[str, DimensionedValue] = {}

    def placeholder(match: re.Match[str]) -> str:
        if match[2] == variable:
            raise InputError(f"holds {match[0]!r}; write {match[1]}*{variable}")
        name = _PLACEHOLDER.format(len(quantities))
        quantities[name] = quantity(f"{match[1]} {match[2]}")
        return name

    known_quantities = {name: DimensionedValue(value) for name, value in (parameters or {}).items()}  # pyright: ignore[reportArgumentType]
    tree = parse_expression(_QUANTITY.sub(placeholder, text))

    def evaluate(time: Array) -> DimensionedValue:
        unit_rate, zero = np.ones_like(time), np.zeros_like(time)
        with np.errstate(all="ignore"):
            return TimeEvaluator(
                Jet(time, unit_rate, zero), variable, known_quantities | quantities
            ).evaluate(tree)

    try:
        probe = evaluate(np.ones(1))
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("has no value that is a finite real number") from None
    if not any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(tree)):
        raise InputError(f"holds no {variable}, {VARIABLES[variable]}")
    exponents = _EXPONENTS[unit]
    # a length times an angle is a length
    fits = (probe.length, probe.force) == exponents[::2] and (unit != "rad" or probe.angle == 1.0)
    if not (probe.dimensionless or fits):
        raise InputError(f"is {probe.description}; give {_DESCRIPTIONS[exponents]}")
    needs_unit = bool(declared) and units.in_si(1.0, declared, unit) != 1.0  # pyright: ignore[reportArgumentType]
    if probe.dimensionless and needs_unit and not _is_zero(probe.value):
        raise InputError(f"has no unit, and the file is in {declared}; give it one")
    if probe.mixed and (default_unit != 1.0 or needs_unit):
        raise InputError("adds a number without a unit to a quantity; give it a unit")
    scale = default_unit if probe.dimensionless else 1.0

    def state(time: Array) -> tuple[Array, Array, Array]:
        result = evaluate(time).value
        if not isinstance(result, Jet):
            return np.full_like(time, result), np.zeros_like(time), np.zeros_like(time)
        return scale * result.value, scale * result.rate, scale * result.second

    si_text = text if scale == 1.0 else f"({text})*{scale:.17g}"
    for name, value in (parameters or {}).items():
        si_text = re.sub(rf"(?<![\w.]){name}(?![\w(])", f"({value:.17g})", si_text)
    return si_text, state


def _is_zero(value: Values) -> bool:
    """Whether a value and its rates are zero, which needs no unit."""
    derivatives = (value.value, value.rate, value.second) if isinstance(value, Jet) else (value,)
    return not any(np.any(derivative) for derivative in derivatives)


def python_expression(text: str) -> str:
    """Return an expression of t that `over_time` takes as Python has it, quantities in SI."""

    def number(match: re.Match[str]) -> str:
        return repr(float(quantity(f"{match[1]} {match[2]}").value))  # pyright: ignore[reportArgumentType]

    return _QUANTITY.sub(number, text)


def quantity(text: str) -> DimensionedValue:
    """Return a number with a unit of length, angle, force, moment or time, in SI."""
    if text.split()[-1] == "Hz":
        return DimensionedValue(float(text.split()[0]))  # pyright: ignore[reportArgumentType]
    value, unit = units.of_any_kind(text, "the quantity")
    powers = _EXPONENTS.get(unit.removesuffix("/s"))
    if powers is None:
        raise InputError(f"holds {text!r}, which is neither a length, an angle, a force nor a time")
    return DimensionedValue(value, *powers)  # pyright: ignore[reportArgumentType]


def _of_one_dimension(value: Values, operands: list[DimensionedValue]) -> DimensionedValue:
    """Return a value made of quantities of one kind; those without a unit may stand among them."""
    dimensioned = [operand for operand in operands if not operand.dimensionless]
    kinds = {operand.exponents for operand in dimensioned}
    if len(kinds) > 1:
        raise InputError(
            f"puts {dimensioned[0].description} and {dimensioned[1].description} together; give both one kind"
        )
    powers = kinds.pop() if kinds else (0.0, 0.0, 0.0)
    bare = [operand for operand in operands if operand.dimensionless and not _is_zero(operand.value)]
    mixed = any(operand.mixed for operand in operands) or bool(dimensioned and bare)
    return DimensionedValue(value, *powers, mixed)


def _power(base: DimensionedValue, exponent: DimensionedValue) -> DimensionedValue:
    if not exponent.dimensionless:
        raise InputError(f"has an exponent that is {exponent.description}; give a plain number")
    if isinstance(exponent.value, Jet) and not base.dimensionless:
        raise InputError(f"takes {base.description} to a power that changes; give it a plain number")
    factor = 0.0 if base.dimensionless else float(exponent.value)  # pyright: ignore[reportArgumentType]
    value = power(base.value, exponent.value)
    return DimensionedValue(
        value, base.length * factor, _angle(base.angle * factor), base.force * factor, base.mixed
    )


def _angle(power: float) -> float:
    """Return a power of angle, of which all but the first are plain numbers."""
    return power if power == 1.0 else 0.0


def _is_placeholder(name: str) -> bool:
    return name.startswith(_PLACEHOLDER.partition("{")[0])
