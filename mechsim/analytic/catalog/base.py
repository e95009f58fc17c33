"""Solvers of the catalogue: the motion in closed form at crank angles or times."""

from dataclasses import dataclass, replace
from typing import Self

from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.catalog.formulas import (
    SELECTORS,
    Formulas,
    chunks,
    motion_at,
    require_closed,
    require_finite,
)
from mechsim.analytic.path_instants import crank_angles, crank_rate, path_instants
from mechsim.model.limits import NO_RANGES
from mechsim.model.motion import ChangePointPolicy, Motion, join
from mechsim.model.motion_laws import CRANK
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet
from mechsim.units import WrittenUnits


@dataclass(frozen=True, kw_only=True)
class ClosedForm(Formulas):
    """A catalogue mechanism with a driven crank and a closed form."""

    # only a mechanism solved by its loop equations, from a file, can have these
    motion_laws = CRANK
    forces = None
    formula = ""
    ranges = NO_RANGES
    written = WrittenUnits()

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly mode at a crank angle: its selectors and its tracked points.

        Points are (3,) in [m]. A selector is None if no value of it selects the mode.
        """
        listed: list[tuple[dict[str, int | None], dict[str, Array]]] = []
        for assembly in self.assemblies(angle):
            chosen: dict[str, int | None] = {
                name: getattr(assembly, name) for name in SELECTORS if hasattr(assembly, name)
            }
            listed.append((chosen, {name: point[0] for name, point in assembly.positions([angle]).items()}))
        return listed

    def positions(
        self,
        angles: ArrayLike | None = None,
        change_point: ChangePointPolicy | None = None,
        *,
        t: ArrayLike | None = None,
        speed: float | None = None,
    ) -> dict[str, Array]:
        """Return the tracked points at crank angles, or at times: name -> (n, 3) in [m].

        `change_point`, `t`, `speed` and the assembly mode are as in `solve`.

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.
        """
        if t is not None or angles is None:
            angles = path_instants(self.mechanism, CRANK, angles, speed, 0.0, t).parameter
        angles = crank_angles(self.name, angles)
        solver = self.with_change_point(change_point).starting_at(angles)
        motion = join(
            [motion_at(solver, angles[piece], links=False, joints=False) for piece in chunks(len(angles))]
        )
        points = {name: point.position for name, point in motion.points.items()}
        require_closed(self, angles, points)
        return points

    def transmission_angle(self, angles: ArrayLike) -> Array:
        """Return the angle of `transmission_at` at crank angles, (n,) in [rad]."""
        return self.transmission_at(crank_angles(self.name, angles), self.positions(angles))

    def solve(
        self,
        angles: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike = 0.0,
        *,
        t: ArrayLike | None = None,
        links: bool = True,
        change_point: ChangePointPolicy | None = None,
    ) -> Motion:
        """Return the motion at crank angles, or at times, in closed form.

        The sign of the assembly mode applies at the first crank angle, as in `starting_at`.

        Args:
            angles: crank angles, (n,) in [rad], in any order, or text such as "0:360:5deg".
            speed: crank speed, scalar or (n,) in [rad/s], or text such as "600rpm"; the default at crank
                angles is 1.
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            t: times, (n,) in [s], instead of crank angles: the crank rotates at a constant `speed` from the
                mechanism's `start` at time zero.
            links: False leaves out links and joints, which is faster.
            change_point: policy "smooth" or "branch" at change points; the default is that of the mechanism.
                Rates there are limits; with "branch" they are limits from beyond the change point.

        Returns:
            Poses, velocities and accelerations of tracked points, links and joints, ground frame, SI.

        Raises:
            AssemblyError: where the loop cannot close; states the interval in which it can.

        Accuracy: loops close to 8 ulp of the longest link. Rates are exact derivatives of the formula of
            the pose; their relative error is a few ulp divided by the sine of the transmission angle.
        """
        time = None
        if t is not None or angles is None:
            instants = path_instants(self.mechanism, CRANK, angles, speed, acceleration, t)
            angles, speed, time = instants.parameter, instants.rate, instants.time
        angles = crank_angles(self.name, angles)
        speed = units.si(1.0 if speed is None else speed, "rad/s", "the crank's speed")
        speed = crank_rate(self.name, "speed", speed, len(angles))
        acceleration = crank_rate(self.name, "acceleration", acceleration, len(angles))
        solver = self.with_change_point(change_point).starting_at(angles, float(speed[0]))
        crank = Jet(angles, speed, acceleration)
        motion = join(
            [
                motion_at(solver, crank[piece], links=links, joints=links, origin=solver)
                for piece in chunks(len(angles))
            ]
        )
        self.check_finite(motion)
        return motion if time is None else replace(motion, time=time)

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, which is the crank angle; as `solve`."""
        return self.solve(parameter, rate, second)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion at the crank angles, speeds and accelerations of another motion."""
        return self.solve(driven.angle, driven.speed, driven.acceleration)

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles of dead centres, in [rad]; empty if the crank rotates fully."""
        arcs = self.crank_range()
        return () if arcs.full else tuple(end for arc in arcs.arcs for end in arc)

    @property
    def period(self) -> float:
        """Crank angle in [rad] after which the configuration repeats.

        It is two revolutions if the linkage passes an odd number of change points per revolution.
        """
        return REVOLUTION

    @property
    def change_point(self) -> ChangePointPolicy:
        """Policy at change points."""
        return "smooth"

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        """Return the mechanism with another policy at change points, if it has any; None changes nothing."""
        return self

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the mechanism in the assembly mode that its parameters select at the first crank angle.

        This matters only with change points, beyond which the sign of the mode differs. At a change point the
        sign applies right after it. The result keeps its assembly mode at all crank angles.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion if all angles are equal.
        """
        crank_angles(self.name, angles)
        return self

    def check_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where the closed form has no finite rates."""
        require_finite(self, motion)
