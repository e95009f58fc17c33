"""Expressions of t, or of a crank's angle, with units: a value in SI and its exact first and second rates."""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim import units
from mechsim.analytic.vector_method.jets import Jet, Values
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.programs import State
from mechsim.subjects import jet_functions
from mechsim.subjects.expressions import Walker, parsed

# a number and then letters: a quantity in the midst of an expression; an exponent is part of its number
_NUMBER = r"(?<![\w.])((?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))"
_QUANTITY = re.compile(_NUMBER + r"\s*((?:[^\W\d_]|°)+)(?![\w(]|\s*\()")
# how a quantity is named in the tree
_PLACE = "quantity_{}_"
# what a quantity of each unit measures: powers of length, angle and force; time is counted in seconds
_POWERS: dict[str, tuple[float, float, float]] = {
    "m": (1.0, 0.0, 0.0),
    "rad": (0.0, 1.0, 0.0),
    "s": (0.0, 0.0, 0.0),
    "N": (0.0, 0.0, 1.0),
    "N m": (1.0, 0.0, 1.0),
}
_KINDS = {
    (0.0, 0.0, 0.0): "a plain number",
    (1.0, 0.0, 0.0): "a length",
    (0.0, 1.0, 0.0): "an angle",
    (0.0, 0.0, 1.0): "a force",
    (1.0, 0.0, 1.0): "a moment",
}
# what an expression may go over
VARIABLES = {"t": "the time in s", "angle": "the crank's in rad"}

_OF_ANGLES: dict[str, Callable[[Values], Values]] = {
    "sin": lambda x: np.sin(x),  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    "cos": lambda x: np.cos(x),  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    "tan": jet_functions.tan,
}
_TO_ANGLES: dict[str, Callable[..., Values]] = {
    "asin": jet_functions.asin,
    "acos": jet_functions.acos,
    "atan": jet_functions.atan,
    "atan2": jet_functions.atan2,
}


@dataclass(frozen=True, slots=True)
class Measure:
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
    def powers(self) -> tuple[float, float, float]:
        """Powers of length, angle and force."""
        return self.length, self.angle, self.force

    @property
    def plain(self) -> bool:
        """Whether it is a number without a unit."""
        return not any(self.powers)

    @property
    def kind(self) -> str:
        """What it measures, in words."""
        return _KINDS.get(self.powers, "neither a length, an angle, a force nor a moment")


@dataclass(frozen=True, slots=True)
class OverTime(Walker[Measure]):
    """What evaluates expressions of t, or of another variable.

    Attributes:
        time: t.
        variable: its name.
        names: parameter -> number, and the quantities of the expression.
    """

    time: Values
    variable: str = "t"
    names: Mapping[str, Measure] = field(default_factory=dict[str, Measure])

    def constant(self, value: float) -> Measure:
        return Measure(value)  # pyright: ignore[reportArgumentType]

    def named(self, name: str) -> Measure:
        if name == self.variable:
            return Measure(self.time)
        if name in self.names:
            return self.names[name]
        if name == "pi":
            return self.constant(math.pi)
        known = ", ".join([self.variable, "pi", *(one for one in self.names if not _is_place(one)), "units"])
        try:
            return quantity(f"1 {name}")
        except InputError:
            raise InputError(f"names {name!r}, which is nothing here; known are {known}") from None

    def signed(self, op: ast.unaryop, value: Measure) -> Measure:
        return replace(value, value=-value.value) if isinstance(op, ast.USub) else value

    def joined(self, op: ast.operator, left: Measure, right: Measure) -> Measure:
        match op:
            case ast.Mult() | ast.Div():
                sense = 1.0 if isinstance(op, ast.Mult) else -1.0
                made = operator.mul if sense > 0.0 else operator.truediv
                length, angle, force = (
                    one + sense * other for one, other in zip(left.powers, right.powers, strict=True)
                )
                mixed = left.mixed or right.mixed
                return Measure(made(left.value, right.value), length, _angle(angle), force, mixed)
            case ast.Pow():
                return _power(left, right)
            case _:
                made = operator.add if isinstance(op, ast.Add) else operator.sub
                return _alike(made(left.value, right.value), [left, right])

    def called(self, name: str, values: list[Measure], node: ast.Call) -> Measure:
        x = [one.value for one in values]
        if name in ("abs", "min", "max"):
            return _alike(
                jet_functions.absolute(x[0])
                if name == "abs"
                else jet_functions.least(x, 1.0 if name == "min" else -1.0),
                values,
            )
        if name == "sqrt":
            return _power(values[0], Measure(0.5))  # pyright: ignore[reportArgumentType]
        if name == "atan2":
            _alike(x[0], values)
        elif any(one.length or one.force for one in values):
            raise InputError(f"gives {name} {values[0].kind}; give it a plain number")
        if name in _OF_ANGLES:
            return Measure(_OF_ANGLES[name](x[0]))
        if name in _TO_ANGLES:
            return Measure(_TO_ANGLES[name](*x), angle=1.0)
        return Measure(np.exp(x[0]) if name == "exp" else jet_functions.log(x[0]))


