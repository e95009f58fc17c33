"""Declaration, dimensions and formulas of a catalogue mechanism."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.link_frames import LinkFrame
from mechsim.analytic.vector_method.trig_polynomial import Arcs
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import no_crank_range_error
from mechsim.model.quantity import AXES
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE, numbers
from mechsim.numerics.jets import Values


def length(default: float, doc: str) -> Any:
    """Declare a length in [m] that must be positive and finite."""
    return field(default=default, metadata={"unit": "m", "doc": doc, "positive": True})


def position(default: float | tuple[float, ...], doc: str) -> Any:
    """Declare a length of either sign, or a point, in [m]."""
    return field(default=default, metadata={"unit": "m", "doc": doc})


def angle(default: float, doc: str) -> Any:
    """Declare an angle in [rad]."""
    return field(default=default, metadata={"unit": "rad", "doc": doc})


def dimensionless(default: float, doc: str) -> Any:
    """Declare a dimensionless number."""
    return field(default=default, metadata={"unit": "1", "doc": doc})


def choice(default: Any, options: tuple[Any, ...], doc: str) -> Any:
    """Declare a parameter with a few possible values."""
    return field(default=default, metadata={"unit": "1", "doc": doc, "options": options})


def checked(mechanism: str, name: str, value: Any, default: Any, rule: Mapping[str, Any]) -> Any:
    """Return the stored value of a parameter; raise InputError if its declaration does not allow it."""
    if "options" in rule:
        if np.ndim(value) != 0 or value not in rule["options"]:
            options = " or ".join(str(option) for option in rule["options"])
            raise InputError(f"{mechanism}: {name} is {value!r}; it can be {options}")
        return value
    array = numbers(value)
    shape, most = np.shape(default), HUGE if rule["unit"] == "m" else np.inf
    if array.shape != shape or not (np.abs(array) < most).all():
        count = f"{shape[0]} finite numbers" if shape else "a finite number"
        below = f" below {most:g}" if most < np.inf else ""
        raise InputError(f"{mechanism}: {name} is {value} {rule['unit']}; give {count}{below}")
    if rule.get("positive") and not float(array) > 1.0 / HUGE:
        raise InputError(
            f"{mechanism}: {name} is {value} {rule['unit']}; give a length above 0, at least {1.0 / HUGE:g} m"
        )
    if shape:
        return tuple(array.tolist())
    return value.item() if isinstance(value, np.generic) else value


def parameter_value(mechanism: str, field: Any, parameter: str, value: Any) -> Any:
    """Return the value of a parameter: text is read with its unit, other values are returned unchanged.

    Args:
        mechanism: name of the mechanism.
        field: field of the mechanism's class with unit, options and default.
        parameter: name of the parameter.
        value: text, a sequence that contains text, or a value in SI.

    Raises:
        InputError: for text that is no such value.
    """
    unit, what = field.metadata["unit"], f"{parameter} of {mechanism}"
    if isinstance(value, tuple | list) and any(isinstance(component, str) for component in value):
        return tuple(units.si(component, unit, what) for component in value)
    if not isinstance(value, str):
        return value
    if "options" in field.metadata:
        return _option(what, field.metadata["options"], value)
    if isinstance(field.default, tuple):
        values = units.parse_vector(value, unit, what)
        if len(values) != len(field.default):
            raise InputError(
                f"{what} is {value!r}, {len(values)} numbers; give {len(field.default)} separated by commas"
            )
        return values
    number = units.parse(value, unit, what)
    if isinstance(field.default, int):
        if number != int(number):
            raise InputError(f"{what} is {value!r}; give a whole number")
        return int(number)
    return number


def _option(what: str, options: tuple[Any, ...], text: str) -> Any:
    words = {str(option).lower(): option for option in options}
    if set(options) == {False, True}:
        words = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}
    word = text.lower().removeprefix("+")
    if word not in words:
        raise InputError(f"{what} is {text!r}; it can be {' or '.join(list(words)[:2])}")
    return words[word]


# parameters that select the assembly mode
SELECTORS = ("branch", "side", "assembly")


@dataclass(frozen=True, slots=True)
class Declaration:
    """Name of a catalogue mechanism, and the studies that apply to it.

    Attributes:
        name: name in the catalogue.
        theories: studies that exist only for this mechanism: "coupler line", "velocity plan".
        gear: name of the parameter that is a gear ratio; empty if there is none.
        array_parameters: parameters that may be arrays, one number per design.
        discriminant_degree: degree of the trigonometric polynomial whose sign changes are the dead centres.
    """

    name: str
    theories: frozenset[str] = frozenset()
    gear: str = ""
    array_parameters: frozenset[str] = frozenset()
    discriminant_degree: int = 2


@dataclass(frozen=True, slots=True)
class Geometry:
    """Points and frames fixed in links; components may be (n,) of many designs.

    Attributes:
        points: tracked point -> its position in its link, in [m].
        joints: joint -> its points on links a and b, in [m]; other joints have them at the origins.
        frames: joint -> frame of its side a, (3, 3) or (3, 3, n), if it depends on parameters.
    """

    points: Mapping[str, Sequence[Any]]
    joints: Mapping[str, tuple[Any, Any]]
    frames: Mapping[str, Array] = field(default_factory=dict[str, Array])


@dataclass(frozen=True, kw_only=True)
class Formulas(ABC):
    """Dimensions of a mechanism with a driven crank, and formulas of its crank angle.

    A subclass is a frozen dataclass of parameters, checked at construction.
    """

    declaration: ClassVar[Declaration]

    def __post_init__(self) -> None:
        for parameter in fields(self):
            value, rule = getattr(self, parameter.name), parameter.metadata
            kept = checked(self.name, parameter.name, value, parameter.default, rule)
            object.__setattr__(self, parameter.name, kept)

    @property
    def name(self) -> str:
        """Name in the catalogue."""
        return self.declaration.name

    @property
    @abstractmethod
    def description(self) -> Mechanism:
        """Links, joints, crank and tracked points, without a guess."""

    @abstractmethod
    def frames(self, angle: Values) -> Iterator[tuple[str, LinkFrame]]:
        """Yield links and their frames at crank angles, those that carry tracked points first.

        Args:
            angle: (n,) in [rad]; an array gives poses, a jet gives the motion.

        Frames are NaN where the loop does not close.
        """

    @property
    def array_parameters(self) -> frozenset[str]:
        """Parameters that may be arrays, one number per design."""
        return self.declaration.array_parameters

    def geometry(self) -> Geometry:
        """Return points and frames fixed in links; of many designs if parameters are arrays."""
        points = {name: local for name, (_, local) in self.described.points.items()}
        return Geometry(
            points, {joint.name: (joint.a.point, joint.b.point) for joint in self.described.joints}
        )

    def start_frames(self, count: int) -> Iterator[tuple[str, LinkFrame]] | None:
        """Return links and frames of designs at crank angle 0; None if they do not determine the mode.

        Frames are NaN where the loop does not close.
        """
        return self.frames(np.zeros(count)) if self.array_parameters else None

    @abstractmethod
    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that distinguishes the assembly modes, (n,); positive for this one.

        Args:
            points: tracked point -> (n, 3) in [m], by any method.
        """

    @abstractmethod
    def transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the angle between the coupler force and the output's motion, (n,) in [rad], 0 to pi/2.

        90 degrees is best; at zero the output locks.
        """

    @abstractmethod
    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the loops close in this assembly mode."""

    @abstractmethod
    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each of its real assembly modes at a crank angle; empty if it has none."""

    @property
    def spinning(self) -> frozenset[str]:
        """Links whose rotation about their own line is undetermined."""
        return frozenset()

    def variants(self) -> Mapping[str, Self]:
        """Return variants that are validated in addition: name -> the mechanism with another parameter."""
        return {}

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles of change points, in [-pi, pi) rad.

        There the links are collinear, as in a flat parallelogram, and the linkage can continue in either
        assembly mode.
        """
        return ()

    @property
    def mechanism(self) -> Mechanism:
        """The description, with a guess that selects the assembly mode."""
        return self._assembled

    @cached_property
    def _assembled(self) -> Mechanism:
        return self.described.with_guess(*self.guess())

    @cached_property
    def described(self) -> Mechanism:
        """The description, cached."""
        return self.description

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at a crank angle well inside the range, and that angle in [rad]."""
        start = self._start_angle
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            frames = dict(self.frames(np.array([start])))
        guess = {
            link.name: Pose(
                link_frames.rows(frames[link.name].origin, 1)[0], frames[link.name].rotation(1)[0]
            )
            for link in self.described.links
        }
        for name, pose in guess.items():
            if not np.isfinite(pose.rotation).all():
                raise AssemblyError(
                    f"{self.name}: the orientation of link {name!r} is undetermined at crank "
                    f"angle {start:.6g} rad"
                )
        return guess, start

    def _start(self) -> float:
        """Return the crank angle of the guess in [rad]."""
        arcs = self.crank_range()
        if not arcs.arcs:
            raise no_crank_range_error(self.name)
        return arcs.start()

    @cached_property
    def _start_angle(self) -> float:
        """The crank angle of the guess in [rad], at which the sign of the assembly mode applies."""
        return self._start()


def parameters_from(formulas: Formulas, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters from values by name; a component of a point is named as in pivot.x."""
    arguments: dict[str, Any] = {}
    for name, value in values.items():
        parameter, dot, axis = name.partition(".")
        current = arguments.get(parameter, getattr(formulas, parameter))
        if not dot:
            # a choice, such as an assembly mode, is a whole number
            whole = isinstance(current, int) and np.ndim(value) == 0 and float(value).is_integer()
            arguments[parameter] = type(current)(value) if whole else value
            continue
        point = list(current)
        point[AXES.index(axis)] = value
        arguments[parameter] = tuple(point)
    return arguments


Solver = TypeVar("Solver", bound=Formulas)


def unchecked(formulas: Solver, values: Mapping[str, Any]) -> Solver:
    """Return a copy with parameters that are not checked, such as arrays of many designs."""
    copy = object.__new__(type(formulas))
    for parameter in fields(formulas):
        value = values.get(parameter.name, getattr(formulas, parameter.name))
        object.__setattr__(copy, parameter.name, value)
    return copy
