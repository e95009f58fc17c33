"""Friction with bristles (LuGre): it creeps at rest, and its state z is the deflection of the bristles.

    z' = v - k |v| z / T(v),    F = k z + d z' + b v

with the Coulomb friction T(v) by the curve of Stribeck, the viscous b, and stiffness k and damping d of the
bristles. In steady motion F = T(v) sgn v + b v, which prescribed motions and statics take.

Source: C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with
friction, IEEE Transactions on Automatic Control 40 (1995) 419-425.
"""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_friction import Friction
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True)
class BristleFriction(Actuator):
    """Friction with bristles as an actuator without a control, whose state is their deflection.

    Attributes:
        friction: of the joint.
    """

    friction: Friction = Friction("")

    @property
    def bristles(self) -> tuple[float, ...]:
        """Their numbers in the order of `Actuator` of expressions.c."""
        row = self.friction
        viscous, coulomb = row.viscous, row.coulomb
        return row.bristle_stiffness, row.bristle_damping, viscous, coulomb, row.ratio_at_rest, row.stribeck

    def force(self, inputs: tuple[Array, Array], length: Array, speed: Array, state: Array) -> Array:
        """Return the force on the joint's link b, (n,)."""
        row, rate = self.friction, self.state_rate(inputs, length, speed, state)
        return -(row.bristle_stiffness * state + row.bristle_damping * rate + row.viscous * speed)

    def state_rate(self, inputs: tuple[Array, Array], length: Array, speed: Array, state: Array) -> Array:
        """Return z', (n,)."""
        limit = self.friction.coulomb * self.friction.ratio(np.real(speed))
        return speed - self.friction.bristle_stiffness * np.sign(np.real(speed)) * speed * state / limit

    def steady_state(self, time: Array, length: Array, speed: Array) -> Array:
        """Return the deflection in steady motion, (n,)."""
        limit = self.friction.coulomb * self.friction.ratio(np.real(speed))
        return limit * np.sign(np.real(speed)) / self.friction.bristle_stiffness


def with_bristles(forces: Forces) -> Forces:
    """Return forces with the frictions that have bristles as actuators, for runs from an initial state."""
    # a rate that depends on the speed, so that MuJoCo leaves it to us
    inflow, bristles = (0.0, 0.0, 0.0, 1.0), [row for row in forces.friction if row.bristle_stiffness]
    made = [
        BristleFriction(f"friction in {row.joint}", {row.joint: 1.0}, inflow=inflow, friction=row)
        for row in bristles
    ]
    others = tuple(row for row in forces.friction if not row.bristle_stiffness)
    return replace(forces, friction=others, actuators=(*forces.actuators, *made)) if made else forces
