"""A mechanism solved by its loop equations."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.assemblies import other_assemblies
from mechsim.analytic.loops.motion import (
    driven_path,
    solve_along,
    solve_prescribed,
)
from mechsim.analytic.loops.path import Instants, LoopPath
from mechsim.analytic.loops.start import with_closed_guess
from mechsim.analytic.solvers import AssemblyPoints, KinematicSolver
from mechsim.analytic.vector_method.trig_polynomial import Arcs
from mechsim.errors import AssemblyError, SingularStartError
from mechsim.model.forces import Forces
from mechsim.model.limits import INSTANTS, Ranges, check_instants, extremes, require_within
from mechsim.model.links import VIRTUAL_PREFIX, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion, short_repr
from mechsim.model.motion_laws import CRANK, MotionLaws, interval_around
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root
from mechsim.numerics.rounding import ROUNDING
from mechsim.units import WrittenUnits


@dataclass(frozen=True, slots=True)
class JointRanges:
    """Limits of joints, checked over a motion.

    Attributes:
        mechanism: the mechanism.
        ranges: joint -> lower and upper limit, in [m] or [rad].
        solve: path parameters (n,) -> motion.
        label: path parameter -> name of the instant in messages.
    """

    mechanism: Mechanism
    ranges: Ranges
    solve: Callable[[Array], Motion]
    label: Callable[[float], str]

    def require(self, motion: Motion) -> None:
        """Raise AssemblyError for a motion in which a joint leaves its range, between instants too."""
        if motion.speed.any() and np.ptp(motion.angle) > 0.0:
            # instants at which the loops do not close are not part of the request
            dense = None
            with suppress(AssemblyError):
                dense = self._with_extremes(check_instants(motion.angle.min(), motion.angle.max()))
            if dense is not None:
                self._require(*dense)
        self._require(motion.angle, {name: joint.value for name, joint in motion.joints.items()})

    def reach(self, start: float, end: float) -> float | None:
        """Return the crank angle reached from a start towards an end, in [rad]; None if there is none."""
        parameters, values = self._with_extremes(np.linspace(min(start, end), max(start, end), INSTANTS + 1))
        if not values:
            return end
        if end < start:
            parameters, values = parameters[::-1], {name: value[::-1] for name, value in values.items()}
        excess = self._excess(values)
        widths = (high - low for low, high in (self.ranges[name] for name in values))
        slack = ROUNDING * max([1.0, *(width for width in widths if width < np.inf)])
        if not (excess > slack).any():
            return end
        first = int(np.argmax(excess > slack))
        if first == 0:
            return None
        inside, outside = float(parameters[first - 1]), float(parameters[first])
        if excess[first - 1] >= 0.0:
            return inside
        return root(
            lambda angle: float(self._excess(self._values(np.array([angle])))[0]), *sorted((inside, outside))
        )

    def _excess(self, values: Mapping[str, Array]) -> Array:
        """Return the largest violation of a joint range, (n,); negative within all ranges."""
        limits = [(value, *self.ranges[name]) for name, value in values.items()]
        return np.max([np.maximum(low - value, value - high) for value, low, high in limits], axis=0)

    def _with_extremes(self, instants: Array) -> tuple[Array, dict[str, Array]]:
        """Return path parameters (n,) with those of the extrema in between, and the joint values there."""
        values = self._values(instants)
        between = extremes(instants, values.values())
        if not len(between):
            return instants, values
        more = self._values(between)
        order = np.argsort(parameters := np.concatenate([instants, between]), kind="stable")
        return parameters[order], {name: np.concatenate([values[name], more[name]])[order] for name in values}

    def _values(self, parameter: Array) -> dict[str, Array]:
        joints = self.solve(parameter).joints
        return {name: joints[name].value for name in self.ranges if name in joints}

    def _require(self, parameter: Array, values: Mapping[str, Array]) -> None:
        require_within(
            self.mechanism.name,
            self.ranges,
            values,
            {name: self.mechanism.unit(name) for name in self.ranges},
            lambda index: self.label(float(parameter[index])),
            "move the drivers less",
        )


# crank angles nearer than this are equal
SAME_ANGLE = 1e-9
# change points nearer than this in [rad] are one; those of several pairs at once are located to 5e-10
SAME_CHANGE_POINT = 1e-7
# crank angle in [rad] by which a revolution is traced beyond its end to find a change point there
OVERLAP = 1e-2
# largest displacement of links after a revolution, in characteristic lengths and axis components, that counts
# as periodic; another assembly mode is farther
SAME_POSE = 1e-6


@dataclass(frozen=True)
class LoopForm(KinematicSolver):
    """A mechanism solved by its loop-closure equations.

    Attributes:
        mechanism: the mechanism; its guess selects the assembly mode.
        parameters: parameter name -> value, in the units of the file.
        formula: FILE.py:FUNCTION of the user's own model; empty if there is none.
        change_point: policy at change points.
        forces: applied forces; None if the file defines none.
        initial: initial state of forward dynamics, J.q and J.v of coordinates in SI; empty for none.
        motion_laws: motion laws of the drivers; `CRANK` for a crank at any speed.
        ranges: joint -> lower and upper limit, in [m] or [rad]; infinite where there is none.
        restitution: joint -> coefficient of restitution at its limits; others have that of the run.
        written: units that its file declares.
        facts: sentences on what of its file is not read, on changes, and on the assembly.
        source: the MJCF model as read (`MjcfModel`): the specification that MuJoCo runs, actuators, remarks;
            None for any other mechanism.
        corrected: largest corrections of joints of its file in [m] and [rad] that let the loops close.
    """

    mechanism: Mechanism
    parameters: Mapping[str, float] = field(default_factory=dict[str, float])
    formula: str = ""
    change_point: ChangePointPolicy = "smooth"
    forces: Forces | None = None
    initial: Mapping[str, float | tuple[float, ...]] = field(
        default_factory=dict[str, float | tuple[float, ...]]
    )
    motion_laws: MotionLaws = CRANK
    ranges: Ranges = field(default_factory=dict[str, tuple[float, float]])
    restitution: Mapping[str, float] = field(default_factory=dict[str, float])
    written: WrittenUnits = WrittenUnits()
    facts: tuple[str, ...] = ()
    source: Any = None
    corrected: tuple[float, float] = (0.0, 0.0)

    __repr__ = short_repr

    @property
    def period(self) -> float:
        if not self.motion_laws.crank:
            return self.motion_laws.length
        if self.change_point != "smooth" or not self._range.full or not self._path.change_points:
            return REVOLUTION
        return REVOLUTION if self._periodic_in_a_revolution() else 2.0 * REVOLUTION

    def _periodic_in_a_revolution(self) -> bool:
        """Whether all links return after a revolution; with gears, after an even number of mode changes."""
        if self.mechanism.laws:
            return len(self.change_points()) % 2 == 0
        start = self.mechanism.start
        revolution = self.solve([start, start + REVOLUTION])
        links = [link for name, link in revolution.links.items() if name not in revolution.spinning]
        displacements = [
            np.ptp(link.position, axis=0).max() / self.mechanism.characteristic_length for link in links
        ]
        return max(*displacements, *(np.ptp(link.rotation, axis=0).max() for link in links)) < SAME_POSE

    def with_mechanism(self, mechanism: Mechanism, **changes: Any) -> Self:
        return replace(self, mechanism=mechanism, **changes)

    def with_closed_guess(self) -> Self:
        return self.with_mechanism(with_closed_guess(self.mechanism))

    @property
    def parameter_rows(self) -> dict[str, tuple[Any, str, str]]:
        return {name: (value, "as written", "") for name, value in self.parameters.items()}

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        return self if change_point in (None, self.change_point) else replace(self, change_point=change_point)

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, (n,), with its rates.

        The path parameter is the crank angle in [rad], or under motion laws the time multiplied by
        `motion_laws.rate`.

        Raises:
            AssemblyError: where the loops do not close, or a joint would leave its range.
        """
        return written_links(self.within_ranges(self.whole_motion(parameter, rate, second)))

    def whole_motion(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        return replace(solve_along(self._path, parameter, rate, second, self.motion_laws), origin=self)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion at the driver positions of another motion under the same motion laws.

        Raises:
            AssemblyError: where the loops do not close.
        """
        return written_links(self.whole_motion_as(driven))

    def whole_motion_as(self, driven: Motion) -> Motion:
        if self.motion_laws.crank:
            return self.whole_motion(driven.angle, driven.speed, driven.acceleration)
        drivers = [driven.joints[name] for name in self.motion_laws.drivers]
        instants = Instants(
            driven.angle,
            driven.speed,
            driven.acceleration,
            np.array([driver.value for driver in drivers]),
            np.array([driver.rate for driver in drivers]),
            np.array([driver.acceleration for driver in drivers]),
        )
        return replace(solve_prescribed(self._path, self.motion_laws, instants), origin=self)

    def within_ranges(self, motion: Motion) -> Motion:
        if not self.ranges:
            return motion
        self._joint_ranges.require(motion)
        return motion

    @property
    def _joint_ranges(self) -> JointRanges:
        return JointRanges(self.mechanism, self.ranges, self.whole_motion, self.motion_laws.instant_label)

    def crank_range(self) -> Arcs:
        """Return the interval of crank angle in which this assembly mode can be traced from its start.

        It ends at dead centres, and at limits of joints. Under motion laws it is the interval of their path
        parameter.

        Raises:
            SingularStartError: if the start is a change point.
        """
        return self._range

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles of dead centres, in [rad]; empty for a full revolution.

        Dead centres beyond the limits of joints are left out.
        """
        closing, reachable = self._closing_range, self._range
        if closing.full:
            return ()
        reachable_ends = [end for arc in reachable.arcs for end in arc]
        ends = [end for arc in closing.arcs for end in arc]
        return tuple(end for end in ends if any(abs(end - other) < SAME_ANGLE for other in reachable_ends))

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles of change points, in [-pi, pi) rad.

        The motion passes them by the policy `change_point`.
        """
        if not self.motion_laws.crank:
            return tuple(sorted(point for point in self._path.change_points if 0.0 <= point <= self.period))
        start, full = self.mechanism.start, self._range.full
        end = start + REVOLUTION + OVERLAP
        if full:
            # by rounding, a change point at the start lies before or after the end of the revolution
            with suppress(AssemblyError):
                self._path.extend(end)
        within = [point for point in self._path.change_points if start <= point < end or not full]
        around = None if full else interval_around(self._range, start)
        if around is not None:
            within = [point for point in within if around[0] <= point <= around[1]]
        distinct: list[float] = []
        for point in within:
            angle = float((point + np.pi) % REVOLUTION - np.pi)
            if all(
                abs((angle - other + np.pi) % REVOLUTION - np.pi) > SAME_CHANGE_POINT for other in distinct
            ):
                distinct.append(angle)
        return tuple(sorted(distinct))

    def assembly_points(self, angle: float) -> list[AssemblyPoints]:
        """Return the known assembly mode: tracked points, (3,) in [m]; empty where it cannot be assembled."""
        with suppress(AssemblyError):
            points = self.solve_along([angle]).points
            return [({}, {name: point.position[0] for name, point in points.items()})]
        return []

    def all_assembly_points(
        self, angle: float, candidates: Sequence[Mapping[str, Pose]] | None = None
    ) -> list[AssemblyPoints]:
        own = self.assembly_points(angle)
        links = [self.whole_motion([angle]).links] if own else []
        others = other_assemblies(self._path, angle, self.ranges, links, candidates)
        return own + [({}, points) for points in others]

    @cached_property
    def _path(self) -> LoopPath:
        return driven_path(self.mechanism, self.motion_laws, self.change_point)

    @cached_property
    def _range(self) -> Arcs:
        closing, start = self._closing_range, self.mechanism.start
        if not self.ranges or not self.motion_laws.crank or not closing.arcs:
            return closing
        around = (start - REVOLUTION, start + REVOLUTION) if closing.full else interval_around(closing, start)
        if around is None:
            return closing
        low, high = around
        ends = [self._range_end(start, end) for end in (low, high)]
        if ends == [low, high] or None in ends:
            return closing
        low, high = (float(end) for end in ends if end is not None)
        if closing.full and high - low >= REVOLUTION:
            return closing
        revolution = REVOLUTION * np.floor((low + np.pi) / REVOLUTION)
        return Arcs(False, ((low - revolution, high - revolution),))

    def _range_end(self, start: float, end: float) -> float | None:
        """Return the crank angle reached from its start towards an angle, in [rad]; None if there is none."""
        inner = start + (end - start) * (1.0 - SAME_ANGLE)
        if abs(inner - start) < SAME_ANGLE:
            return end
        reached = self._joint_ranges.reach(start, inner)
        return end if reached == inner else reached

    @cached_property
    def _closing_range(self) -> Arcs:
        """Interval of crank angle in which the loops close."""
        path, start = self._path, self.mechanism.start
        if not self.motion_laws.crank:
            path.extend(self.period)
            return Arcs(False, ((0.0, self.period),))
        ends, singular = list[float](), list[SingularStartError]()
        for direction in (1, -1):
            try:
                path.extend(start + direction * REVOLUTION)
            except SingularStartError as error:
                singular.append(error)
            except AssemblyError:
                pass
            else:
                return Arcs(True, ((-np.pi, np.pi),))
            ends.append(float(path.segments[direction][-1].nodes[-1]) if path.segments[direction] else start)
        if len(singular) == 2:
            raise singular[0]
        high, low = ends
        revolution = REVOLUTION * np.floor((low + np.pi) / REVOLUTION)
        return Arcs(False, ((low - revolution, high - revolution),) if high - low > SAME_ANGLE else ())


def written_links(motion: Motion) -> Motion:
    """Return a motion without the virtual links between several joints of one body of a file."""
    return replace(motion, links={k: v for k, v in motion.links.items() if not k.startswith(VIRTUAL_PREFIX)})
