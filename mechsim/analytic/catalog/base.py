"""What every catalogue mechanism has in common: checked parameters, crank range, assemblies, solving."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.vector_method.trig_arcs import Arcs, reachable_arcs
from mechsim.errors import AssemblyError, InputError
from mechsim.model.mechanism import Mechanism, Pose
from mechsim.model.motion import Motion, join

Array = NDArray[np.float64]
Unit = Literal["m", "rad", "1"]
# how much of a motion is wanted: places of points; also their rates; also whole links and joints
Detail = Literal["places", "rates", "links"]

# squares and fourth powers of lengths and rates below this stay far from overflow
HUGE = 1e30
# parameters that say which assembly is meant
SELECTORS = ("branch", "side", "assembly")

# angles a closed form takes in one go: its arrays of this length stay in a core's own cache
CHUNK = 2048


def length(default: float, doc: str) -> Any:
    """Declare a length in [m] that must be positive and finite."""
    return field(default=default, metadata={"unit": "m", "doc": doc, "positive": True})


def offset(default: float, doc: str) -> Any:
    """Declare a length in [m] of either sign."""
    return field(default=default, metadata={"unit": "m", "doc": doc})


def angle(default: float, doc: str) -> Any:
    """Declare an angle in [rad]."""
    return field(default=default, metadata={"unit": "rad", "doc": doc})


def number(default: float, doc: str) -> Any:
    """Declare a pure number."""
    return field(default=default, metadata={"unit": "1", "doc": doc})


def place(default: tuple[float, ...], doc: str) -> Any:
    """Declare a point in [m]."""
    return field(default=default, metadata={"unit": "m", "doc": doc})


def choice(default: Any, options: tuple[Any, ...], doc: str) -> Any:
    """Declare a parameter that takes one of a few values."""
    return field(default=default, metadata={"unit": "1", "doc": doc, "options": options})


@dataclass(frozen=True, kw_only=True)
class ClosedForm(ABC):
    """A catalogue mechanism with a driven crank and a closed form.

    A subclass is a frozen dataclass of parameters, checked at construction. It gives the abstract
    members below; `positions`, `solve` and the checks follow from them.
    """

    name: ClassVar[str]

    def __post_init__(self) -> None:
        for parameter in fields(self):
            given, rule = getattr(self, parameter.name), parameter.metadata
            kept = _check(self.name, parameter.name, given, parameter.default, rule)
            object.__setattr__(self, parameter.name, kept)

    @property
    @abstractmethod
    def mechanism(self) -> Mechanism:
        """The description: links, joints, crank, tracked points, and a guess that names the assembly."""

    @abstractmethod
    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that tells the assemblies apart, (n,); positive for this one.

        Args:
            points: tracked point -> (n, 3) in [m], from any road.
        """

    @abstractmethod
    def transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the angle between coupler force and the output's motion, (n,) in [rad], 0 to pi/2.

        90 degrees is best; zero is a pose in which the output locks.
        """

    @abstractmethod
    def crank_range(self) -> Arcs:
        """Return the arcs of crank angle over which the loops close in this assembly."""

    @abstractmethod
    def assemblies(self, angle: float) -> Sequence[Self]:
        """Return the mechanism in each real assembly it has at a crank angle; empty if it has none."""

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly at a crank angle: the parameters that select it, and its tracked points.

        Points are (3,) in [m]. A selector is None where no value of it leads to the assembly.
        """
        listed: list[tuple[dict[str, int | None], dict[str, Array]]] = []
        for one in self.assemblies(angle):
            chosen: dict[str, int | None] = {
                name: getattr(one, name) for name in SELECTORS if hasattr(one, name)
            }
            listed.append((chosen, {name: place[0] for name, place in one.positions([angle]).items()}))
        return listed

    @abstractmethod
    def _motion(self, angles: Array, speed: Array, acceleration: Array, detail: Detail) -> Motion:
        """Return the motion at one chunk of crank angles, NaN where the loop does not close."""

    def variants(self) -> Mapping[str, Self]:
        """Return what is validated besides this mechanism itself: name -> the same with something changed."""
        return {}

    def positions(self, angles: ArrayLike) -> dict[str, Array]:
        """Return the tracked points at crank angles: name -> (n, 3) in [m].

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.
        """
        parts = self._parts(angles, 0.0, 0.0, "places")
        names = parts[0].points
        places = {name: np.concatenate([part.points[name].position for part in parts]) for name in names}
        if not all(np.isfinite(place).all() for place in places.values()):
            self._require_finite(join(parts))
        return places

    def solve(
        self,
        angles: ArrayLike,
        speed: ArrayLike = 1.0,
        acceleration: ArrayLike = 0.0,
        *,
        links: bool = True,
    ) -> Motion:
        """Return the motion at crank angles, in closed form.

        Args:
            angles: crank angles, (n,) in [rad], in any order.
            speed: crank speed, scalar or (n,) in [rad/s].
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            links: False leaves out links and joints, for speed where only points are wanted.

        Returns:
            Poses, velocities and accelerations of tracked points, links and joints, ground frame, SI.

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.

        Accuracy: loops close to 8 ulp of the longest link; rates by the differentiated loop
            equations, relative error a few ulp divided by the sine of the transmission angle.
        """
        return self._chunked(angles, speed, acceleration, "links" if links else "rates")

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the assemblies meet, in [rad]; empty if the crank turns fully."""
        arcs = self.crank_range()
        return () if arcs.full else tuple(end for arc in arcs.arcs for end in arc)

    def guess(self) -> tuple[dict[str, Pose], float]:
        """Return link poses at a crank angle well inside the range, and that angle in [rad]."""
        start = self._start()
        motion = self._motion(np.array([start]), np.zeros(1), np.zeros(1), "links")
        return {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}, start

    def _start(self) -> float:
        """Return the crank angle of the guess in [rad]."""
        arcs = self.crank_range()
        if not arcs.arcs:
            raise AssemblyError(f"{self.name}: the loops close at no crank angle; change the dimensions")
        return arcs.start()

    def _chunked(
        self, angles: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, detail: Detail
    ) -> Motion:
        motion = join(self._parts(angles, speed, acceleration, detail))
        self._require_finite(motion)
        return replace(motion, origin=self)

    def _parts(
        self, angles: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, detail: Detail
    ) -> list[Motion]:
        """Return the motion chunk by chunk, not yet judged: NaN where the loop does not close."""
        try:
            angles = np.atleast_1d(np.asarray(angles, dtype=np.float64))
        except (TypeError, ValueError):
            angles = np.array([np.nan])
        if angles.ndim != 1 or angles.size == 0 or not np.isfinite(angles).all():
            raise InputError(
                f"{self.name}: crank angles must be a list of finite numbers, not of shape {angles.shape} "
                "or with NaN; give angles in [rad]"
            )
        speed = _rate(self.name, "speed", speed, angles.shape)
        acceleration = _rate(self.name, "acceleration", acceleration, angles.shape)
        parts = [slice(start, start + CHUNK) for start in range(0, len(angles), CHUNK)]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return [self._motion(angles[i], speed[i], acceleration[i], detail) for i in parts]

    def _require_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where a closed form gave no number."""
        for point in motion.points.values():
            closed = np.isfinite(point.position).all(1)
            if not closed.all():
                arcs = self.crank_range()
                where = f"it can stand {arcs}" if arcs.arcs else "it can close nowhere in the turn"
                raise AssemblyError(
                    f"{self.name}: the loop does not close at crank angle "
                    f"{motion.angle[np.argmin(closed)]:.6g} rad; {where}; "
                    "change the dimensions or stay inside the range"
                )
        for point in motion.points.values():
            bounded = np.isfinite(point.acceleration).all(1)
            if not bounded.all():
                raise AssemblyError(
                    f"{self.name}: crank angle {motion.angle[np.argmin(bounded)]:.6g} rad is a dead centre, "
                    "where rates have no bound; keep away from it"
                )
        for name, link in motion.links.items():
            held = np.isfinite(link.rotation[:, 0]).all(1) & np.isfinite(link.angular_acceleration[:, 0])
            if not held.all():
                raise AssemblyError(
                    f"{self.name}: nothing can hold link {name!r} at crank angle "
                    f"{motion.angle[np.argmin(held)]:.6g} rad; change the angles of its guide"
                )


