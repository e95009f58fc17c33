"""Points and axes of joints as formulas of a mechanism's dimensions, for code with variable dimensions.

The expressions of a TOML file are translated. The numbers of any other mechanism are sums of products of
lengths, sines and cosines of angles, with coefficients fitted on a grid of designs. Both are compared with
designs in Python; dimensions with wrong formulas are omitted.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from mechsim.analytic.designs import DesignFamily, Dimension
from mechsim.errors import MechsimError
from mechsim.model.design_arrays import side_numbers, structure
from mechsim.model.expressions import evaluate_number, parse_expression
from mechsim.model.joints import End
from mechsim.model.links import vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.subjects.toml_reader import TomlModel
from mechsim.subjects.toml_values import is_quantity, values_of
from mechsim.units import Unit, parse

# vectors of a joint side; a tracked point has only "at"
QUANTITIES = ("at", "axis", "reference")
# rounding error of a formula, for numbers relative to the mechanism's length
ROUNDING = 1e-12
# maximum number of dimensions in one number: the grid has up to 3 to this power designs
MAX_SHARED = 4
# changes of a dimension at which formulas are compared with designs: relative, or for a dimension of zero in
# [rad] or characteristic lengths
CHANGES = (0.013, -0.017)


@dataclass(frozen=True)
class Formula:
    """A number as a function of the dimensions.

    Attributes:
        javascript: expression of `d["NAME"]` in SI and `p["NAME"]` in units of the file.
        value: the formula as a Python function of dimensions in SI.
    """

    javascript: str
    value: Callable[[Mapping[str, float]], float]

    @property
    def toml(self) -> str:
        """A formula from `fitted_vectors` as an expression of a TOML file; parameters as `parameter_name`."""
        text = re.sub(r"d\['([^']*)'\]", lambda match: parameter_name(match[1]), self.javascript)
        return re.sub(r"(?<![\d.])1\.0 \* ", "", text.replace("Math.", "")).replace("+ -", "- ")


def parameter_name(dimension: str) -> str:
    """Return the name of a dimension as that of a parameter, which has no dots."""
    return dimension.replace(".", "_")


Vectors = Mapping[tuple[str, str], tuple[Formula, Formula, Formula]]


@dataclass(frozen=True)
class ParametricGeometry:
    """The geometry of a mechanism as a function of its dimensions.

    Attributes:
        dimensions: the variable dimensions.
        statements: JavaScript that computes the parameters `p` of a file from dimensions `d`.
        vectors: (JOINT.a, JOINT.b or point, quantity) -> components, for variable vectors only.
    """

    dimensions: tuple[Dimension, ...]
    statements: tuple[str, ...]
    vectors: Vectors


def parametric_geometry(model: Any, designs: DesignFamily) -> ParametricGeometry:
    """Return points and axes as functions of the independent dimensions.

    Args:
        model: the opened model.
        designs: its parametric model.
    """
    names = [*(designs.usual or designs.dimensions)]
    nominal = designs.describe({})
    source = model if isinstance(model, TomlModel) and _from_parameters(model, designs) else None
    statements: tuple[str, ...] = ()
    vectors = (
        fitted_vectors(designs, names, nominal) if source is None else _translated(source, designs, names)
    )
    holding = [designs.dimensions[name] for name in names if _holds(designs, nominal, vectors, name)]
    every = [formula for formulas in vectors.values() for formula in formulas]
    kept = tuple(dimension for dimension in holding if _varies(designs, [dimension], every))
    changing = {key: formulas for key, formulas in vectors.items() if _varies(designs, kept, formulas)}
    if source is not None:
        statements = _statements(source, designs, [dimension.name for dimension in kept])
    return ParametricGeometry(kept, statements, changing)


def _from_parameters(model: TomlModel, designs: DesignFamily) -> bool:
    """Return whether the dimensions of the designs are the parameters of the file."""
    return {*designs.dimensions} == {*model.source.document.get("parameters", {})}


def _varies(designs: DesignFamily, kept: Sequence[Dimension], formulas: Sequence[Formula]) -> bool:
    values = designs.values()
    return any(
        formula.value({**values, dimension.name: _changed(dimension, CHANGES[0], designs)})
        != formula.value(values)
        for dimension in kept
        for formula in formulas
    )


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
        length = nominal.characteristic_length
        if not all(
            np.abs(formed[key] - numbers).max() <= ROUNDING
            for key, numbers in _scaled(design, length).items()
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
    return {key: numbers / units for key, numbers in sides.items()} | {
        name: point / length for name, point in points.items()
    }


# --- expressions of a TOML file


def _scales(model: TomlModel, designs: DesignFamily) -> dict[str, float]:
    """Return the SI value of one unit of each parameter of a file."""
    values = values_of(model.source)
    return {
        name: values.in_si(1.0, "m" if dimension.unit == "m" else "rad" if dimension.unit == "rad" else "1")
        for name, dimension in designs.dimensions.items()
    }


def _statements(model: TomlModel, designs: DesignFamily, varying: Sequence[str]) -> tuple[str, ...]:
    """Return JavaScript that computes the parameters of a file from the variable dimensions."""
    scales, angle = _scales(model, designs), values_of(model.source).in_si(1.0, "rad")
    lines: list[str] = []
    for name, text in model.source.document["parameters"].items():
        if name in varying:
            value = f"d[{name!r}] / {scales[name]!r}"
        elif designs.derived.get(name):
            value = _javascript(parse_expression(text), angle)
        else:
            value = repr(designs.dimensions[name].value / scales[name])
        lines.append(f"p[{name!r}] = {value};")
    return tuple(lines)


def _translated(model: TomlModel, designs: DesignFamily, names: Sequence[str]) -> Vectors:
    """Return the formulas of a file's points and axes."""
    document, values = model.source.document, values_of(model.source)
    texts, scales, angle = document["parameters"], _scales(model, designs), values.in_si(1.0, "rad")

    def parameters(si: Mapping[str, float]) -> dict[str, float]:
        parameter_values: dict[str, float] = {}
        for name, text in texts.items():
            if name in names:
                parameter_values[name] = si[name] / scales[name]
            else:
                parameter_values[name] = evaluate_number(text, parameter_values.__getitem__, angle)
        return parameter_values

    def formula(value: Any, unit: Unit) -> Formula:
        scale = values.in_si(1.0, unit)
        if isinstance(value, str) and not is_quantity(value):
            text = f"{_javascript(parse_expression(value), angle)} * {scale!r}"
            return Formula(text, lambda si: scale * evaluate_number(value, parameters(si).__getitem__, angle))
        number = parse(value, unit, "") if isinstance(value, str) else scale * float(value)
        return Formula(repr(number), lambda _: number)

    return {
        key: (formula(entry[0], unit), formula(entry[1], unit), formula(entry[2], unit))
        for key, entry, unit in _entries(document)
    }


