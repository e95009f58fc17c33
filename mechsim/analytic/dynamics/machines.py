"""A machine: a mechanism with masses, what acts on it, and how its motion is found."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic import closure
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.dynamics.unit_motion import UnitMotion, from_motion
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.display import short_repr
from mechsim.model.forces import Forces
from mechsim.model.mechanism import GROUND, Mechanism, Pose
from mechsim.model.rod_inertia import STEEL, with_inertia

# crank angle between poses that are followed one by one where there is no closed form, in [rad]
FOLLOWED = np.pi / 36


@dataclass(frozen=True, slots=True)
class Machine:
    """A mechanism with masses and forces; made by `machine`.

    Attributes:
        mechanism: every link has an inertia.
        forces: what acts on it.
        drive: the closed form that gives its motion; None leaves that to the loop equations.
        known: poses already followed by the loop equations: crank angle in [rad] -> poses.
    """

    mechanism: Mechanism
    forces: Forces
    drive: ClosedForm | None = None
    known: dict[float, Mapping[str, Pose]] = field(default_factory=dict, repr=False, compare=False)

    __repr__ = short_repr

    def unit_motion(self, angles: ArrayLike) -> UnitMotion:
        """Return poses, first and second derivatives by the crank angle, at crank angles (n,) in [rad].

        Raises:
            AssemblyError: where the loops do not close.
        """
        asked = np.atleast_1d(np.asarray(angles, dtype=np.float64))
        if self.drive is not None:
            return from_motion(self.mechanism, self.drive.solve(asked, 1.0, 0.0))
        poses = self._poses(asked)
        return from_motion(self.mechanism, closure.rates(self.mechanism, poses, asked, 1.0, 0.0))

    def with_forces(self, forces: Forces) -> "Machine":
        """Return the same mechanism under other forces."""
        forces.check(self.mechanism)
        _check_flywheel(self.mechanism, forces)
        return replace(self, forces=forces)

    def _poses(self, angles: Array) -> dict[str, Pose]:
        """Close the loops at each angle from the nearest pose followed so far."""
        if not self.known:
            start = self.mechanism.start
            self.known[start] = closure.assemble(self.mechanism, [start])
        self._walk(min(self.known), float(angles.min()), -FOLLOWED)
        self._walk(max(self.known), float(angles.max()), FOLLOWED)
        places = np.array(sorted(self.known))
        nearest = places[np.abs(places - angles[:, None]).argmin(1)]
        guess = {
            link.name: Pose(
                np.concatenate([self.known[float(at)][link.name].position for at in nearest]),
                np.concatenate([self.known[float(at)][link.name].rotation for at in nearest]),
            )
            for link in self.mechanism.links
        }
        return closure.assemble(self.mechanism, angles, guess)

    def _walk(self, here: float, there: float, step: float) -> None:
        """Follow the assembly outwards from the last known angle, so far as an angle lies outside."""
        while (there - here) * step > 0.0:
            following = here + step if abs(there - here) > abs(step) else there
            self.known[following] = closure.assemble(self.mechanism, [following], self.known[here])
            here = following


def machine(
    source: ClosedForm | Mechanism,
    forces: Forces | None = None,
    *,
    mechanism: Mechanism | None = None,
    density: float = STEEL,
    diameter: float | None = None,
) -> Machine:
    """Return a catalogue mechanism, or any other, as a machine.

    Args:
        source: a catalogue mechanism, whose closed form gives the motion, or any mechanism, whose loop
            equations do.
        forces: what acts on it; None is nothing.
        mechanism: the description of the catalogue mechanism with inertias of one's own.
        density: of the rods that links without inertia are made of, in [kg/m3].
        diameter: of those rods in [m]; None takes 0.05 of the mechanism's size.

    Raises:
        InputError: for forces that name what the mechanism does not have.
    """
    drive = source if isinstance(source, ClosedForm) else None
    bare = mechanism or (source.mechanism if isinstance(source, ClosedForm) else source)
    described = with_inertia(bare, density, diameter)
    acting = forces or Forces()
    acting.check(described)
    _check_flywheel(described, acting)
    return Machine(described, acting, drive)


def _check_flywheel(mechanism: Mechanism, forces: Forces) -> None:
    driver = mechanism.joint(mechanism.driver)
    if forces.flywheel and driver.a.link != GROUND:
        raise InputError(
            f"{mechanism.name}: the driven joint's first link is {driver.a.link!r}, not the frame, so that a "
            "flywheel is not defined by one moment of inertia; give the link its inertia"
        )