@dataclass(frozen=True, kw_only=True)
class TwoBranchForm(ClosedForm):
    """A drive whose loop closes in two ways, told apart by the parameter `branch`.

    A subclass gives `margin`, whose sign changes are the dead centres.
    """

    margin_degree: ClassVar[int] = 2

    @abstractmethod
    def margin(self, angles: ArrayLike) -> Array:
        """Return how far each crank angle is from a dead centre, (n,); negative where the loop cannot close.

        A trigonometric polynomial of the crank angle of degree `margin_degree`, so that its roots,
        the dead centres, are found exactly.
        """

    def crank_range(self) -> Arcs:
        return reachable_arcs(self.margin, self.margin_degree)

    def _start(self) -> float:
        start, arcs = super()._start(), self.crank_range()
        spread = np.concatenate([np.linspace(low, high, 25) for low, high in arcs.arcs])
        margins = self.margin(spread)
        # where the assemblies meet, as in a parallelogram laid flat, no guess tells them apart
        if self.margin(np.array([start]))[0] > 1e-3 * margins.max():
            return start
        return float(spread[np.argmax(margins)])

    def assemblies(self, angle: float) -> Sequence[Self]:
        if not self.margin(np.array([angle]))[0] >= 0.0:
            return []
        return [replace(self, branch=branch) for branch in (1, -1)]


def _check(mechanism: str, name: str, value: Any, default: Any, rule: Mapping[str, Any]) -> Any:
    """Return a parameter as it is to be kept; raise InputError for what its declaration does not allow."""
    if "options" in rule:
        if np.ndim(value) != 0 or value not in rule["options"]:
            options = " or ".join(str(option) for option in rule["options"])
            raise InputError(f"{mechanism}: {name} is {value!r}; it can be {options}")
        return value
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    shape, most = np.shape(default), HUGE if rule["unit"] == "m" else np.inf
    if numbers.shape != shape or not (np.abs(numbers) < most).all():
        count = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise InputError(f"{mechanism}: {name} is {value} {rule['unit']}; give {count}{_below(most)}")
    if rule.get("positive") and not float(numbers) > 1.0 / HUGE:
        raise InputError(
            f"{mechanism}: {name} is {value} {rule['unit']}; give a length above 0, {1.0 / HUGE:g} m at least"
        )
    if shape:
        return tuple(numbers.tolist())
    return value.item() if isinstance(value, np.generic) else value


def _rate(mechanism: str, what: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return a crank rate for each crank angle; raise InputError for what is none."""
    try:
        rate = np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
    except (TypeError, ValueError):
        rate = np.full(shape, np.nan)
    if not (np.abs(rate) < HUGE).all():
        raise InputError(
            f"{mechanism}: the crank's {what} must be one finite number{_below(HUGE)}, or one for each of "
            f"the {shape[0]} crank angles; give it in SI units"
        )
    return rate


def _below(most: float) -> str:
    return f" below {most:g}" if most < np.inf else ""
