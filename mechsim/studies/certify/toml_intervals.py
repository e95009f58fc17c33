"""Intervals of a mechanism's joints within the tolerances of its dimensions.

The expressions of a TOML file are evaluated on balls with their derivatives, so that the joints of every
mechanism within the tolerances lie in the intervals. Other models have dimensions that move joints in
proportion, as positions do.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.io.file_expressions import FileExpressions, expressions_of, parameter_name
from mechsim.io.toml_coordinates import leaves
from mechsim.io.toml_values import Values, is_quantity
from mechsim.kinematics.designs import DesignFamily
from mechsim.mechanism.design_arrays import side_numbers, structure
from mechsim.mechanism.expressions import Evaluator, Term, parse_expression
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import EX, EY, EZ, ORIGIN, Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.balls import OUTWARD, ROUNDOFF, Ball, ball
from mechsim.numerics.jets import Jet
from mechsim.units import Unit

# largest component of a link's x axis along a joint's axis at which it is the joint's reference direction
# (`model.joints.End`)
ALONG_AXIS = 0.9


def file_radii(file: FileExpressions, nominal: Mechanism, bounds: Mapping[str, float]) -> dict[str, Array]:
    """Return JOINT.a and JOINT.b -> radii of point, axis and reference, (3, 3), within bounds.

    Args:
        file: the expressions.
        nominal: the mechanism of the file.
        bounds: parameter -> bound in SI.

    Raises:
        InputError: if a parameter changes more than points and axes of joints, or appears in a function
            that interval arithmetic does not enclose.
    """
    at_centre = ParameterIntervals.within(file, dict.fromkeys(bounds, 0.0), "")
    along = [ParameterIntervals.within(file, bounds, name) for name in bounds]
    for path, text in _fixed_entries(file.document):
        for name in sorted(_words(text) & at_centre.moving):
            raise InputError(
                f"dimension {name} changes {'.'.join(path)}; a certificate holds within tolerances of "
                "points and axes only: leave it out of --within"
            )
    radii: dict[str, Array] = {}
    for joint in nominal.joints:
        for side, end in (("a", joint.a), ("b", joint.b)):
            entry = file.document["joints"][joint.name][side]
            if at_centre.depends(entry):
                own = at_centre.side(joint, entry)
                moved = [intervals.side(joint, entry) for intervals in along]
                numbers = [*end.point, *end.axis, *(end.reference or EX)]
                rows = zip(own, numbers, zip(*moved, strict=True), strict=True)
                radii[f"{joint.name}.{side}"] = np.array([_radius(*row) for row in rows]).reshape(3, 3)
    return radii


# values of a component of a vector in a file, (1,), and whether it is an expression of parameters that change
FileNumber = tuple[Jet, bool]


@dataclass(frozen=True)
class ParameterIntervals:
    """The parameters of a file within tolerances.

    Values are jets over all mechanisms within the tolerances. The change of a number is at most the sum over
    the parameters of its rate along each parameter, from the centre to the bound.

    Attributes:
        values: values of the file at the nominal parameters.
        jets: parameter -> its values in the file's unit, (1,), without parameters that cannot be enclosed.
        moving: parameters that change within the tolerances.
    """

    values: Values
    jets: Mapping[str, Jet]
    moving: frozenset[str]

    @classmethod
    def within(cls, file: FileExpressions, bounds: Mapping[str, float], along: str) -> "ParameterIntervals":
        """Return the parameters of a file within bounds in SI, with rates along the parameter `along`."""
        result = cls(file.values, {}, frozenset())
        for name, written in file.parameters.items():
            jet, moves = _still(result.values.parameters[name]), name in bounds
            if moves:
                tolerance = (ball(bounds[name]) / result.factor(file.units[name])).magnitude
                jet = Jet(Ball(jet.value.mid, tolerance), ball(tolerance * (name == along)), jet.second)
            elif result.depends(written):
                jet, moves = result.evaluated(written), True
            jets = result.jets if jet is None else {**result.jets, name: jet}
            result = cls(result.values, jets, result.moving | ({name} if moves else set()))
        return result

    def factor(self, unit: Unit) -> Ball:
        """Return the factor to SI of a number without a unit."""
        value = self.values.in_si(1.0, unit)
        return Ball(np.array([value]), np.array([2.0 * ROUNDOFF * abs(value) if value != 1.0 else 0.0]))

    def depends(self, written: object) -> bool:
        """Return whether an entry of the file is or contains an expression of parameters that change."""
        if isinstance(written, dict):
            return any(self.depends(entry) for key, entry in written.items() if key != "link")
        if isinstance(written, list):
            return any(map(self.depends, written))
        return isinstance(written, str) and not is_quantity(written) and bool(_words(written) & self.moving)

    def evaluated(self, text: str) -> Jet | None:
        """Return the values of an expression, (1,), in the file's unit; None if they cannot be enclosed."""
        angle: Any = 1.0 if self.values.in_si(1.0, "rad") == 1.0 else self.factor("rad")
        evaluator = Evaluator(lambda name: Term(self.jets[name]), angle)
        try:
            value = evaluator.evaluate(parse_expression(text)).value
        except (KeyError, TypeError, AttributeError):
            return None
        return value if isinstance(value, Jet) else _still(value)

    def vector(self, entry: Mapping[str, Any], key: str, unit: Unit) -> list[FileNumber] | None:
        """Return a vector of a side of a joint in SI; None if the file has none."""
        return [self._component(written, unit) for written in entry[key]] if key in entry else None

    def _component(self, written: Any, unit: Unit) -> FileNumber:
        if not self.depends(written):
            return _still(self.values.quantity(written, unit, ("joints",))), False
        jet = self.evaluated(written)
        if jet is None:
            raise InputError(
                f"{written!r} cannot be enclosed within tolerances; give + - * / **, sin, cos, tan, sqrt and "
                "exp of parameters, or leave its dimensions out of --within"
            )
        factor: Any = self.factor(unit)
        return jet * factor, True

    def side(self, joint: Joint, entry: Mapping[str, Any]) -> list[Jet | None]:
        """Return the nine numbers of point, axis and reference of a joint side; None for constant numbers."""
        point = self.vector(entry, "at", "m") or _fixed(ORIGIN)
        numbers: list[Jet | None] = [jet if moves else None for jet, moves in point]
        axis = self.vector(entry, "axis", "1") or _fixed(EZ)
        reference = self.vector(entry, "reference", "1")
        if not any(moves for _, moves in (*axis, *(reference or ()))):
            return [*numbers, *[None] * 6]
        z = _unit([jet for jet, _ in axis])
        if reference is None:
            reference = _fixed(_own_reference(joint, z))
        references = [jet for jet, _ in reference]
        along = _dot(z, references)
        x = _unit([value - along * direction for value, direction in zip(references, z, strict=True)])
        # components that are zero and constant, of the axis and of both directions
        zero, zero_reference = (
            [not moves and not jet.value.mid.any() for jet, moves in vector] for vector in (axis, reference)
        )
        both = [a and b for a, b in zip(zero, zero_reference, strict=True)]
        numbers += [None if stays else jet for stays, jet in zip([*zero, *both], [*z, *x], strict=True)]
        return numbers


