"""Points and axes of joints as formulas of a mechanism's dimensions, for code with variable dimensions.

The expressions of a TOML file are translated. The points of any other mechanism change in proportion to its
dimensions, as to positions. Both are compared with designs in Python; dimensions with wrong formulas are
omitted.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mechsim.errors import MechsimError
from mechsim.io.file_expressions import FileExpressions, expressions_of, parameter_name
from mechsim.io.toml_values import is_quantity
from mechsim.kinematics.designs import DesignFamily, Dimension
from mechsim.mechanism.design_arrays import side_numbers, structure
from mechsim.mechanism.expressions import FUNCTIONS, evaluate_number, instructions_of, parse_expression
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.units import Unit, parse

# vectors of a joint side; a tracked point has only "at"
QUANTITIES = ("at", "axis", "reference")
# rounding error of a formula, for numbers relative to the mechanism's length
ROUNDING = 1e-12
# changes of a dimension at which formulas are compared with designs: relative, or for a dimension of zero in
# [rad] or characteristic lengths
CHANGES = (0.013, -0.017)


@dataclass(frozen=True)
class Formula:
    """A number as a function of the dimensions.

    Attributes:
        javascript: expression of `d["NAME"]` in SI and `p["NAME"]` in units of the file.
        value: the formula as a Python function of dimensions in SI.
        toml: its expression in a TOML file, of parameters as `parameter_name`, or its number.
    """

    javascript: str
    value: Callable[[Mapping[str, float]], float]
    toml: str | float


Vectors = Mapping[tuple[str, str], tuple[Formula, Formula, Formula]]


@dataclass(frozen=True)
class ParametricGeometry:
    """The geometry of a mechanism as a function of its dimensions.

    Attributes:
        dimensions: the variable dimensions.
        statements: JavaScript that computes the parameters `p` of a file from dimensions `d`.
        vectors: (JOINT.a, JOINT.b or point, quantity) -> components, for variable vectors only.
        constants: parameter -> its number in the file's unit, of those in the vectors that do not vary.
    """

    dimensions: tuple[Dimension, ...]
    statements: tuple[str, ...]
    vectors: Vectors
    constants: Mapping[str, float] = field(default_factory=dict[str, float])


def parametric_geometry(model: Any, designs: DesignFamily) -> ParametricGeometry:
    """Return points and axes as functions of the independent dimensions.

    Args:
        model: the opened model.
        designs: its parametric model.
    """
    names = [*(designs.usual or designs.dimensions)]
    nominal = designs.describe({})
    file = expressions_of(model, designs, {})
    statements: tuple[str, ...] = ()
    vectors = (
        proportional_vectors(designs, names, nominal) if file is None else translated_vectors(file, names)
    )
    holding = [designs.dimensions[name] for name in names if _holds(designs, nominal, vectors, name)]
    every = [formula for formulas in vectors.values() for formula in formulas]
    kept = tuple(dimension for dimension in holding if _varies(designs, [dimension], every))
    changing = {key: formulas for key, formulas in vectors.items() if _varies(designs, kept, formulas)}
    constants: dict[str, float] = {}
    if file is not None:
        varying = [dimension.name for dimension in kept]
        statements = _statements(file, designs, varying)
        texts = " ".join(str(formula.toml) for formulas in changing.values() for formula in formulas)
        still = {*re.findall(r"[^\W\d]\w*", texts)} - {parameter_name(name) for name in varying}
        constants = {name: value for name, value in file.values.parameters.items() if name in still}
    return ParametricGeometry(kept, statements, changing, constants)


def _varies(designs: DesignFamily, kept: Sequence[Dimension], formulas: Sequence[Formula]) -> bool:
    values = designs.values()
    changed = [{**values, each.name: _changed(each, CHANGES[0], designs)} for each in kept]
    return any(formula.value(other) != formula.value(values) for other in changed for formula in formulas)


def _changed(dimension: Dimension, change: float, designs: DesignFamily) -> float:
    if abs(dimension.value) > 1e-9:
        return dimension.value * (1.0 + change)
    return change * (designs.describe({}).characteristic_length if dimension.unit == "m" else 1.0)


def _holds(designs: DesignFamily, nominal: Mechanism, vectors: Vectors, name: str) -> bool:
    """Return whether formulas reproduce the designs of a dimension, which changes only points and axes."""
    for change in CHANGES:
        value = _changed(designs.dimensions[name], change, designs)
        try:
            design = designs.describe({name: value})
            formed = _formed(nominal, vectors, {**designs.values(), name: value})
        except (MechsimError, ArithmeticError, ValueError):
            return False
        if (structure(design), design.links) != (structure(nominal), nominal.links):
            return False
        if not all(
            np.abs(formed[key] - numbers).max() <= ROUNDING
            for key, numbers in _scaled(design, nominal.characteristic_length).items()
        ):
            return False
    return True


def _formed(nominal: Mechanism, vectors: Vectors, values: Mapping[str, float]) -> dict[str, Array]:
    """Return points, axes and references from formulas, in the form of `_scaled`."""
    length, sides = nominal.characteristic_length, dict[str, Array]()
    for joint in nominal.joints:
        for side, end in (("a", joint.a), ("b", joint.b)):
            key = f"{joint.name}.{side}"
            point, axis, reference = (_evaluated(vectors, key, quantity, values) for quantity in QUANTITIES)
            if reference is None and not (axis and not end.has_reference):
                reference = end.reference
            formed = End(end.link, point or end.point, axis or end.axis, reference)
            sides[key] = np.array([formed.point, formed.axis, formed.reference])
    points = {
        name: np.array(_evaluated(vectors, name, "at", values) or local)
        for name, (_, local) in nominal.points.items()
    }
    return _relative(sides, points, length)


def _evaluated(vectors: Vectors, key: str, quantity: str, values: Mapping[str, float]) -> Any:
    formulas = vectors.get((key, quantity))
    return None if formulas is None else vector([formula.value(values) for formula in formulas])


def _scaled(mechanism: Mechanism, length: float) -> dict[str, Array]:
    """Return the numbers of all joint sides and points, with lengths relative to `length`."""
    points = {name: np.array(local) for name, (_, local) in mechanism.points.items()}
    return _relative(side_numbers(mechanism), points, length)


def _relative(sides: Mapping[str, Array], points: Mapping[str, Array], length: float) -> dict[str, Array]:
    units = np.array([[length], [1.0], [1.0]])
    scaled = {key: numbers / units for key, numbers in sides.items()}
    return scaled | {name: point / length for name, point in points.items()}


# --- expressions of a TOML file


def _statements(file: FileExpressions, designs: DesignFamily, varying: Sequence[str]) -> tuple[str, ...]:
    """Return JavaScript that computes the parameters of a file from the variable dimensions."""
    angle, moving = file.values.in_si(1.0, "rad"), {parameter_name(name): name for name in varying}
    lines: list[str] = []
    for name, text in file.parameters.items():
        if name in moving:
            value = f"d[{moving[name]!r}] / {file.values.in_si(1.0, file.units[name])!r}"
        elif designs.derived.get(name):
            value = _javascript(text, angle)
        else:
            value = repr(float(file.values.parameters[name]))
        lines.append(f"p[{name!r}] = {value};")
    return tuple(lines)


def translated_vectors(file: FileExpressions, names: Sequence[str]) -> Vectors:
    """Return the formulas of a file's points and axes, as functions of dimensions."""
    values, angle = file.values, file.values.in_si(1.0, "rad")
    moving = {parameter_name(name): name for name in names}

    def parameters(si: Mapping[str, float]) -> dict[str, float]:
        numbers: dict[str, float] = {}
        for name, text in file.parameters.items():
            if name in moving:
                numbers[name] = si[moving[name]] / values.in_si(1.0, file.units[name])
            else:
                is_text = isinstance(text, str)
                numbers[name] = evaluate_number(text, numbers.__getitem__, angle) if is_text else float(text)
        return numbers

    def formula(value: Any, unit: Unit) -> Formula:
        scale = values.in_si(1.0, unit)
        if isinstance(value, str) and not is_quantity(value):
            text = f"{_javascript(value, angle)} * {scale!r}"
            return Formula(
                text, lambda si: scale * evaluate_number(value, parameters(si).__getitem__, angle), value
            )
        number = parse(value, unit, "") if isinstance(value, str) else scale * float(value)
        return Formula(repr(number), lambda _: number, number)

    return {
        key: (formula(entry[0], unit), formula(entry[1], unit), formula(entry[2], unit))
        for key, entry, unit in _entries(file.document)
    }


