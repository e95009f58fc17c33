"""Dynamic model: a mechanism with masses, the forces on it, and the solver of its motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.unit_motion import UnitMotion, from_motion
from mechsim.mechanism.forces import Forces, forces_of
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.masses import STEEL, LinkMass, masses_of, with_inertia
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion, at_unit_speed, short_repr
from mechsim.mechanism.motion_laws import MotionLaws
from mechsim.numerics.arrays import Array

# number of sources and models that are not set up again when they run again
REPEATED = 4


@dataclass(frozen=True, slots=True, eq=False)
class DynamicModel:
    """A mechanism with masses and forces; made by `dynamic_model`.

    Two models are equal if they are one object, for which equations are kept.

    Attributes:
        mechanism: the mechanism; every link has an inertia.
        forces: applied forces.
        solver: solver of its motion: a closed form, or the loop equations.
    """

    mechanism: Mechanism
    forces: Forces
    solver: KinematicSolver

    __repr__ = short_repr

    @property
    def masses(self) -> tuple[LinkMass, ...]:
        """The masses of the links and their sources."""
        return masses_of(self.mechanism)

    def unit_motion(
        self, angles: ArrayLike, as_run: Motion | None = None, *, within: bool = False
    ) -> UnitMotion:
        """Return poses, first and second derivatives by the path parameter, at path parameters (n,) in [rad].

        Under motion laws, the drivers have their positions in the run `as_run`, if given. With `within`,
        poses outside the ranges of joints are rejected.

        Raises:
            AssemblyError: if the loops do not close, or a joint would leave its range.
        """
        values = np.atleast_1d(np.asarray(angles, dtype=np.float64))
        if as_run is None or not as_run.drivers:
            motion = self._counted(self.solver.whole_motion(values), values)
        else:
            motion = self.solver.whole_motion_as(at_unit_speed(as_run))
        return from_motion(self.mechanism, self.solver.within_ranges(motion) if within else motion)

    def _counted(self, motion: Motion, angles: Array) -> Motion:
        """Return a motion in which hinges with springs count revolutions; formulas have them within one."""
        mechanism = self.solver.mechanism
        names = [n for n in self.forces.uncut if mechanism.unit(n) == "rad" and n not in mechanism.drivers]
        if not names or self.solver.closed_form is None:
            return motion
        by_loops = self.solver.by_loop_equations(angles).whole_motion(angles)
        return replace(motion, joints={**motion.joints, **{name: by_loops.joints[name] for name in names}})

    def starting_at(self, angles: ArrayLike, direction: float = 1.0) -> DynamicModel:
        """Return the model in the assembly mode that is selected at the first crank angle."""
        solver = self.solver.starting_at(angles, direction)
        mechanism = self.mechanism.with_guess(solver.mechanism.guess, solver.mechanism.start)
        return replace(self, mechanism=mechanism, solver=solver)

    def with_forces(self, forces: Forces) -> DynamicModel:
        """Return the same mechanism under other forces."""
        forces.check(self.mechanism)
        _check_crank(self.mechanism, forces, self.solver.motion_laws)
        return replace(self, forces=forces)


def dynamic_model(
    source: KinematicSolver | Mechanism,
    forces: Forces | None = None,
    *,
    mechanism: Mechanism | None = None,
    density: float = STEEL,
    diameter: float | str | None = None,
) -> DynamicModel:
    """Return a catalogue mechanism, or any other, as a dynamic model: the last one of the same objects.

    Args:
        source: a catalogue mechanism, solved by its closed form, or any mechanism, solved by its loop
            equations.
        forces: applied forces; the default is those of the source, such as a file's `[forces]`, or
            else gravity of 9.81 m/s2 along -y. `Forces()` means none.
        mechanism: the description of the catalogue mechanism with other inertias.
        density: density of the rods that replace missing inertias, in [kg/m3].
        diameter: diameter of those rods in [m] or text such as "5mm"; the default is 0.05 of the
            characteristic length.

    Raises:
        InputError: for forces at unknown joints, points or links, and for the policy "branch" at change
            points, where speeds of links would be discontinuous.
    """
    return _made(*map(_Same, (source, forces, mechanism, density, diameter)))


class _Same:
    """An argument that equals another one if both are one object, whose dimensions do not change."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.value is other.value


@lru_cache(maxsize=REPEATED)
def _made(*arguments: _Same) -> DynamicModel:
    source, forces, mechanism, density, diameter = (argument.value for argument in arguments)
    solver = KinematicSolver(source) if isinstance(source, Mechanism) else source
    if not isinstance(solver, KinematicSolver):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"forces act on a mechanism, and this is of type {type(source).__name__}; give what mechsim.load "
            "or catalog.make returns"
        )
    if solver.change_point == "branch" and solver.change_points():
        raise InputError(
            f"{solver.name} changes its branch at change points, where speeds are discontinuous and no "
            "finite force suffices; leave out change_point=branch"
        )
    bare = mechanism or solver.mechanism
    described = with_inertia(bare, density, units.si(diameter, "m", "diameter of the rods"))
    acting = forces_of(source, forces)
    acting.check(described)
    _check_crank(described, acting, solver.motion_laws)
    return DynamicModel(described, acting, solver)


def _check_crank(mechanism: Mechanism, forces: Forces, motion_laws: MotionLaws) -> None:
    if not motion_laws.crank and any(course.over == "angle" for course in forces.load_profiles):
        raise InputError(
            f"{mechanism.name}: a load depends on the crank's angle, but motion laws drive it; "
            "give the load over time, or drive the crank by its speed"
        )
    if not (forces.flywheel or forces.crank_torque or forces.motor):
        return
    if not motion_laws.crank:
        raise InputError(
            f"{mechanism.name}: a flywheel, motor or torque on the crank is given, but motion laws drive it; "
            "leave it out, or drive the crank by its speed"
        )
    driver = mechanism.crank
    if forces.flywheel and driver.a.link != GROUND:
        raise InputError(
            f"{mechanism.name}: the driven joint's first link is {driver.a.link!r}, not the frame, so that a "
            "flywheel is not defined by one moment of inertia; give the link its inertia"
        )
