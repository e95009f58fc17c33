"""Expressions of time or crank angle with units: value in SI and two exact derivatives."""

import ast
import re
from collections.abc import Iterable, Mapping

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.model.expressions import Evaluator, Term, described, parse_expression, unit_powers, without_time
from mechsim.model.motion_laws import State
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet

# a number followed by letters, a quantity within an expression; an exponent belongs to the number
_NUMBER = r"(?<![\w.])((?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))"
_QUANTITY = re.compile(_NUMBER + r"\s*((?:[^\W\d_]|°)+)(?![\w(]|\s*\()")
# name of a quantity in the syntax tree
_PLACEHOLDER = "quantity_{}_"
# units allowed in an expression
_UNITS = ("m", "rad", "s", "N", "N m")
# possible variables of an expression
VARIABLES = {"t": "the time in s", "angle": "the crank's in rad"}


def time_function(
    text: str,
    unit: str,
    *,
    default_unit: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    variable: str = "t",
    declared: str = "",
) -> tuple[str, State]:
    """Return the text in SI without parameters, and the motion law of an expression of t.

    Args:
        text: the expression; t is the time in s, sines take radians, and quantities have units.
        unit: unit of its value: "m" or "rad" of a coordinate, "N" or "N m" of a load.
        default_unit: unit of a result without a unit, in SI.
        parameters: parameter -> its number.
        variable: one of `VARIABLES`, instead of t.
        declared: unit of the file, in which a result without a unit could be meant; an error unless it is SI.

    Raises:
        InputError: for text that is no expression of t, or has another unit; the caller puts the subject
            before the message.
    """
    quantities: dict[str, Term] = {}

    def placeholder(match: re.Match[str]) -> str:
        if match[2] == variable:
            raise InputError(f"holds {match[0]!r}; write {match[1]}*{variable}")
        name = _PLACEHOLDER.format(len(quantities))
        quantities[name] = quantity(f"{match[1]} {match[2]}")
        return name

    tree = parse_expression(_QUANTITY.sub(placeholder, text))
    numbers = {name: Term(value) for name, value in (parameters or {}).items()}

    def evaluate(time: Array) -> Term:
        zero = 0.0 * time
        terms = {variable: Term(Jet(time, 1.0 + zero, zero)), **numbers, **quantities}

        def name_value(name: str) -> Term:
            return terms[name] if name in terms else _unit(name, (variable, "pi", *numbers, "units"))

        with np.errstate(all="ignore"):
            return Evaluator(name_value).evaluate(tree)

    try:
        probe = evaluate(np.ones(1))
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("has no value that is a finite real number") from None
    if not any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(tree)):
        raise InputError(f"contains no {variable}, {VARIABLES[variable]}")
    _require_unit(probe, unit, default_unit, declared)
    scale = default_unit if probe.dimensionless else 1.0

    def state(time: Array) -> tuple[Array, Array, Array]:
        result = evaluate(time).value
        if not isinstance(result, Jet):
            return result + 0.0 * time, 0.0 * time, 0.0 * time
        return scale * result.value, scale * result.rate, scale * result.second

    si_text = text if scale == 1.0 else f"({text})*{scale:.17g}"
    for name, value in (parameters or {}).items():
        si_text = re.sub(rf"(?<![\w.]){name}(?![\w(])", f"({value:.17g})", si_text)
    return si_text, state


def _require_unit(probe: Term, unit: str, default_unit: float, declared: str) -> None:
    """Raise InputError for a value with a wrong or ambiguous unit."""
    expected = without_time(unit_powers(unit))
    # a length times an angle is a length
    fits = probe.powers[:3] == expected[:3] and (unit != "rad" or probe.powers == expected)
    if not (probe.dimensionless or fits):
        raise InputError(f"is {probe.description}; give {described(expected)}")
    needs_unit = bool(declared) and units.in_si(1.0, declared, unit) != 1.0  # pyright: ignore[reportArgumentType]
    if probe.dimensionless and needs_unit and not probe.zero:
        raise InputError(f"has no unit, and the file is in {declared}; give it one")
    if probe.without_unit and (default_unit != 1.0 or needs_unit):
        raise InputError("adds a number without a unit to a quantity; give it a unit")


def _unit(name: str, names: Iterable[str]) -> Term:
    """Return the quantity that the name of a unit stands for."""
    try:
        return quantity(f"1 {name}")
    except InputError:
        raise InputError(f"names {name!r}, which is not defined; choose from {', '.join(names)}") from None


def python_expression(text: str) -> str:
    """Return an expression of t in Python, with quantities in SI."""

    def number(match: re.Match[str]) -> str:
        return repr(float(quantity(f"{match[1]} {match[2]}").value))

    return _QUANTITY.sub(number, text)


def quantity(text: str) -> Term:
    """Return a number with a unit of length, angle, force, moment or time, in SI; time is a plain number."""
    if text.split()[-1] == "Hz":
        return Term(float(text.split()[0]))
    value, unit = units.of_any_kind(text, "the quantity")
    if unit.removesuffix("/s") not in _UNITS:
        raise InputError(f"contains {text!r}, which is neither a length, an angle, a force nor a time")
    return Term(value, without_time(unit_powers(unit)))