def _entries(document: Mapping[str, Any]) -> list[tuple[tuple[str, str], Any, Unit]]:
    """Return the vectors in a file: (owner, quantity), components, unit."""
    owners = {f"{name}.{side}": joint[side] for name, joint in document["joints"].items() for side in "ab"}
    owners |= document.get("points", {})
    return [
        ((owner, key), value, "m" if key == "at" else "1")
        for owner, entry in owners.items()
        for key, value in entry.items()
        if key in QUANTITIES
    ]


_SYMBOLS = {"Add": "+", "Sub": "-", "Mult": "*", "Div": "/"}


def _javascript(expression: str, angle: float) -> str:
    """Return an expression of parameters in JavaScript; `angle` is the unit of its angles in [rad]."""
    stack: list[str] = []
    for name, value, operands in instructions_of(parse_expression(expression), {}):
        split = len(stack) - operands
        arguments, unit = stack[split:], FUNCTIONS[name].unit if name in FUNCTIONS else ""
        if not operands:
            text = repr(value) if name == "number" else f"p[{value!r}]"
        elif name == "Neg":
            text = f"(-{arguments[0]})"
        elif name in _SYMBOLS:
            text = f"({arguments[0]} {_SYMBOLS[name]} {arguments[1]})"
        elif unit == "angle":
            text = f"Math.{name}({arguments[0]} * {angle!r})"
        else:
            scale = f" / {angle!r}" if unit in ("inverse", "ratio") else ""
            text = f"(Math.{name.lower()}({', '.join(arguments)}){scale})"
        stack[split:] = [text]
    return stack[0]