def _still(value: float) -> Jet:
    zero = ball(np.zeros(1))
    return Jet(ball(np.array([value])), zero, zero)


def _fixed(vector: Vector) -> list[FileNumber]:
    return [(_still(value), False) for value in vector]


def _dot(a: Sequence[Jet], b: Sequence[Jet]) -> Jet:
    x, y, z = (first * second for first, second in zip(a, b, strict=True))
    return x + y + z


def _unit(vector: Sequence[Jet]) -> list[Jet]:
    length = np.sqrt(_dot(vector, vector))  # pyright: ignore[reportCallIssue, reportArgumentType]
    return [component / length for component in vector]


def _own_reference(joint: Joint, axis: Sequence[Jet]) -> Vector:
    """Return the default reference direction of a joint side from its unit axis, as in `End`."""
    share = axis[0].value
    small, large = share.magnitude[0] < ALONG_AXIS, abs(share.mid[0]) - share.rad[0] > ALONG_AXIS
    if 0 in KINDS[joint.kind].aligned_columns or not (small or large):
        raise InputError(f"joint {joint.name} has an axis that changes; give its sides a reference")
    return EX if small else EY


def _radius(at_centre: Jet | None, nominal: float, moved: Sequence[Jet | None]) -> float:
    """Return the largest deviation of a number from its nominal value; zero for a constant number."""
    if at_centre is None:
        return 0.0
    rates = sum(float(jet.rate.magnitude[0]) for jet in moved if jet is not None)
    return (rates + float((at_centre.value - nominal).magnitude[0])) * OUTWARD