def _entries(document: Mapping[str, Any]) -> list[tuple[tuple[str, str], Any, Unit]]:
    """Return the vectors in a file: (owner, quantity), components, unit."""
    entries: list[tuple[tuple[str, str], Any, Unit]] = []
    for joint, entry in document["joints"].items():
        for side in "ab":
            for key, value in entry[side].items():
                quantity = "reference" if key == "mark" else key
                if quantity in QUANTITIES:
                    entries.append(((f"{joint}.{side}", quantity), value, "m" if quantity == "at" else "1"))
    for point, entry in document.get("points", {}).items():
        if "at" in entry:
            entries.append(((point, "at"), entry["at"], "m"))
    return entries


_SYMBOLS: Mapping[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


def _javascript(node: ast.AST, angle: float) -> str:
    """Return an expression of parameters in JavaScript; `angle` is the unit of its angles in [rad]."""
    match node:
        case ast.Constant(value=value):
            return repr(value)
        case ast.Name(id="pi"):
            return "Math.PI"
        case ast.Name(id=name):
            return f"p[{name!r}]"
        case ast.UnaryOp(op=op, operand=operand):
            return f"({'-' if isinstance(op, ast.USub) else ''}{_javascript(operand, angle)})"
        case ast.BinOp(left=left, op=op, right=right):
            first, second = _javascript(left, angle), _javascript(right, angle)
            return (
                f"Math.pow({first}, {second})"
                if isinstance(op, ast.Pow)
                else f"({first} {_SYMBOLS[type(op)]} {second})"
            )
        case ast.Call(func=ast.Name(id=name), args=args):
            arguments = [_javascript(argument, angle) for argument in args]
            if name in ("sin", "cos", "tan"):
                return f"Math.{name}({arguments[0]} * {angle!r})"
            scale = f" / {angle!r}" if name in ("asin", "acos", "atan", "atan2") else ""
            return f"(Math.{name}({', '.join(arguments)}){scale})"
        case _:
            raise ValueError(ast.dump(node))


# --- coefficients fitted on a grid of designs


def fitted_vectors(designs: DesignFamily, names: Sequence[str], nominal: Mechanism) -> Vectors:
    """Return formulas of the points and axes that dimensions change."""
    length = nominal.characteristic_length
    start = _scaled(nominal, length)
    users = {key: np.zeros((len(names), *numbers.shape), dtype=np.bool_) for key, numbers in start.items()}
    for i, name in enumerate(names):
        try:
            design = _scaled(
                designs.describe({name: _changed(designs.dimensions[name], CHANGES[0], designs)}), length
            )
        except (MechsimError, ArithmeticError, ValueError):
            continue
        for key, numbers in design.items():
            users[key][i] = np.abs(numbers - start[key]) > ROUNDING
    out: dict[tuple[str, str], tuple[Formula, Formula, Formula]] = {}
    for key, numbers in start.items():
        rows = numbers[None] if numbers.ndim == 1 else numbers
        used = users[key][:, None] if numbers.ndim == 1 else users[key]
        for k, quantity in enumerate(QUANTITIES[: len(rows)]):
            if not used[:, k].any():
                continue
            scale = length if quantity == "at" else 1.0
            shared = [name for name, flags in zip(names, used[:, k], strict=True) if flags.any()]
            formulas = _fitted(designs, shared[:MAX_SHARED], key, k, scale, length)
            if formulas is not None:
                out[key, quantity] = formulas
    return out


def _fitted(
    designs: DesignFamily, names: Sequence[str], key: str, row: int, scale: float, length: float
) -> tuple[Formula, Formula, Formula] | None:
    """Return a vector as a sum of products of its dimensions from a grid of designs; None if one fails."""
    nodes, inverses, texts = [], [], []
    for name in names:
        unit = designs.dimensions[name].unit
        unit_length = length if unit == "m" else 1.0
        points = (
            np.array([-1.0, 0.0, 1.0]) * 2.0 * np.pi / 3.0
            if unit == "rad"
            else np.array([0.5, 1.5]) * unit_length
        )
        columns = (
            [np.ones_like(points), np.cos(points), np.sin(points)]
            if unit == "rad"
            else [np.ones_like(points), points]
        )
        nodes.append(points)
        inverses.append(np.linalg.inv(np.column_stack(columns)))
        text = f"d[{name!r}]"
        texts.append(["", f"Math.cos({text})", f"Math.sin({text})"] if unit == "rad" else ["", text])
    values = np.empty((*(len(points) for points in nodes), 3))
    for index in np.ndindex(*values.shape[:-1]):
        setting = {name: float(nodes[i][k]) for i, (name, k) in enumerate(zip(names, index, strict=True))}
        try:
            with np.errstate(divide="raise", invalid="raise"):
                numbers = _scaled(designs.describe(setting), length)[key]
        except (MechsimError, ArithmeticError, ValueError):
            return None
        values[index] = scale * np.atleast_2d(numbers)[row]
    for i, inverse in enumerate(inverses):
        values = np.moveaxis(np.tensordot(inverse, values, (1, i)), 0, i)
    first, second, third = (_sum_of_products(names, designs, texts, values[..., k]) for k in range(3))
    return first, second, third


def _sum_of_products(
    names: Sequence[str], designs: DesignFamily, texts: Sequence[Sequence[str]], coefficients: Array
) -> Formula:
    largest = np.abs(coefficients).max()
    terms = [
        (float(coefficients[index]), [texts[i][k] for i, k in enumerate(index) if texts[i][k]], index)
        for index in product(*(range(count) for count in coefficients.shape))
        if abs(coefficients[index]) >= 1e-15 * max(largest, 1.0) and _clean(float(coefficients[index]))
    ]
    text = " + ".join(" * ".join([repr(_clean(factor)), *factors]) for factor, factors, _ in terms) or "0"
    units = [designs.dimensions[name].unit for name in names]

    def value(si: Mapping[str, float]) -> float:
        basis = [
            (1.0, np.cos(si[name]), np.sin(si[name])) if unit == "rad" else (1.0, si[name])
            for name, unit in zip(names, units, strict=True)
        ]
        return float(
            sum(
                _clean(factor) * np.prod([basis[i][k] for i, k in enumerate(index)])
                for factor, _, index in terms
            )
        )

    return Formula(text, value)


def _clean(factor: float) -> float:
    """Return a coefficient, rounded to an integer within rounding errors."""
    return float(round(factor)) if abs(factor - round(factor)) < 1e-14 else factor
