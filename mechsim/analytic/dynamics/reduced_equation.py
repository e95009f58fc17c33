"""The reduced equation of motion of a machine with one crank: J p'' + J' p'2 / 2 = Q (Eksergian).

Source: M. Eksergian, Dynamical analysis of machines, J. Franklin Inst. 209-211 (1930-31); the
derivation here is virtual power with exact first and second derivatives of the poses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.dynamics.applied import Applied, applied, power
from mechsim.analytic.dynamics.machines import Machine
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import dot
from mechsim.model.display import short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.complex_step import size_of


@dataclass(frozen=True, slots=True)
class Reduced:
    """Coefficients of the reduced equation at n crank angles.

    With crank speed w: Q = static - damping w - coulomb sign(w) + loads + torque on the crank.

    Attributes:
        angle: crank angle, (n,) in [rad].
        inertia: J, flywheel included, (n,) in [kg m2].
        slope: J' = dJ/dangle, (n,) in [kg m2/rad].
        static: of gravity and springs, (n,) in [N m].
        damping: (n,) in [N m s], 0 or more.
        coulomb: of dry friction, (n,) in [N m], 0 or more.
        energy: of gravity and springs, (n,) in [J]; static is minus its derivative.
    """

    angle: Array
    inertia: Array
    slope: Array
    static: Array
    damping: Array
    coulomb: Array
    energy: Array

    __repr__ = short_repr

    def force(self, speed: ArrayLike) -> Array:
        """Return Q of all that depends on angle and speed alone, (n,) in [N m]."""
        w = np.asarray(speed, dtype=np.float64)
        return self.static - self.damping * w - self.coulomb * np.sign(w)

    def torque(self, speed: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Return the crank torque that a motion needs, loads left out, (n,) in [N m]."""
        w, e = np.asarray(speed, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
        return self.inertia * e + 0.5 * self.slope * w**2 - self.force(w)


def reduced(machine: Machine, angles: ArrayLike) -> Reduced:
    """Return the coefficients of the reduced equation at crank angles (n,) in [rad].

    Accuracy: a few ulp times the condition of the loop equations; no differences are taken.
    """
    unit = machine.unit_motion(angles)
    return coefficients(unit, applied(machine, unit), machine.forces.flywheel)


def coefficients(unit: UnitMotion, acting: Applied, flywheel: float) -> Reduced:
    """Return the coefficients of the reduced equation for a motion per radian, a flywheel in [kg m2]."""
    inertia, slope = generalised_inertia(unit)
    friction = np.zeros(len(unit))
    for part in acting.dry:
        friction = friction + part.size * size_of(part.rate)
    return Reduced(
        unit.angle,
        inertia + flywheel,
        slope,
        power(unit, acting.gravity + acting.springs),
        -power(unit, acting.damping),
        friction,
        acting.energy,
    )


def generalised_inertia(unit: UnitMotion) -> tuple[Array, Array]:
    """Return J = sum m v.v + omega.I omega at unit crank speed, and J' = 2 sum m v.a + omega.I alpha.

    The turning of the inertia matrices adds nothing to J': omega.(omega x I omega) = 0.

    Returns:
        (n,) in [kg m2] and (n,) in [kg m2/rad].
    """
    one, none = np.ones(len(unit)), np.zeros(len(unit))
    momenta = unit.inertial(none, one)  # J's wrenches are those of unit acceleration at rest
    slope = 2.0 * power(unit, unit.inertial(one, none))
    return power(unit, momenta), slope


def load_leverage(machine: Machine, unit: UnitMotion) -> Array:
    """Return what loads and couples act along per radian of the crank, (n, loads, 3).

    Of a load the derivative of its point in [m/rad], of a couple that of its link's turning.
    """
    rates = [unit.place(load.place)[2] for load in machine.forces.loads]
    rates += [unit.spin(couple.link) for couple in machine.forces.couples]
    return np.stack(rates, 1) if rates else np.zeros((len(unit), 0, 3))


def kinetic_energy(unit: UnitMotion, speed: Array, flywheel: float = 0.0) -> Array:
    """Return sum m v2 / 2 + omega.I omega / 2, link by link and not by J: a second route, (n,) in [J]."""
    w = speed[:, None, None] * unit.twist
    centre = w[..., :3] + np.cross(w[..., 3:], unit.centres)
    turning = (unit.moments @ w[..., 3:, None])[..., 0]
    parts = unit.masses * dot(centre, centre) + dot(w[..., 3:], turning)
    return 0.5 * parts.sum(-1) + 0.5 * flywheel * speed**2
