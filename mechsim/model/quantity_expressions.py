"""Arithmetic of quantities with units: values that may carry complex steps, and powers of the base units."""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.model.expressions import ExpressionEvaluator, require_exponent
from mechsim.numerics.complex_step import size_of, turn_of

# base units of a derived unit: powers of kg, m, s and rad
_POWERS: dict[str, tuple[float, ...]] = {
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


def unit_powers(unit: str) -> tuple[float, ...]:
    """Return the powers of kg, m, s and rad in a unit as "N m" or "m/s2"."""
    total = np.zeros(4)
    above, _, below = unit.partition("/")
    for sign, side in ((1.0, above), (-1.0, below)):
        for factor in side.split():
            match = re.fullmatch(r"([A-Za-z1]+?)(-?\d*)", factor)
            assert match is not None
            total += sign * float(match[2] or 1) * np.array(_POWERS[match[1]])
    return tuple(total.tolist())


def unit_text(powers: Sequence[float]) -> str:
    """Return the unit of powers of kg, m, s and rad, by its usual name where it has one."""
    if powers[0]:
        # torque times angle is work
        powers = (*powers[:3], 0.0)
    named = {unit_powers(unit): unit for unit in reversed(_NAMED)}
    factors = [
        f"{base}{power:g}" if power != 1.0 else base
        for base, power in zip(("kg", "m", "s", "rad"), powers, strict=True)
        if power
    ]
    return named.get(tuple(powers), " ".join(factors))


@dataclass(frozen=True, slots=True)
class Term:
    """A value in an expression, and the powers of kg, m, s and rad in its unit."""

    value: Any
    powers: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": turn_of,
    "exp": np.exp,
    "log": np.log,
    "abs": size_of,
    "min": lambda *x: _extreme(x, 1.0),
    "max": lambda *x: _extreme(x, -1.0),
}
_SAME_UNIT = ("abs", "min", "max", "atan2")


def _extreme(values: Sequence[Any], sign: float) -> Any:
    result = values[0]
    for other in values[1:]:
        result = np.where(sign * np.real(result) <= sign * np.real(other), result, other)
    return result


@dataclass(frozen=True, slots=True)
class QuantityEvaluator(ExpressionEvaluator[Term]):
    """Evaluates an expression of quantities with units.

    Attributes:
        names: name in the tree -> its value.
    """

    names: Mapping[str, Term]

    def constant(self, value: float) -> Term:
        return Term(value)

    def name_value(self, name: str) -> Term:
        return Term(np.pi) if name == "pi" else self.names[name]

    def negate(self, op: ast.unaryop, value: Term) -> Term:
        return replace(value, value=-value.value) if isinstance(op, ast.USub) else value

    def combine(self, op: ast.operator, left: Term, right: Term) -> Term:
        match op:
            case ast.Mult():
                return Term(left.value * right.value, _sum(left.powers, right.powers))
            case ast.Div():
                return Term(left.value / right.value, _sum(left.powers, right.powers, -1.0))
            case ast.Pow():
                return self._power(left, right)
            case _:
                sign = 1.0 if isinstance(op, ast.Add) else -1.0
                return Term(left.value + sign * right.value, _common([left, right]))

    def _power(self, base: Term, exponent: Term) -> Term:
        if any(exponent.powers) or np.ndim(exponent.value):
            raise InputError("has an exponent that is no number; give a number")
        require_exponent(exponent.value)
        return Term(base.value**exponent.value, tuple(power * exponent.value for power in base.powers))

    def call(self, name: str, values: list[Term], node: ast.Call) -> Term:
        if name == "sqrt":
            return self._power(Term(values[0].value + 0.0, values[0].powers), Term(0.5))
        result = _FUNCTIONS[name](*(term.value for term in values))
        if name in _SAME_UNIT:
            powers = _common(values)
            return Term(result, (0.0, 0.0, 0.0, 1.0) if name == "atan2" else powers)
        if any(values[0].powers[:3]):
            raise InputError(f"gives {name} a value in {unit_text(values[0].powers)}; give it a plain number")
        return Term(result, (0.0, 0.0, 0.0, float(name.startswith("a"))))


def _sum(first: Sequence[float], second: Sequence[float], sign: float = 1.0) -> tuple[float, ...]:
    return tuple(a + sign * b for a, b in zip(first, second, strict=True))


def _common(terms: Sequence[Term]) -> tuple[float, ...]:
    """Return the powers that terms share; plain numbers count in SI."""
    powers = {term.powers for term in terms if np.ndim(term.value) or any(term.powers)}
    if len(powers) > 1:
        units = sorted(unit_text(each) for each in powers)
        raise InputError(f"puts {units[0]} and {units[1]} together; give both one unit")
    return powers.pop() if powers else (0.0, 0.0, 0.0, 0.0)
