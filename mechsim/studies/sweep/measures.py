"""Measures of a design: numbers from its motion, requested by text such as `range:rocker` or `max:P3.vx`."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.io.python_object import run_object, run_user_code
from mechsim.io.toml_values import suggestion
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.mechanism.motion_laws import CRANK, MotionLaws
from mechsim.mechanism.quantities import coordinate_units, moving_points, numeric_quantity, unknown
from mechsim.mechanism.quantity import AXES, Quantity, Source, record_columns, unwrapped
from mechsim.numerics.arrays import Array

# name -> statistic of a quantity over the motion, (designs, poses) -> (designs,)
STATISTICS: dict[str, Callable[[Array], Array]] = {
    "max": lambda values: values.max(1),
    "min": lambda values: values.min(1),
    "rms": lambda values: np.sqrt((values**2).mean(1)),
    "mean": lambda values: values.mean(1),
    # about the mean
    "ripple": lambda values: np.sqrt(((values - values.mean(1, keepdims=True)) ** 2).mean(1)),
}
WORDS = ("range:J", "stroke:P", *(f"{word}:Q" for word in STATISTICS), "at:ANGLE:Q", "FILE.py:FUNC")


@dataclass(frozen=True)
class Turns:
    """Motions of designs over equal numbers of poses.

    Attributes:
        designs: number of designs.
        poses: number of poses of each.
        motion: motion at designs x poses instants, one design after another.
        more: further columns or quantities -> (designs, poses), such as forces and transmission angles.
    """

    designs: int
    poses: int
    motion: Motion
    more: Mapping[str, Array] = field(default_factory=dict[str, Array])

    @cached_property
    def _motion_columns(self) -> dict[str, Array]:
        return dict(self.motion.columns())

    def column(self, name: str) -> Array:
        """Return a column, (designs, poses)."""
        values = self.more[name] if name in self.more else self._motion_columns[name]
        return values.reshape(self.designs, self.poses)

    def values(self, quantity: Quantity) -> Array:
        """Return a quantity, (designs, poses); for vectors the length."""
        if quantity.name in self.more:
            return self.more[quantity.name]
        if quantity.uses("link"):
            self._motion_columns.update(record_columns(self.motion, [quantity]))
        values = quantity.number({column.name: self.column(column.name) for column in quantity.columns})
        return unwrapped(values) if quantity.angle else values


@dataclass(frozen=True, slots=True)
class TurnMeasure:
    """One number of a design.

    Attributes:
        name: as requested.
        kind: "range", "stroke", "at", "function", or one of `STATISTICS`.
        unit: in SI.
        quantity: the quantity; None for strokes and functions.
        subject: the point of a stroke, or FILE.py:FUNC.
        angle: path parameter of a single pose, in [rad]: crank angle, or time multiplied by the rate of the
            motion laws; None for the whole motion.
    """

    name: str
    kind: str
    unit: str
    quantity: Quantity | None = None
    subject: str = ""
    angle: float | None = None

    def value(self, turns: Turns, index: int | None = None) -> Array:
        """Return the measure of designs, (designs,).

        Args:
            turns: their motions over all poses, followed by the poses of single angles.
            index: of the pose at the measure's angle; None for measures over the whole motion.
        """
        if self.kind == "function":
            return _function_values(self.subject, turns)
        if self.kind == "stroke":
            # the largest distance of two positions on the path of a point, (designs,) in [m]
            x, y, z = (turns.column(f"{self.subject}.{axis}") for axis in AXES)
            largest = np.zeros(turns.designs, x.dtype)
            for shift in range(1, turns.poses // 2 + 1):
                # each pair once: poses that differ by a cyclic shift
                dx, dy, dz = (axis_values - np.roll(axis_values, shift, 1) for axis_values in (x, y, z))
                np.maximum(largest, (dx * dx + dy * dy + dz * dz).max(1), out=largest)
            return np.sqrt(largest)
        assert self.quantity is not None
        values = turns.values(self.quantity)
        if self.kind == "at":
            assert index is not None
            return values[:, index]
        if self.kind == "range":
            return values.max(1) - values.min(1)
        return STATISTICS[self.kind](values)


def measure(text: str, mechanism: Mechanism, motion_laws: MotionLaws = CRANK) -> TurnMeasure:
    """Return the measure of a text.

    Args:
        text: range:J, stroke:P, max:Q, min:Q, rms:Q, mean:Q, ripple:Q (root mean square about the mean), with
            quantities of `model.quantities`; at:ANGLE:Q, or under motion laws at:TIME:Q; or FILE.py:FUNC of a
            Motion.
        mechanism: the mechanism.
        motion_laws: its motion laws.

    Raises:
        InputError: for an unknown measure or quantity, with the closest known one.
    """
    word, colon, rest = text.partition(":")
    if ".py:" in text:
        run_object(text)
        return TurnMeasure(text, "function", "", subject=text)
    if not colon or word not in ("range", "stroke", "at", *STATISTICS):
        description = f"{word}:" if colon else text
        raise InputError(f"there is no measure {text!r}{suggestion(description, WORDS)}")
    if word == "stroke":
        if rest not in moving_points(mechanism):
            raise unknown(rest, mechanism)
        return TurnMeasure(text, word, "m", subject=rest)
    joints = coordinate_units(mechanism)
    if word == "range" and rest not in joints and "." not in rest and ":" not in rest:
        raise InputError(f"{mechanism.name} has no joint {rest!r}{suggestion(rest, joints)}")
    index, _, name = rest.partition(":") if word == "at" else ("", "", rest)
    quantity = numeric_quantity(name, mechanism)
    angle = _parameter(text, index, motion_laws) if word == "at" else None
    return TurnMeasure(text, word, quantity.unit, quantity, angle=angle)


def _parameter(text: str, index: str, motion_laws: MotionLaws) -> float:
    """Return the path parameter at a crank angle, or under motion laws at a time, in [rad]."""
    if motion_laws.crank:
        return units.parse(index, "rad", f"the angle of {text}")
    try:
        time = units.parse(index, "s", f"the time of {text}")
    except InputError as error:
        raise InputError(f"{error}; under motion laws give a time") from None
    if not 0.0 <= time <= motion_laws.duration:
        raise InputError(
            f"{text} is at {time:g} s, but the motion laws last {motion_laws.duration:g} s; "
            "give a time within them, or a longer duration"
        )
    return motion_laws.rate * time


class MeasureError(InputError):
    """A user's function that is wrong for every design."""


