"""Speed fluctuation of a mechanism under constant driving torque, and the flywheel that limits it."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.dynamics.applied_forces import applied, loads
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.reduced_equation import reduced_coefficients
from mechsim.errors import InputError
from mechsim.model.force_record import Fluctuation
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root
from mechsim.units import si

# smallest coefficient of fluctuation above rounding
MIN_FLUCTUATION = 1e-9
# crank angles per revolution; far fewer resolve smooth coefficients to rounding
ANGLES = 1024


def fluctuation(model: DynamicModel, mean: float | str) -> Fluctuation:
    """Return the crank's speed fluctuation over a revolution at a mean speed in [rad/s], or as "600rpm".

    J w2 / 2 = K + integral of (T + Q). The constant torque T balances the work of a revolution, and K gives
    the mean speed. Viscous friction and loads over time are evaluated at the mean speed.

    Raises:
        InputError: for a mean speed of zero.
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
    # a mechanism that passes a change point may have a period of two revolutions
    turns = round(model.solver.period / REVOLUTION)
    angle: Array = np.arange(turns * ANGLES, dtype=np.float64) * (REVOLUTION / ANGLES)
    unit = model.unit_motion(angle)
    reduced = reduced_coefficients(unit, applied(model, unit), model.forces.flywheel)
    force = reduced.force(mean) + loads(model, unit, angle / mean).torque
    torque = -float(force.mean())
    waves = np.fft.rfft(force + torque)
    order = np.arange(len(waves)) / turns
    waves[1:] /= 1j * order[1:]
    waves[0] = 0.0
    gained: Array = np.fft.irfft(waves, len(angle)).astype(np.float64)
    return angle, reduced.inertia, gained - gained[0], torque


def _even(
    model: DynamicModel, angle: Array, inertia: Array, gained: Array, torque: float, mean: float
) -> Fluctuation:
    """Return the fluctuation whose initial energy gives the mean speed."""

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
