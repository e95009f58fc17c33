"""Coefficients of the reduced equation of a crank: inertia, static torque, damping and Coulomb friction."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.dynamics.applied_forces import Applied, applied, power
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import dot
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import size_of


@dataclass(frozen=True, slots=True)
class Reduced:
    """Coefficients of the reduced equation at n crank angles.

    With crank speed w: Q = static - damping w - coulomb sign(w) + loads + torque on the crank.

    Attributes:
        angle: crank angle, (n,) in [rad].
        inertia: reduced inertia J, flywheel included, (n,) in [kg m2].
        inertia_derivative: J' = dJ/dangle, (n,) in [kg m2/rad].
        static: torque of gravity and springs, (n,) in [N m].
        damping: damping coefficient, (n,) in [N m s], 0 or more.
        coulomb: torque of Coulomb friction, (n,) in [N m], 0 or more.
        energy: potential energy of gravity and springs, (n,) in [J]; static is minus its derivative.
    """

    angle: Array
    inertia: Array
    inertia_derivative: Array
    static: Array
    damping: Array
    coulomb: Array
    energy: Array

    __repr__ = short_repr

    def force(self, speed: ArrayLike) -> Array:
        """Return Q of all forces that depend on angle and speed only, (n,) in [N m]."""
        w = np.asarray(speed, dtype=np.float64)
        return self.static - self.damping * w - self.coulomb * np.sign(w)

    def torque(self, speed: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Return the crank torque that a motion requires without loads, (n,) in [N m]."""
        w, e = np.asarray(speed, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
        return self.inertia * e + 0.5 * self.inertia_derivative * w**2 - self.force(w)


def reduced(model: DynamicModel, angles: ArrayLike) -> Reduced:
    """Return the coefficients of the reduced equation at crank angles (n,) in [rad].

    Accuracy: a few ulp times the condition number of the loop equations; no finite differences are used.
    """
    unit = model.unit_motion(angles)
    return reduced_coefficients(unit, applied(model, unit), model.forces.flywheel)


def reduced_coefficients(unit: UnitMotion, acting: Applied, flywheel: float) -> Reduced:
    """Return the coefficients of the reduced equation from a unit motion and a flywheel in [kg m2]."""
    inertia, derivative = generalised_inertia(unit)
    friction = np.zeros(len(unit))
    for dry in acting.dry:
        friction = friction + dry.magnitude * size_of(dry.rate)
    return Reduced(
        unit.angle,
        inertia + flywheel,
        derivative,
        power(unit, acting.gravity + acting.springs),
        -power(unit, acting.damping),
        friction,
        acting.energy,
    )


def generalised_inertia(unit: UnitMotion) -> tuple[Array, Array]:
    """Return J = sum m v.v + omega.I omega at unit crank speed, and J' = 2 sum m v.a + omega.I alpha.

    The rotation of the inertia matrices adds nothing to J': omega.(omega x I omega) = 0.

    Returns:
        (n,) in [kg m2] and (n,) in [kg m2/rad].
    """
    unity, none = np.ones(len(unit)), np.zeros(len(unit))
    momenta = unit.inertial(none, unity)  # J's wrenches are those of unit acceleration at rest
    derivative = 2.0 * power(unit, unit.inertial(unity, none))
    return power(unit, momenta), derivative


def kinetic_energy_of_links(unit: UnitMotion, speed: Array, flywheel: float = 0.0) -> Array:
    """Return sum m v2 / 2 + omega.I omega / 2 over the links, an alternative to J w2 / 2, (n,) in [J]."""
    w = speed[:, None, None] * unit.twist
    centre = w[..., :3] + np.cross(w[..., 3:], unit.centres)
    turning = (unit.moments @ w[..., 3:, None])[..., 0]
    energies = unit.masses * dot(centre, centre) + dot(w[..., 3:], turning)
    return 0.5 * energies.sum(-1) + 0.5 * flywheel * speed**2