class NoValueError(InputError):
    """A user's function that has no number for one design, as a root or a logarithm."""

    outcome = "not measured"


def _function_values(where: str, turns: Turns) -> Array:
    """Return a user's function of each motion, (designs,)."""
    function = run_object(where)
    out = np.empty(turns.designs)
    for i in range(turns.designs):
        motion: Motion = select_instants(turns.motion, slice(i * turns.poses, (i + 1) * turns.poses))
        try:
            value = run_user_code(where, lambda motion=motion: function(motion))
        except InputError as error:
            of_design = isinstance(error.__cause__, ArithmeticError | ValueError)
            raise (NoValueError if of_design else MeasureError)(str(error)) from error
        out[i] = _number(where, value)
    return out


def _number(where: str, value: object) -> float:
    try:
        if isinstance(value, str | complex):
            raise TypeError
        return float(value)  # pyright: ignore[reportArgumentType]
    except OverflowError:
        return np.inf
    except (TypeError, ValueError):
        raise MeasureError(f"{where} returns {type(value).__name__}; return one number") from None


def measures(
    texts: "list[str] | tuple[str, ...]", mechanism: Mechanism, motion_laws: MotionLaws = CRANK
) -> "MeasureSet":
    """Return the measures of texts, each once.

    Raises:
        InputError: as for `measure`, or without any measure.
    """
    if not texts:
        raise InputError(f"no measure is requested; choose from {', '.join(WORDS)}")
    return MeasureSet(tuple(measure(text, mechanism, motion_laws) for text in dict.fromkeys(texts)))


@dataclass(frozen=True)
class MeasureSet:
    """The measures of a sweep, and the data that they need.

    Attributes:
        items: the measures.
    """

    items: tuple[TurnMeasure, ...]

    def __iter__(self) -> Iterator[TurnMeasure]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)

    @property
    def rated(self) -> bool:
        """Whether velocities or accelerations are needed."""
        return self.includes("function") or any(quantity.order > 0 for quantity in self.quantities)

    @property
    def loaded(self) -> bool:
        """Whether forces are needed."""
        return any(quantity.loaded for quantity in self.quantities)

    @property
    def jointed(self) -> bool:
        """Whether motions of joints are needed."""
        return self.includes("function") or self.uses("joint")

    @property
    def quantities(self) -> list[Quantity]:
        """The quantities that are measured."""
        return [measure.quantity for measure in self if measure.quantity is not None]

    @property
    def joints(self) -> list[str]:
        """The joint coordinates that are measured."""
        return [*dict.fromkeys(name for quantity in self.quantities for name in quantity.subjects("joint"))]

    def uses(self, *sources: Source) -> bool:
        """Whether a measured quantity needs columns of these sources."""
        return any(quantity.uses(*sources) for quantity in self.quantities)

    def includes(self, kind: str) -> bool:
        """Whether a measure is of a kind, or of a quantity of a kind."""
        return any(
            kind == measure.kind or (measure.quantity is not None and measure.quantity.kind == kind)
            for measure in self
        )


def table_of(measures: Iterable[TurnMeasure], turns: Turns, indices: Mapping[float, int]) -> dict[str, Array]:
    """Return all measures of designs: name -> (designs,).

    Args:
        measures: the measures.
        turns: motions over the turn, then at the angles of single measures.
        indices: such an angle -> index of its pose.
    """
    whole, count = turns, turns.poses - len(indices)
    if indices:
        # without the poses of single angles
        rows = np.tile(np.arange(turns.poses) < count, turns.designs)
        more = {name: values[:, :count] for name, values in turns.more.items()}
        whole = Turns(turns.designs, count, select_instants(turns.motion, rows), more)
    return {
        measure.name: measure.value(turns, indices[measure.angle])
        if measure.angle is not None
        else measure.value(whole)
        for measure in measures
    }
