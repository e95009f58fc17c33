"""Record of a motion, the common result of closed forms, loop equations and MuJoCo."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import needs
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

# characters per line of a representation
WIDTH = 100
# characters of a value in a representation
MAX_TEXT = 60


def short_repr(self: Any) -> str:
    """Return the fields of a record that differ from their defaults; used as `__repr__` of dataclasses."""
    shown = [
        f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if f.repr and not _default(f, self)
    ]
    whole = f"{type(self).__name__}({', '.join(shown)})"
    return "\n".join(textwrap.wrap(whole, WIDTH, subsequent_indent="  ", break_long_words=False))


def _default(field: Any, record: Any) -> bool:
    value = getattr(record, field.name)
    plain = value is None or isinstance(value, str | int | float | tuple | frozenset | Mapping)
    if field.default_factory is not MISSING:
        return plain and value == field.default_factory()
    return field.default is not MISSING and plain and value == field.default


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(str(key) for key in value) + "}"
    if isinstance(value, tuple | list) and len(value) and all(is_dataclass(entry) for entry in value):
        return "(" + ", ".join(str(getattr(entry, "name", type(entry).__name__)) for entry in value) + ")"
    if is_dataclass(value) or callable(value):
        kind = getattr(value, "__name__", type(value).__name__)
        name = getattr(value, "name", "")
        return f"<{kind} {name}>" if isinstance(name, str) and name else f"<{kind}>"
    if isinstance(value, float):
        return f"{value:.6g}"
    return textwrap.shorten(repr(value), MAX_TEXT, placeholder=" ...")


def _array(values: np.ndarray[Any, Any]) -> str:
    if values.dtype.kind not in "fiu" or not values.size:
        return f"<array {values.shape}>"
    with np.errstate(invalid="ignore"):
        low, high = values.min(), values.max()
    return f"<{values.shape}: {low:.4g}>" if low == high else f"<{values.shape}: {low:.4g} to {high:.4g}>"


Record = TypeVar("Record")
# how a motion continues at a change point: smoothly, as with inertia, or in its assembly mode
ChangePointPolicy = Literal["smooth", "branch"]
Source = Literal["closed form", "loop equations", "pose", "step"]


@dataclass(frozen=True, slots=True)
class PointMotion:
    """A tracked point in the ground frame: position [m], velocity [m/s], acceleration [m/s2], (n, 3) each."""

    position: Array
    velocity: Array
    acceleration: Array

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class LinkMotion:
    """A link in the ground frame.

    Attributes:
        position: of the link's origin, (n, 3) in [m].
        rotation: matrix whose columns are the link's axes, (n, 3, 3).
        velocity: of the origin, (n, 3) in [m/s].
        angular_velocity: (n, 3) in [rad/s].
        acceleration: of the origin, (n, 3) in [m/s2].
        angular_acceleration: (n, 3) in [rad/s2].
    """

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    __repr__ = short_repr


@dataclass(frozen=True, slots=True)
class JointMotion:
    """A joint coordinate and its first two time derivatives, (n,) each, in `unit` and per second.

    `index` is the number of the coordinate; None if the joint has only one.
    """

    value: Array
    rate: Array
    acceleration: Array
    unit: Literal["rad", "m"] = "rad"
    index: int | None = None

    __repr__ = short_repr


def leading_joint(joints: Mapping[str, JointMotion], drivers: tuple[str, ...], instants: int) -> JointMotion:
    """Return the motion of the first driver, or else of the first coordinate; zero without coordinates."""
    if drivers:
        return joints[drivers[0]]
    zero = np.zeros(instants)
    return next(iter(joints.values()), JointMotion(zero, zero, zero))


class Solver(Protocol):
    """A solver that returns a motion at other crank angles and speeds: a catalogue mechanism."""

    @property
    def solve(self) -> Callable[..., Motion]:
        """Return the motion at crank angles, speeds and accelerations, or under motion laws at times `t`."""
        ...

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that is positive in the selected assembly."""
        ...


