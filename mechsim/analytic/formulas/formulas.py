"""Declaration, dimensions and formulas of a catalogue mechanism, and its motion from the frames of links."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from mechsim import units
from mechsim.analytic.solvers import KinematicSolver
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.link_frames import GROUND_FRAME, LinkFrame
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, Motion, Solver, join
from mechsim.model.motion_laws import no_crank_range_error
from mechsim.model.quantity import AXES
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import HUGE, numbers
from mechsim.numerics.jets import Jet, Values, constant_jet, values


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

    name: str = ""
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
class Formulas(KinematicSolver):
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
    def transmission_at(self, angles: Array, points: Mapping[str, Array]) -> Array:
        """Return the angle between the coupler force and the output's motion, (n,) in [rad], 0 to pi/2.

        90 degrees is best; at zero the output locks.

        Args:
            angles: crank angles, (n,) in [rad].
            points: tracked point -> (n, 3) in [m], at these angles.
        """

    @abstractmethod
    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each of its real assembly modes at a crank angle; empty if it has none."""

    @property
    def spinning(self) -> frozenset[str]:
        """Links whose rotation about their own line is undetermined."""
        return frozenset()

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles at which the links are collinear, as in a flat parallelogram."""
        return ()

    @cached_property
    def mechanism(self) -> Mechanism:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The description, with a guess that selects the assembly mode."""
        return self.described.with_guess(*self.guess())

    @cached_property
    def described(self) -> Mechanism:  # pyright: ignore[reportIncompatibleMethodOverride]
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


AnyFormulas = TypeVar("AnyFormulas", bound=Formulas)


def unchecked(formulas: AnyFormulas, values: Mapping[str, Any]) -> AnyFormulas:
    """Return a copy with parameters that are not checked, such as arrays of many designs."""
    copy = object.__new__(type(formulas))
    for parameter in fields(formulas):
        value = values.get(parameter.name, getattr(formulas, parameter.name))
        object.__setattr__(copy, parameter.name, value)
    return copy


# crank angles solved together: arrays of this length fit in the cache of a core
CHUNK = 8192


def motion_in_chunks(
    formulas: Formulas, angle: Values, *, links: bool, origin: Solver | None = None
) -> Motion:
    """Return the motion at crank angles as `motion_at`, with both links and joints or neither."""
    starts = range(0, len(values(angle)), CHUNK)
    pieces = (angle[start : start + CHUNK] for start in starts)
    return join([motion_at(formulas, piece, links=links, joints=links, origin=origin) for piece in pieces])


def motion_at(
    formulas: Formulas, angle: Values, *, links: bool, joints: bool, origin: Solver | None = None
) -> Motion:
    """Return the motion at crank angles, NaN where the loop does not close; without rates if they have none.

    Parameters of the formulas may be arrays of many designs.
    """
    mechanism, n = formulas.described, len(values(angle))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        frames, geometry = _frames(formulas, angle, every=links or joints), formulas.geometry()
        points = {
            name: link_frames.point_motion(frames[mechanism.points[name][0]].point(local), n)
            for name, local in geometry.points.items()
        }
        moved = {
            link.name: link_frames.motion_of_frame(frames[link.name], n) for link in mechanism.links if links
        }
        coordinates = _joints(mechanism, geometry, angle, frames) if joints else {}
    crank = angle if isinstance(angle, Jet) else constant_jet(angle)
    return Motion(
        "closed form",
        crank.value,
        crank.rate,
        crank.second,
        points,
        moved,
        coordinates,
        spinning=formulas.spinning if links else frozenset(),
        origin=origin,
    )


def _frames(formulas: Formulas, angle: Values, *, every: bool) -> dict[str, LinkFrame]:
    """Return frames of links; unless of every link, only of those with tracked points."""
    carriers = {link for link, _ in formulas.described.points.values()}
    frames_by_link: dict[str, LinkFrame] = {GROUND: GROUND_FRAME}
    for name, frame in formulas.frames(angle):
        frames_by_link[name] = frame
        if not every and carriers <= frames_by_link.keys():
            break
    return frames_by_link


def _joints(
    mechanism: Mechanism, geometry: Geometry, angle: Values, frames: Mapping[str, LinkFrame]
) -> dict[str, JointMotion]:
    """Return the motion of joint coordinates; those of gears include the revolutions of the crank."""
    geared = {gear.driven: gear.ratio * angle + gear.phase for gear in mechanism.gears}
    crank_angles = {mechanism.crank.name: angle, **geared}
    motions: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        coordinates: Sequence[Values] = (
            [crank_angles[joint.name]]
            if joint.name in crank_angles
            else link_frames.joint_coordinates(
                joint, frames[joint.a.link], frames[joint.b.link], geometry.frames.get(joint.name)
            )
        )
        motions |= link_frames.motions_of_joint(joint, coordinates, len(values(angle)))
    return motions


def require_closed(formulas: Formulas, angles: Array, points: Mapping[str, Array]) -> None:
    """Raise AssemblyError where a closed form has no real position."""
    for position in points.values():
        if not np.isfinite(position).all():
            closed = np.isfinite(position).all(1)
            arcs = formulas.crank_range()
            where = f"its range is {arcs}" if arcs.arcs else "it cannot close at any crank angle"
            raise AssemblyError(
                f"{formulas.name}: the loop does not close at crank angle "
                f"{angles[np.argmin(closed)]:.6g} rad; {where}; "
                "change the dimensions or stay inside the range"
            )


def require_finite(formulas: Formulas, motion: Motion) -> None:
    """Raise AssemblyError where a closed form has no finite rates."""
    rates = [point.acceleration for point in motion.points.values()]
    rates += [link.angular_acceleration for link in motion.links.values()]
    # they follow from the poses, and are finite only where these are
    if all(np.isfinite(rate).all() for rate in rates):
        return
    require_closed(formulas, motion.angle, {name: point.position for name, point in motion.points.items()})
    for point in motion.points.values():
        if not np.isfinite(point.acceleration).all():
            bounded = np.isfinite(point.acceleration).all(1)
            raise AssemblyError(
                f"{formulas.name}: crank angle {motion.angle[np.argmin(bounded)]:.6g} rad is a dead centre, "
                "where rates are unbounded; keep away from it"
            )
    for name, link in motion.links.items():
        finite = np.isfinite(link.rotation[:, 0]).all(1) & np.isfinite(link.angular_acceleration[:, 0])
        if not finite.all():
            raise AssemblyError(
                f"{formulas.name}: the orientation of link {name!r} is undetermined at crank angle "
                f"{motion.angle[np.argmin(finite)]:.6g} rad; change the angles of its guide"
            )
