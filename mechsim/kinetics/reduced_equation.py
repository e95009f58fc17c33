"""The reduced equation of a crank: its coefficients, speed fluctuation, and the flywheel that limits it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.kinematics.vector_method.rotations import dot
from mechsim.kinetics.applied_forces import Applied, applied, loads, power
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.force_record import Fluctuation
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import size_of
from mechsim.numerics.newton import root
from mechsim.units import si


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
    require_constant_friction(model, "the reduced equation")
    unit = model.unit_motion(angles)
    return reduced_coefficients(unit, applied(model, unit), model.forces.flywheel)


def require_constant_friction(model: DynamicModel, what: str) -> None:
    """Raise InputError for friction that depends on speeds and accelerations."""
    joints = [friction.joint for friction in model.forces.friction if friction.varies]
    if joints:
        raise InputError(
            f"{model.mechanism.name}: friction by load or rate, in {', '.join(joints)}, is not part of "
            f"{what}; give `coulomb` alone, or a prescribed motion"
        )


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


# smallest coefficient of fluctuation above rounding
MIN_FLUCTUATION = 1e-9
# crank angles per revolution; far fewer resolve smooth coefficients to rounding
ANGLES = 1024
# most periods of the mechanism after which its torque may repeat, as two revolutions of a four-stroke engine;
# and relative change of the torque that is rounding
MOST_PERIODS, SAME_TORQUE = 4, 1e-9


def fluctuation(model: DynamicModel, mean: float | str) -> Fluctuation:
    """Return the crank's speed fluctuation over a period at a mean speed in [rad/s], or as "600rpm".

    J w2 / 2 = K + integral of (T + Q). The constant torque T balances the work of a period, and K gives
    the mean speed. Viscous friction and loads over time are evaluated at the mean speed.

    Raises:
        InputError: for a mean speed of zero, and a torque that does not repeat.
        AssemblyError: if the crank cannot rotate fully.
    """
    mean = si(mean, "rad/s", "mean crank speed")
    if not 0.0 < abs(mean) < np.inf:
        raise InputError(f"mean crank speed is {mean} rad/s; give a finite speed other than 0")
    angle, inertia, gained, torque = _revolution(model, mean)
    return _even(model, angle, inertia, gained, torque, mean)


def flywheel_for(model: DynamicModel, mean: float | str, coefficient: float) -> Fluctuation:
    """Return the fluctuation with the smallest flywheel that satisfies a coefficient of speed fluctuation.

    The returned flywheel replaces that of the model's forces; it is zero if none is needed.

    Raises:
        InputError: for a coefficient below the rounding of the speed.
    """
    mean = si(mean, "rad/s", "mean crank speed")
    if not MIN_FLUCTUATION <= coefficient < np.inf:
        raise InputError(
            f"coefficient of speed fluctuation is {coefficient}; give {MIN_FLUCTUATION:g} or more, as 0.02"
        )
    bare = model.with_forces(replace(model.forces, flywheel=0.0))
    angle, inertia, gained, torque = _revolution(bare, mean)

    def miss(flywheel: float) -> float:
        return _even(bare, angle, inertia + flywheel, gained, torque, mean).coefficient - coefficient

    solution, most = 0.0, float(np.mean(inertia)) + float(np.ptp(gained)) / (coefficient * mean**2)
    if miss(0.0) > 0.0:
        while miss(most) > 0.0:
            most *= 4.0
        solution = root(miss, 0.0, most)
    return replace(_even(bare, angle, inertia + solution, gained, torque, mean), flywheel=solution)


def _revolution(model: DynamicModel, mean: float) -> tuple[Array, Array, Array, float]:
    """Return angles, inertia, energy gained since the first angle, and the constant torque."""
    require_constant_friction(model, "the reduced equation")
    # that of a mechanism that passes a change point may be two revolutions
    period = round(model.solver.period / REVOLUTION)
    for turns in range(period, period * MOST_PERIODS + 1, period):
        twice: Array = np.arange(2 * turns * ANGLES, dtype=np.float64) * (REVOLUTION / ANGLES)
        unit = model.unit_motion(twice)
        reduced = reduced_coefficients(unit, applied(model, unit), model.forces.flywheel)
        force = reduced.force(mean) + loads(model, unit, twice / mean, mean).torque
        (inertia, later), (force, then) = reduced.inertia.reshape(2, -1), force.reshape(2, -1)
        change = np.abs(then - force).max() + np.abs(later - inertia).max() * mean**2
        if change <= SAME_TORQUE * (np.abs(force).max() + np.abs(inertia).max() * mean**2):
            break
    else:
        raise InputError(
            f"{model.mechanism.name}: the torque of the crank does not repeat within "
            f"{period * MOST_PERIODS} revolutions, so that its speed has no steady fluctuation"
        )
    angle = twice[: len(force)]
    torque = -float(force.mean())
    waves = np.fft.rfft(force + torque)
    order = np.arange(len(waves)) / turns
    waves[1:] /= 1j * order[1:]
    waves[0] = 0.0
    gained: Array = np.fft.irfft(waves, len(angle)).astype(np.float64)
    return angle, inertia, gained - gained[0], torque


def _even(
    model: DynamicModel, angle: Array, inertia: Array, gained: Array, torque: float, mean: float
) -> Fluctuation:
    """Return the fluctuation whose initial energy gives the mean speed."""
    if not inertia.min() > 0.0:
        raise InputError(
            f"{model.mechanism.name}: the crank moves no mass, so that its speed has no steady fluctuation; "
            "give its links a mass, or add a flywheel"
        )

    def speeds(start: float) -> Array:
        return np.sqrt(2.0 * (start + gained) / inertia)

    def miss(start: float) -> float:
        return 1.0 / float(np.mean(1.0 / speeds(start))) - abs(mean)

    floor, scale = -float(gained.min()), float(inertia.max()) * mean**2 + float(np.ptp(gained))
    least = floor + 1e-9 * scale
    if miss(least) > 0.0:
        raise InputError(
            f"{model.mechanism.name}: at a mean speed of {mean:.6g} rad/s the crank would stop within "
            "the turn; give a higher speed or a flywheel"
        )
    speed = np.sign(mean) * speeds(root(miss, least, floor + scale))
    spread = float(np.ptp(speed)) / abs(mean)
    excess = float(np.ptp(gained))
    return Fluctuation(angle, speed, mean, torque, excess, spread, model.forces.flywheel)
