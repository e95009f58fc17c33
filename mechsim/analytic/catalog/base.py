"""Solvers of the catalogue: the motion in closed form at crank angles or times."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.formulas import SELECTORS, Formulas, checked_rate
from mechsim.analytic.catalog.frame_motion import (
    checked_angles,
    chunks,
    motion_at,
    positions_at,
    require_closed,
    require_finite,
)
from mechsim.analytic.path_instants import path_instants
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

    # what only the file of a mechanism solved by its loop equations states
    motion_laws = CRANK
    forces = None
    formula = ""
    ranges = NO_RANGES
    written = WrittenUnits()

    def assembly_points(self, angle: float) -> list[tuple[dict[str, int | None], dict[str, Array]]]:
        """Return every real assembly at a crank angle: the parameters that select it, and its tracked points.

        Points are (3,) in [m]. A selector is None where no value of it leads to the assembly.
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

        `change_point`, `t` and `speed` are as in `solve`; so is the assembly.

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.
        """
        if t is not None or angles is None:
            angles = path_instants(self.mechanism, CRANK, angles, speed, 0.0, t).parameter
        angles = checked_angles(self.name, angles)
        solver = self.with_change_point(change_point).starting_at(angles)
        pieces = [positions_at(solver, angles[piece]) for piece in chunks(len(angles))]
        points = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        require_closed(self, angles, points)
        return points

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

        The sign of the assembly applies at the first crank angle, as `starting_at` has it.

        Args:
            angles: crank angles, (n,) in [rad], in any order, or text, as "0:360:5deg".
            speed: crank speed, scalar or (n,) in [rad/s], or text, as "600rpm"; None is 1 at crank angles.
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            t: times, (n,) in [s], in place of crank angles: the crank turns at a constant `speed` and stands
                at the mechanism's `start` at time zero.
            links: False leaves out links and joints, for speed where only points are wanted.
            change_point: "smooth" or "branch" at change points; None takes the mechanism's own. Rates
                there are limits, of a fold those beyond it.

        Returns:
            Poses, velocities and accelerations of tracked points, links and joints, ground frame, SI.

        Raises:
            AssemblyError: where the loop cannot close; says over which part of the turn it can.

        Accuracy: loops close to 8 ulp of the longest link; rates are carried through the formula of
            the pose, relative error a few ulp divided by the sine of the transmission angle.
        """
        time = None
        if t is not None or angles is None:
            instants = path_instants(self.mechanism, CRANK, angles, speed, acceleration, t)
            angles, speed, time = instants.parameter, instants.rate, instants.time
        angles = checked_angles(self.name, angles)
        speed = checked_rate(self.name, "speed", 1.0 if speed is None else speed, angles.shape)
        acceleration = checked_rate(self.name, "acceleration", acceleration, angles.shape)
        solver = self.with_change_point(change_point).starting_at(angles, float(speed[0]))
        pieces = [
            motion_at(solver, Jet(angles[piece], speed[piece], acceleration[piece]), links=links)
            for piece in chunks(len(angles))
        ]
        motion = join(pieces)
        self.check_finite(motion)
        return replace(motion, time=time, origin=solver)

    def solve_along(self, parameter: ArrayLike, rate: ArrayLike = 1.0, second: ArrayLike = 0.0) -> Motion:
        """Return the motion at values of the path parameter, which is the crank angle; as `solve`."""
        return self.solve(parameter, rate, second)

    def solve_as(self, driven: Motion) -> Motion:
        """Return the motion where the crank of another motion was."""
        return self.solve(driven.angle, driven.speed, driven.acceleration)

    def dead_centres(self) -> tuple[float, ...]:
        """Return the crank angles at which the assemblies meet, in [rad]; empty if the crank turns fully."""
        arcs = self.crank_range()
        return () if arcs.full else tuple(end for arc in arcs.arcs for end in arc)

    @property
    def period(self) -> float:
        """Crank angle in [rad] after which the mechanism stands as before, if the crank gets so far.

        It is two turns where the linkage passes one change point a turn, or any other odd number.
        """
        return REVOLUTION

    @property
    def change_point(self) -> ChangePointPolicy:
        """How the motion continues at change points."""
        return "smooth"

    def with_change_point(self, change_point: ChangePointPolicy | None) -> Self:
        """Return the mechanism that goes on so where assemblies meet; None, or none meet: as it is."""
        return self

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> Self:
        """Return the mechanism whose assembly is the one that its parameters select at the first crank angle.

        Only change points make a difference: past one the sign of an assembly is another. At a change point
        the configurations right after it count. What this returns keeps its assembly at all crank angles.

        Args:
            angles: crank angles in the order of the motion, (n,) in [rad].
            direction: sign of the crank's motion, where the angles are all one.
        """
        checked_angles(self.name, angles)
        return self

    def check_finite(self, motion: Motion) -> None:
        """Raise AssemblyError where the closed form gave no number."""
        require_finite(self, motion)