def _words(text: object) -> frozenset[str]:
    return frozenset(re.findall(r"[^\W\d]\w*", text)) if isinstance(text, str) else frozenset()


def _fixed_entries(document: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the entries of a file that must not change within tolerances, with their paths."""
    for name, joint in document["joints"].items():
        yield from (
            (("joints", name, key), joint[key]) for key in ("cross_angle", "lead", "length") if key in joint
        )
    for name, coupling in document.get("couplings", {}).items():
        for path, value in leaves(coupling, ("couplings", name)):
            if path[2:] not in (("driver",), ("driven",)):
                yield from ((path, entry) for entry in (value if isinstance(value, list) else [value]))
    for table in ("locked", "motion_laws"):
        yield from leaves(document.get(table, {}), (table,))


# rounding error of points and axes relative to the largest value
ROUNDING = 1e-13


def radii_within(
    model: object, changed: Mapping[str, str | float], designs: DesignFamily, bounds: Mapping[str, float]
) -> dict[str, Array]:
    """Return JOINT.a and JOINT.b -> radii of point, axis and reference, (3, 3), within bounds of dimensions.

    Args:
        model: the opened model of these designs.
        changed: parameter -> its value, as `load` takes it.
        designs: the parametric model of the mechanism.
        bounds: dimension -> bound in SI.

    Raises:
        InputError: as in `file_radii` and `proportional_radii`.
    """
    file = expressions_of(model, designs, changed)
    if file is None:
        return proportional_radii(designs, bounds)
    named = {parameter_name(name): tolerance for name, tolerance in bounds.items()}
    return file_radii(file, designs.describe({}), named)


def proportional_radii(designs: DesignFamily, bounds: Mapping[str, float]) -> dict[str, Array]:
    """Return the radii of `radii_within` for dimensions to which points and axes change in proportion.

    Raises:
        InputError: if a dimension changes more than points and axes of joints, or not in proportion.
    """
    nominal = designs.describe({})
    start = _stacked(nominal)
    total, rounding = np.zeros_like(start), ROUNDING * np.abs(start).max()
    for name, tolerance in bounds.items():
        value = designs.dimensions[name].value
        moved = [designs.describe({name: value + fraction * tolerance}) for fraction in (-1.0, 0.5, 1.0)]
        if any(structure(mechanism) != structure(nominal) for mechanism in moved):
            raise InputError(
                f"dimension {name} changes a coupling, a lock or a kind of joint; "
                "a certificate holds within tolerances of points and axes only: leave it out of --within"
            )
        down, half, up = (_stacked(mechanism) - start for mechanism in moved)
        if not max(np.abs(up + down).max(), np.abs(up - 2.0 * half).max()) <= rounding:
            raise InputError(
                f"dimension {name} does not move joints in proportion, and only expressions of a TOML file "
                "are enclosed otherwise; describe the mechanism in TOML, or leave it out of --within"
            )
        total += np.abs(up)
    total += np.where(total > 0.0, rounding, 0.0)
    return {key: radii for key, radii in zip(side_numbers(nominal), total, strict=True) if radii.any()}


def _stacked(mechanism: Mechanism) -> Array:
    """Return points, axes and reference directions of all sides of joints, (sides, 3, 3)."""
    return np.array([*side_numbers(mechanism).values()])