def over_time(
    text: str,
    unit: str,
    *,
    bare: float = 1.0,
    names: Mapping[str, float] | None = None,
    variable: str = "t",
    declared: str = "",
) -> tuple[str, State]:
    """Return the program that an expression of t says, and the same in SI without parameters.

    Args:
        text: the expression; t is the time in s, sines take radians, and quantities have units.
        unit: of what it gives, "m" or "rad" of a coordinate, "N" or "N m" of a load.
        bare: what a result without a unit is counted in, in SI.
        names: parameter -> its number.
        variable: one of `VARIABLES`, in place of t.
        declared: unit in which a result without one was perhaps meant; it is rejected if that is not SI.

    Raises:
        InputError: for what is no expression of t, or measures something else; its sentence has no subject.
    """
    places: dict[str, Measure] = {}

    def placed(match: re.Match[str]) -> str:
        if match[2] == variable:
            raise InputError(f"holds {match[0]!r}; write {match[1]}*{variable}")
        name = _PLACE.format(len(places))
        places[name] = quantity(f"{match[1]} {match[2]}")
        return name

    given = {name: Measure(value) for name, value in (names or {}).items()}  # pyright: ignore[reportArgumentType]
    tree = parsed(_QUANTITY.sub(placed, text))

    def evaluated(time: Array) -> Measure:
        one, nought = np.ones_like(time), np.zeros_like(time)
        with np.errstate(all="ignore"):
            return OverTime(Jet(time, one, nought), variable, given | places).of(tree)

    try:
        probe = evaluated(np.ones(1))
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("has no value that is a finite real number") from None
    if not any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(tree)):
        raise InputError(f"holds no {variable}, {VARIABLES[variable]}")
    wanted = _POWERS[unit]
    # a length times an angle is a length
    alike = (probe.length, probe.force) == (wanted[0], wanted[2]) and (unit != "rad" or probe.angle == 1.0)
    if not (probe.plain or alike):
        raise InputError(f"is {probe.kind}; give {_KINDS[wanted]}")
    other = bool(declared) and units.in_si(1.0, declared, unit) != 1.0  # pyright: ignore[reportArgumentType]
    if probe.plain and other and not _is_zero(probe.value):
        raise InputError(f"has no unit, and the file is in {declared}; give it one")
    if probe.mixed and (bare != 1.0 or other):
        raise InputError("adds a number without a unit to a quantity; give it a unit")
    scale = bare if probe.plain else 1.0

    def state(time: Array) -> tuple[Array, Array, Array]:
        found = evaluated(time).value
        if not isinstance(found, Jet):
            return np.full_like(time, found), np.zeros_like(time), np.zeros_like(time)
        return scale * found.value, scale * found.rate, scale * found.second

    whole = text if scale == 1.0 else f"({text})*{scale:.17g}"
    for name, value in (names or {}).items():
        whole = re.sub(rf"(?<![\w.]){name}(?![\w(])", f"({value:.17g})", whole)
    return whole, state


def _is_zero(value: Values) -> bool:
    """Whether a value and its rates are zero, which needs no unit."""
    parts = (value.value, value.rate, value.second) if isinstance(value, Jet) else (value,)
    return not any(np.any(part) for part in parts)


def as_python(text: str) -> str:
    """Return an expression of t that `over_time` takes as Python has it, quantities in SI."""

    def number(match: re.Match[str]) -> str:
        return repr(float(quantity(f"{match[1]} {match[2]}").value))  # pyright: ignore[reportArgumentType]

    return _QUANTITY.sub(number, text)


def quantity(text: str) -> Measure:
    """Return a number with a unit of length, angle, force, moment or time, in SI."""
    if text.split()[-1] == "Hz":
        return Measure(float(text.split()[0]))  # pyright: ignore[reportArgumentType]
    value, unit = units.of_any_kind(text, "the quantity")
    powers = _POWERS.get(unit.removesuffix("/s"))
    if powers is None:
        raise InputError(f"holds {text!r}, which is neither a length, an angle, a force nor a time")
    return Measure(value, *powers)  # pyright: ignore[reportArgumentType]


def _alike(value: Values, of: list[Measure]) -> Measure:
    """Return a value made of quantities of one kind; those without a unit may stand among them."""
    dimensioned = [one for one in of if not one.plain]
    kinds = {one.powers for one in dimensioned}
    if len(kinds) > 1:
        raise InputError(f"puts {dimensioned[0].kind} and {dimensioned[1].kind} together; give both one kind")
    powers = kinds.pop() if kinds else (0.0, 0.0, 0.0)
    bare = [one for one in of if one.plain and not _is_zero(one.value)]
    mixed = any(one.mixed for one in of) or bool(dimensioned and bare)
    return Measure(value, *powers, mixed)


def _power(base: Measure, exponent: Measure) -> Measure:
    if not exponent.plain:
        raise InputError(f"has an exponent that is {exponent.kind}; give a plain number")
    if isinstance(exponent.value, Jet) and not base.plain:
        raise InputError(f"takes {base.kind} to a power that changes; give it a plain number")
    by = 0.0 if base.plain else float(exponent.value)  # pyright: ignore[reportArgumentType]
    value = jet_functions.power(base.value, exponent.value)
    return Measure(value, base.length * by, _angle(base.angle * by), base.force * by, base.mixed)


def _angle(power: float) -> float:
    """Return a power of angle, of which all but the first are plain numbers."""
    return power if power == 1.0 else 0.0


def _is_place(name: str) -> bool:
    return name.startswith(_PLACE.partition("{")[0])
