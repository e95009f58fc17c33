"""The solver of a mechanism's motion: what formulas of the catalogue and loop equations have in common."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.path_instants import path_instants
from mechsim.analytic.vector_method.trig_polynomial import Arcs
from mechsim.errors import InputError
from mechsim.model.forces import Forces
from mechsim.model.limits import NO_RANGES, Ranges
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import ChangePointPolicy, Motion
from mechsim.model.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.units import WrittenUnits

# selectors of an assembly mode, None for one that no parameter selects, and its tracked points, (3,) in [m]
AssemblyPoints = tuple[dict[str, int | None], dict[str, Array]]


class KinematicSolver(ABC):
    """Solver of the motion of a mechanism in one assembly mode.

    The path parameter is the crank angle in [rad], or under motion laws the time multiplied by their rate.

    Attributes:
        mechanism: the mechanism, with a guess that selects the assembly mode.
        change_point: policy "smooth" or "branch" at change points.
        motion_laws: motion laws of the drivers; `CRANK` for a crank at any speed.
        forces: forces of the description; None if it defines none.
        formula: FILE.py:FUNCTION of the user's own model; empty if there is none.
        ranges: joint -> limits of its coordinate, in [m] or [rad].
        restitution: joint -> coefficient of restitution at its limits; others have that of the run.
        written: units that its file declares.
        initial: initial state of forward dynamics, J.q and J.v of coordinates, in SI; empty for none.
        facts: sentences on what of its file is not read, on changes, and on the assembly.
        source: the MJCF model as read (`MjcfModel`); None for any other mechanism.
        method: how the motion is found, in words.
        own_start: whether formulas give a start in the assembly mode that the parameters select; otherwise a
            start is sought, and the motion followed from there.
        theories: studies that exist only for some mechanisms: "coupler line", "velocity plan".
        about: one sentence on a mechanism of the catalogue; empty for others.
        gear: parameter that is a gear ratio; empty if there is none.
    """

    mechanism: Mechanism
    change_point: ChangePointPolicy
    motion_laws: MotionLaws = CRANK
    forces: Forces | None = None
    formula: str = ""
    ranges: Ranges = NO_RANGES
    restitution: Mapping[str, float] = MappingProxyType({})
    written: WrittenUnits = WrittenUnits()
    initial: Mapping[str, float | tuple[float, ...]] = MappingProxyType({})
    facts: tuple[str, ...] = ()
    source: Any = None
    method: str = "loop equations"
    own_start: bool = False
    theories: frozenset[str] = frozenset()
    about: str = ""
    gear: str = ""

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.mechanism.name

    @property
    @abstractmethod
    def period(self) -> float:
        """Path parameter after which the configuration repeats, in [rad] of a crank.

        It is two revolutions if the change points lead to another assembly mode; with motion laws it is their
        end.
        """

    @property
    def selectors(self) -> dict[str, int | None]:
        """Parameters that select the assembly mode, with their values."""
        return {}

    @property
    def dimensions(self) -> dict[str, tuple[float, str]]:
        """Dimensions by name, a component of a point as in pivot.x: value in SI, and unit; if they vary."""
        return {}

    @property
    def choices(self) -> tuple[str, ...]:
        """Parameters that are whole numbers or choices, such as an assembly mode."""
        return ()

    @property
    def parameter_rows(self) -> dict[str, tuple[Any, str, str]]:
        """Parameters: name -> value, unit, description."""
        return {}

    @abstractmethod
    def with_mechanism(self, mechanism: Mechanism, **changes: Any) -> "KinematicSolver":
        """Return the solver of another description by its loop equations, with other attributes changed."""

    def with_closed_guess(self) -> "KinematicSolver":
        """Return the solver with a guess that closes the loops, as the start of formulas does."""
        return self

    def with_dimensions(self, values: Mapping[str, float]) -> Self:
        """Return the solver with other `dimensions`."""
        return self

    def described_with(self, values: Mapping[str, float]) -> Mechanism:
        """Return the description with other `dimensions`, which are not checked, without a guess."""
        return self.mechanism

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        """Return the solver with another policy at change points, if it has any; None changes nothing."""
        return self

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the solver in the assembly mode that its parameters select at the first crank angle.

        A guess selects the assembly mode for any first crank angle.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion if all angles are equal.
        """
        return self

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

    @property
    def described(self) -> Mechanism:
        """The description; that of formulas has no guess, which a linkage that cannot close lacks."""
        return self.mechanism

    @abstractmethod
    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, (n,), with its rates."""

    def whole_motion(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion of `solve_along` with virtual links, and outside the ranges of joints too."""
        return self.solve_along(parameter, rate, second)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion at the driver positions of another motion under the same motion laws."""
        return self.solve_along(driven.angle, driven.speed, driven.acceleration)

    def whole_motion_as(self, driven: Motion) -> Motion:
        """Return the motion of `solve_as` with virtual links."""
        return self.solve_as(driven)

    def within_ranges(self, motion: Motion) -> Motion:
        """Return a motion in which every joint stays in its range, also between the instants.

        Raises:
            AssemblyError: names the joint that leaves its range, and the instant.
        """
        return motion

    def positions(
        self, angles: ArrayLike | None = None, *, t: ArrayLike | None = None, speed: float | None = None
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m].

        `t` and `speed` are as in `solve`.

        Raises:
            AssemblyError: where the loops do not close.
            InputError: for crank angles under motion laws.
        """
        return {name: point.position for name, point in self.solve(angles, speed, t=t).points.items()}

    @abstractmethod
    def crank_range(self) -> Arcs:
        """Return the intervals of crank angle in which the loops close in this assembly mode."""

    @abstractmethod
    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the motion must reverse, in [rad]; empty for a full revolution."""

    @abstractmethod
    def change_points(self) -> tuple[float, ...]:
        """Return the crank angles of change points, at which two assembly modes meet, in [-pi, pi) rad."""

    def assemblies(self, angle: float) -> Sequence["KinematicSolver"] | None:
        """Return the mechanism in each real assembly mode at a crank angle; None if no formula has them."""
        return None

    @abstractmethod
    def assembly_points(self, angle: float) -> list[AssemblyPoints]:
        """Return each known assembly mode at a crank angle."""

    def all_assembly_points(
        self, angle: float, candidates: Sequence[Mapping[str, Pose]] | None = None
    ) -> list[AssemblyPoints]:
        """Return every assembly mode at a crank angle, its own first.

        Args:
            angle: in [rad].
            candidates: link -> pose of every assembly; None searches from random starts, unless formulas have
                them all.
        """
        return self.assembly_points(angle)

    def assembly_sign(self, points: Mapping[str, Array]) -> Array:
        """Return the signed geometry that is positive in this assembly mode, (n,); 1 if there is none."""
        return np.ones(len(next(iter(points.values()))))

    def transmission_angle(self, angles: ArrayLike) -> Array | None:
        """Return the transmission angle at crank angles, (n,) in [rad]; None if no formula defines it."""
        return None

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

    def variants(self) -> Mapping[str, "KinematicSolver"]:
        """Return variants that are validated in addition: name -> the mechanism with another parameter."""
        return {}