@dataclass(frozen=True, slots=True)
class Motion:
    """The motion of a mechanism at n crank angles.

    Attributes:
        source: the method.
        angle: crank angle, not wrapped, (n,) in [rad].
        speed: crank speed, (n,) in [rad/s].
        acceleration: crank acceleration, (n,) in [rad/s2].
        points: tracked point -> its motion.
        links: link -> its motion; empty if only points are known.
        joints: joint coordinate -> its motion; joints with one coordinate have it under their name.
        time: (n,) in [s]; None if the motion is a function of the angle alone.
        closure: largest loop-closure error at each instant, (n,) in [m]; None if the method does not
            report it.
        conditioning: distance of each configuration from a singular one, (n,): the smallest singular value
            of the loop Jacobian with the crank fixed, in units of the characteristic length; None if unknown.
        spinning: links with a passive rotation about their own line, whose orientation is undetermined.
        origin: solver that can solve the motion at other crank angles; None if there is none.
        broken: why the motion ended early; empty if it is complete.
        drivers: names of the joint coordinates that follow motion laws; the angle is then the path
            parameter. Empty if a crank is driven.
    """

    source: Source
    angle: Array
    speed: Array
    acceleration: Array
    points: Mapping[str, PointMotion]
    links: Mapping[str, LinkMotion] = field(default_factory=dict)
    joints: Mapping[str, JointMotion] = field(default_factory=dict)
    time: Array | None = None
    closure: Array | None = None
    conditioning: Array | None = None
    spinning: frozenset[str] = frozenset()
    origin: Solver | None = None
    broken: str = ""
    drivers: tuple[str, ...] = ()

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def written_joints(self) -> dict[str, JointMotion]:
        """The joint coordinates without those of virtual joints, which are parts of one in a file."""
        return {name: own for name, own in self.joints.items() if not name.startswith(VIRTUAL_PREFIX)}

    def position_errors(self, other: Motion) -> dict[str, Array]:
        """Return the distance of each point from that in another motion at the same instants, (n,) in [m]."""
        gaps = {name: self.points[name].position - point.position for name, point in other.points.items()}
        return {name: np.sqrt((gap**2).sum(1)) for name, gap in gaps.items()}

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield name and values of the columns of a table, in SI.

        Columns: time and crank angle, or t and the drivers; P.x ..., P.vx ..., P.ax ... of points; J.q, J.v,
            J.a
        of joints; J.q0 ... of joints with several coordinates.
        """
        for name, column, _ in self._columns():
            yield name, column

    def column_units(self) -> dict[str, str]:
        """Return the SI unit of each column of `columns`."""
        return {name: unit for name, _, unit in self._columns()}

    def to_pandas(self) -> DataFrame:
        """Return the columns as a table with one row per instant; `attrs["units"]` gives their units.

        Raises:
            MissingToolError: if pandas is not installed.
        """
        table = _library("pandas").DataFrame(dict(self.columns()))
        table.attrs["units"] = self.column_units()
        return table

    def to_xarray(self) -> Dataset:
        """Return the columns as variables over the dimension `instant`, with attributes `units`.

        Crank angle and time are coordinates.

        Raises:
            MissingToolError: if xarray is not installed.
        """
        columns = {name: ("instant", column, {"units": unit}) for name, column, unit in self._columns()}
        coordinates = {name: columns.pop(name) for name in ("t", "angle") if name in columns}
        return _library("xarray").Dataset(columns, coordinates, {"source": self.source})

    def _columns(self) -> Iterator[tuple[str, Array, str]]:
        """Yield name, values and unit of each column."""
        if self.time is not None:
            yield "t", self.time, "s"
        for name in self.drivers:
            yield name, self.joints[name].value, self.joints[name].unit
        if not self.drivers:
            yield "angle", self.angle, "rad"
        for name, point in self.points.items():
            rates = ("", "m", point.position), ("v", "m/s", point.velocity), ("a", "m/s2", point.acceleration)
            for prefix, unit, values in rates:
                for axis, column in zip("xyz", values.T, strict=True):
                    yield f"{name}.{prefix}{axis}", column, unit
        for name, joint in self.written_joints.items():
            called, number = name, ""
            if joint.index is not None:
                called, number = name.rpartition(".")[0], str(joint.index)
            columns = zip(
                "qva", (joint.value, joint.rate, joint.acceleration), ("", "/s", "/s2"), strict=True
            )
            for letter, column, per in columns:
                yield f"{called}.{letter}{number}", column, joint.unit + per


def _library(name: str) -> Any:
    with needs("tables"):
        return import_module(name)


def at_unit_speed(motion: Motion) -> Motion:
    """Return a motion under motion laws with derivatives by the path parameter instead of time."""
    rate = motion.speed
    joints = {
        name: replace(joint, rate=joint.rate / rate, acceleration=joint.acceleration / rate**2)
        for name, joint in motion.joints.items()
    }
    return replace(motion, speed=np.ones_like(rate), acceleration=np.zeros_like(rate), joints=joints)


def join(records: list[Record]) -> Record:
    """Return the records of consecutive instants, such as motions, as one record."""
    return records[0] if len(records) == 1 else mapped(lambda *arrays: np.concatenate(arrays), *records)


def select_instants(record: Record, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Record:
    """Return a motion or another record at selected instants."""
    return mapped(lambda array: array[rows], record)


def weighted_sums(record: Record, weights: Array) -> Record:
    """Return weighted sums of a record's n instants, weights (k, n), as a record of k instants."""
    return mapped(lambda array: np.asarray(np.tensordot(weights, array, 1), dtype=np.float64), record)


def replace_instants(record: Record, rows: NDArray[np.intp], other: Record) -> Record:
    """Return a record with the instants `rows`, (k,), replaced by those of another record of k instants."""

    def replaced(array: Array, values: Array) -> Array:
        out = array.copy()
        out[rows] = values
        return out

    return mapped(replaced, record, other)


def mapped(change: Callable[..., Array], *records: Any) -> Any:
    """Return a record whose arrays are a function of the arrays of several records."""
    first = records[0]
    if isinstance(first, np.ndarray):
        return change(*records)
    if isinstance(first, Mapping):
        return {key: mapped(change, *(record[key] for record in records)) for key in first}
    # records have slots; a solver has none and stays unchanged
    if is_dataclass(first) and hasattr(first, "__slots__"):
        values = {f.name: mapped(change, *(getattr(r, f.name) for r in records)) for f in fields(first)}
        return type(first)(**values)  # pyright: ignore[reportCallIssue]
    return first