# --- other mechanisms


def proportional_vectors(designs: DesignFamily, names: Sequence[str], nominal: Mechanism) -> Vectors:
    """Return formulas of the points that change in proportion to dimensions."""
    start, step = _scaled(nominal, 1.0), 2.0 ** np.ceil(np.log2(nominal.characteristic_length))
    values, rates = designs.values(), dict[str, dict[str, Array]]()
    for name in names:
        try:
            moved = _scaled(designs.describe({name: values[name] + step}), 1.0)
        except (MechsimError, ArithmeticError, ValueError):
            continue
        for key, numbers in moved.items():
            # the first row of a joint side is its point
            rate = np.atleast_2d(numbers - start[key])[0] / step
            if rate.any():
                rates.setdefault(key, {})[name] = np.where(
                    np.abs(rate - np.round(rate)) < ROUNDING, np.round(rate), rate
                )
    return {
        (key, "at"): _sums(np.atleast_2d(start[key])[0], own, {name: values[name] for name in own})
        for key, own in rates.items()
    }


def _sums(
    point: Array, rates: Mapping[str, Array], values: Mapping[str, float]
) -> tuple[Formula, Formula, Formula]:
    """Return the components of a point as sums of dimensions, from the point and its rates at values."""

    def component(i: int) -> Formula:
        factors = {name: float(rate[i]) for name, rate in rates.items() if rate[i]}
        constant = float(point[i] - sum(factor * values[name] for name, factor in factors.items()))
        text = " + ".join([repr(constant), *(f"{factor!r} * {{{name}}}" for name, factor in factors.items())])
        return Formula(
            re.sub(r"\{(.*?)\}", lambda name: f"d[{name[1]!r}]", text),
            lambda si: constant + sum(factor * si[name] for name, factor in factors.items()),
            re.sub(r"\{(.*?)\}", lambda name: parameter_name(name[1]), text),
        )

    return component(0), component(1), component(2)
