"""Projection of a run's rates onto its energy balance.

Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration (2006), section IV.4 (projection
onto invariants).
"""

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.numerics.arrays import Array

# kinetic energy relative to the largest below which rates are not scaled
SLOW = 1e-2


class EnergyBalance:
    """Energy of a run and its numerical drift.

    Args:
        equations: equations of motion.
        q: initial coordinates.
        rates: initial rates in units, (count, 1).

    Attributes:
        drift: largest magnitude of the summed energy corrections, in [J].
    """

    def __init__(self, equations: EquationsOfMotion, q: Coordinates, rates: Array) -> None:
        self.equations, self.drift = equations, 0.0
        self._largest, potential = equations.energy(equations.kinematics(q, rates))
        self._initial, self._correction = self._largest + potential, 0.0

    def balanced(self, q: Coordinates, rates: Array, gained: float) -> Array:
        """Return rates scaled to the initial energy plus the energy gained, in [J]."""
        kinetic, potential = self.equations.energy(self.equations.kinematics(q, rates))
        self._largest = max(self._largest, kinetic)
        target = self._initial + gained - potential
        if kinetic < SLOW * self._largest or not 0.5 * kinetic < target < 2.0 * kinetic:
            return rates
        self._correction += target - kinetic
        self.drift = max(self.drift, abs(self._correction))
        return rates * np.sqrt(target / kinetic)
