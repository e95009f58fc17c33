"""The solver of a mechanism's motion: by its formulas where it has some, else by its loop equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError, SingularStartError, require_known
from mechsim.kinematics.loops.joint_ranges import JointRanges
from mechsim.kinematics.loops.motion import driven_path, solve_along, solve_prescribed
from mechsim.kinematics.loops.path import Instants, LoopPath
from mechsim.kinematics.loops.start import with_closed_guess
from mechsim.kinematics.path_instants import path_instants
from mechsim.mechanism.limits import UNLIMITED, Ranges
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import ChangePointPolicy, Motion, short_repr
from mechsim.mechanism.motion_laws import CRANK, Arcs, MotionLaws, interval_around
from mechsim.numerics.arrays import REVOLUTION, Array, wrapped
from mechsim.units import WrittenUnits

if TYPE_CHECKING:
    from mechsim.kinematics.formulas.closed_form import AssemblyPoints, ClosedForm
    from mechsim.mechanism.forces import Forces

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
class KinematicSolver:
    """Solver of the motion of a mechanism in one assembly mode.

    The path parameter is the crank angle in [rad], or under motion laws the time multiplied by their rate.
    Parameters of formulas are attributes too, as `four_bar.crank`.

    Attributes:
        described: the mechanism; its guess selects the assembly mode. That of formulas has none, which a
            linkage that cannot close lacks.
        parameters: parameter -> value, in the units of the file, of formulas in SI.
        formula: FILE.py:FUNCTION of the user's own model; empty if there is none.
        change_point: policy "smooth" or "branch" at change points.
        forces: applied forces; None if the description defines none.
        initial: initial state of forward dynamics, J.q and J.v of coordinates, in SI; empty for none.
        motion_laws: motion laws of the drivers; `CRANK` for a crank at any speed.
        ranges: joint -> lower and upper limit, in [m] or [rad]; infinite where there is none, as beyond what
            MuJoCo accepts as a number.
        restitution: joint -> coefficient of restitution at its limits; others have that of the run.
        written: units that its file declares.
        comment: first sentence of its file's comment; empty for none.
        facts: sentences on what of its file is not read, on changes, and on the assembly.
        source: the MJCF model as read (`MjcfModel`): the specification that MuJoCo runs, actuators, remarks;
            None for any other mechanism.
        corrected: largest corrections of joints of its file in [m] and [rad] that let the loops close.
        closed_form: formulas that give the motion, and a start in the assembly mode that the parameters
            select; None for a mechanism that is followed from a start by its loop equations.
        loaded_from: source, changed parameters and prescription from which `load` made it; None for one that
            was changed since.
    """

    described: Mechanism
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])
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
    comment: str = ""
    facts: tuple[str, ...] = ()
    source: Any = None
    corrected: tuple[float, float] = (0.0, 0.0)
    closed_form: ClosedForm | None = field(default=None, compare=False)
    loaded_from: Any = field(default=None, init=False, compare=False, repr=False)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.described.joints:
            raise InputError(f"{self.name}: no body can move; give one a joint")
        limits = {
            name: (low if low > -UNLIMITED else -np.inf, high if high < UNLIMITED else np.inf)
            for name, (low, high) in self.ranges.items()
        }
        object.__setattr__(
            self, "ranges", {name: own for name, own in limits.items() if np.isfinite(own).any()}
        )

    @classmethod
    def by_formula(cls, formula: ClosedForm) -> KinematicSolver:
        """Return the solver of a mechanism with formulas."""
        return cls(
            formula.described,
            parameters=formula.values,
            change_point=formula.change_point,
            closed_form=formula,
        )

    def __getattr__(self, name: str) -> Any:
        """Return a parameter of the formulas by its name."""
        formula = vars(self).get("closed_form")
        if formula is None or name not in formula.values:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return formula.values[name]

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.described.name

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism, with a guess that selects the assembly mode."""
        return self.described if self.closed_form is None else self.closed_form.mechanism

    @property
    def method(self) -> str:
        """How the motion is found."""
        return "loop equations" if self.closed_form is None else "closed form"

    @property
    def has_formula(self) -> bool:
        """Whether a formula gives its motion, or FILE.py:FUNCTION a part of it."""
        return self.closed_form is not None or bool(self.formula)

    @property
    def gear(self) -> str:
        """Parameter that is a gear ratio; empty if there is none."""
        return "" if self.closed_form is None else self.closed_form.gear

    @property
    def selectors(self) -> dict[str, int | None]:
        """Parameters that select the assembly mode, with their values."""
        return {} if self.closed_form is None else self.closed_form.selectors

    @property
    def dimensions(self) -> dict[str, tuple[float, str]]:
        """Dimensions by name, a component of a point as in pivot.x: value in SI, and unit; if they vary."""
        return {} if self.closed_form is None else self.closed_form.dimensions

    @property
    def parameter_rows(self) -> dict[str, tuple[Any, str, str]]:
        """Parameters: name -> value, unit, description."""
        if self.closed_form is None:
            return {name: (value, "as written", "") for name, value in self.parameters.items()}
        rows = self.closed_form.declared.rows
        return {name: (value, rows[name].unit, rows[name].doc) for name, value in self.parameters.items()}

    @property
    def period(self) -> float:
        """Path parameter after which the configuration repeats, in [rad] of a crank.

        It is two revolutions if the change points lead to another assembly mode; with motion laws it is their
        end.
        """
        if self.closed_form is not None:
            return self.closed_form.period
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
        """Return the solver of another description by its loop equations, with other attributes changed."""
        if self.closed_form is not None:
            changes = {"parameters": {}, "change_point": "smooth"} | changes
        return replace(self, **{"described": mechanism, "closed_form": None} | changes)

    def by_loop_equations(self, angles: ArrayLike) -> KinematicSolver:
        """Return the solver by its loop equations, in its assembly mode at the first crank angle."""
        if self.closed_form is None:
            return self
        started = self.starting_at(angles)
        return started.with_mechanism(started.mechanism, change_point=started.change_point)

    def with_closed_guess(self) -> Self:
        """Return the solver with a guess that closes the loops, as the start of formulas does."""
        return self.with_mechanism(with_closed_guess(self.mechanism)) if self.closed_form is None else self

    def with_parameters(self, **changes: Any) -> KinematicSolver:
        """Return the solver with other values of some parameters of its formulas, in SI."""
        require_known(f"{self.name} has no parameter", changes, self._formulas.values)
        return self._by(self._formulas.with_parameters(**changes))

    def with_dimensions(self, values: Mapping[str, float]) -> KinematicSolver:
        """Return the solver with other `dimensions`."""
        return self._by(self._formulas.with_dimensions(values))

    def _by(self, formula: ClosedForm) -> KinematicSolver:
        return self if formula is self.closed_form else KinematicSolver.by_formula(formula)

    @property
    def _formulas(self) -> ClosedForm:
        if self.closed_form is None:
            raise InputError(f"{self.name} has no formulas with parameters; load it with other values")
        return self.closed_form

    def with_change_point(self, change_point: ChangePointPolicy | None) -> KinematicSolver:
        """Return the solver with another policy at change points, if it has any; None changes nothing."""
        if self.closed_form is not None:
            return self._by(self.closed_form.with_change_point(change_point))
        return self if change_point in (None, self.change_point) else replace(self, change_point=change_point)

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> KinematicSolver:
        """Return the solver in the assembly mode that its parameters select at the first crank angle.

        A guess selects the assembly mode for any first crank angle.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion if all angles are equal.
        """
        return self if self.closed_form is None else self._by(self.closed_form.starting_at(angles, direction))

    def solve(
        self,
        angles: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike = 0.0,
        *,
        t: ArrayLike | None = None,
        change_point: ChangePointPolicy | None = None,
    ) -> Motion:
        """Return the motion at crank angles, or at times.

        Args:
            angles: crank angles, (n,) in [rad] or text such as "0:360:5deg"; under motion laws use `t`.
            speed: crank speed, scalar or (n,) in [rad/s] or text such as "600rpm"; the default at crank
                angles is 1.
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            t: times, (n,) in [s], of motion laws, or of a crank at a constant `speed` that starts from the
                mechanism's `start` at time zero.
            change_point: policy "smooth" or "branch" at change points; the default is that of the mechanism.
                Rates there are limits; with "branch" they are limits from beyond the change point.

        Returns:
            Poses, velocities and accelerations of tracked points, links and joints, ground frame, SI.

        Raises:
            AssemblyError: where the loops do not close.
            InputError: for crank angles under motion laws.
        """
        solver = self.with_change_point(change_point)
        mechanism = self.described if t is None else self.mechanism
        instants = path_instants(mechanism, self.motion_laws, angles, speed, acceleration, t)
        motion = solver.solve_along(instants.parameter, instants.rate, instants.second)
        return motion if instants.time is None else replace(motion, time=instants.time)

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, (n,), with its rates.

        Raises:
            AssemblyError: where the loops do not close, or a joint would leave its range.
        """
        return written_links(self.within_ranges(self.whole_motion(parameter, rate, second)))

    def whole_motion(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion of `solve_along` with virtual links, and outside the ranges of joints too."""
        if self.closed_form is None:
            return replace(solve_along(self._path, parameter, rate, second, self.motion_laws), origin=self)
        solver = self.starting_at(parameter, float(np.ravel(rate)[0]))
        return replace(solver._formulas.motion(parameter, rate, second), origin=solver)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion at the driver positions of another motion under the same motion laws.

        Raises:
            AssemblyError: where the loops do not close.
        """
        return written_links(self.whole_motion_as(driven))

    def whole_motion_as(self, driven: Motion) -> Motion:
        """Return the motion of `solve_as` with virtual links."""
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
        """Return a motion in which every joint stays in its range, also between the instants.

        Raises:
            AssemblyError: names the joint that leaves its range, and the instant.
        """
        if self.ranges:
            self._joint_ranges.require(motion)
        return motion

    @property
    def _joint_ranges(self) -> JointRanges:
        return JointRanges(self.mechanism, self.ranges, self.whole_motion, self.motion_laws.instant_label)

    def positions(
        self,
        angles: ArrayLike | None = None,
        change_point: ChangePointPolicy | None = None,
        *,
        t: ArrayLike | None = None,
        speed: float | None = None,
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m].

        `change_point`, `t` and `speed` are as in `solve`.

        Raises:
            AssemblyError: where the loops do not close.
            InputError: for crank angles under motion laws.
        """
        solver = self.with_change_point(change_point)
        if solver.closed_form is None:
            return {name: point.position for name, point in solver.solve(angles, speed, t=t).points.items()}
        if t is not None or angles is None:
            angles = path_instants(self.mechanism, CRANK, angles, speed, 0.0, t).parameter
        return solver.closed_form.positions(angles)

    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the loops close in this assembly mode.

        By the loop equations it is the one that can be traced from the start, which ends at dead centres and
        at limits of joints. Under motion laws it is the interval of their path parameter.

        Raises:
            SingularStartError: if the start is a change point.
        """
        return self._range if self.closed_form is None else self.closed_form.crank_range()

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the motion must reverse, in [rad]; empty for a full revolution.

        Dead centres beyond the limits of joints are left out.
        """
        reachable = self.crank_range()
        closing = self._closing_range if self.closed_form is None else reachable
        if closing.full:
            return ()
        reachable_ends = [end for arc in reachable.arcs for end in arc]
        ends = [end for arc in closing.arcs for end in arc]
        return tuple(end for end in ends if any(abs(end - other) < SAME_ANGLE for other in reachable_ends))

    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles of change points, at which two assembly modes meet, in [-pi, pi) rad.

        The motion passes them by the policy `change_point`.
        """
        if self.closed_form is not None:
            return self.closed_form.change_points()
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
            if all(abs(wrapped(np.array(angle - other))) > SAME_CHANGE_POINT for other in distinct):
                distinct.append(angle)
        return tuple(sorted(distinct))

    def assemblies(self, angle: float) -> Sequence[KinematicSolver] | None:
        """Return the mechanism in each real assembly mode at a crank angle; None if no formula has them."""
        if self.closed_form is None:
            return None
        return [self._by(formula) for formula in self.closed_form.assemblies(angle)]

    def assembly_points(self, angle: float) -> list[AssemblyPoints]:
        """Return each known assembly mode at a crank angle; empty where it cannot be assembled."""
        if self.closed_form is not None:
            return self.closed_form.assembly_points(angle)
        with suppress(AssemblyError):
            points = self.solve_along([angle]).points
            return [({}, {name: point.position[0] for name, point in points.items()})]
        return []

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that is positive in this assembly mode, (n,); 1 if there is none."""
        if self.closed_form is None:
            return np.ones(len(next(iter(points.values()))))
        return self.closed_form.assembly_sign(points)

    def transmission_angle(self, angles: ArrayLike) -> Array | None:
        """Return the transmission angle at crank angles, (n,) in [rad]; None if no formula defines it."""
        return None if self.closed_form is None else self.closed_form.transmission_angle(angles)

    def required_transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the transmission angle as `transmission_angle`.

        Raises:
            InputError: if no formula defines it.
        """
        result = self.transmission_angle(angles)
        if result is None:
            raise InputError(
                f"no formula defines a transmission angle of {self.name!r}; "
                "mechanisms of the catalogue have one"
            )
        return result

    def variants(self) -> Mapping[str, KinematicSolver]:
        """Return variants that are validated in addition: name -> the mechanism with another parameter."""
        formulas = {} if self.closed_form is None else self.closed_form.variants()
        return {name: self._by(formula) for name, formula in formulas.items()}

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
        return closing if closing.full and high - low >= REVOLUTION else Arcs.between(low, high)

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
        return Arcs.between(low, high) if high - low > SAME_ANGLE else Arcs(False, ())


def written_links(motion: Motion) -> Motion:
    """Return a motion without the virtual links between several joints of one body of a file."""
    return replace(motion, links={k: v for k, v in motion.links.items() if not k.startswith(VIRTUAL_PREFIX)})
