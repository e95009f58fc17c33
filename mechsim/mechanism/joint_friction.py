"""Friction in joints: viscous, Coulomb, and in proportion to the load of the joint.

Coulomb friction T opposes the rate of a coordinate, with T at most

- revolute: mu (r_p F_radial + r_b F_axial + (r_p / l) M_bending) + T_0;
- prismatic, as a force: mu (F_normal + M_bending / l + M_torsion / r_p) + T_0;
- cylindrical: mu (F_radial + M_bending / l) along, and r_p times it about the axis, each for itself;
- spherical: mu r_p F;
- screw, as a torque about its axis: mu (r_p / cos a) N + mu r_b F_axial + T_0, with the force N normal to the
  thread and tan a = lead / (2 pi r_p). It holds any axial load at rest if mu >= tan a;
- of a coupling, on its driver: mu |lambda|, with the force lambda on its driven side. For the ratio p' and
  mu = |p'| (1/eta - 1) the driven side gets eta of the power of the driver. Driven backwards, the driver gets
  2 - 1/eta of that of the driven side; none for eta <= 1/2, where the coupling is self-locking.

F and M are magnitudes of the force and moment that the joint transmits, about its point on link b; the
coefficient of friction mu, pin radius r_p, collar radius r_b and bearing length l are those of the joint, T_0
its `coulomb`. Terms without a radius or length are left out.

At rest T is `static` / mu times as large, or `static` / T_0 without a coefficient. With `stribeck` v_s it
falls from there at a rate v: T(v) = T_c + (T_s - T_c) exp(-(v / v_s)^2), with T_c in motion and T_s at rest.

Source: J. Fraczek and M. Wojtyra, On the unique solvability of a direct dynamics problem for mechanisms with
redundant constraints and Coulomb friction in joints, Mechanism and Machine Theory 46 (2011) 312-334; R.
Budynas and J. Nisbett, Shigley's Mechanical Engineering Design (2015), sections 8-2 and 13-17 (worm gears:
the friction that loses 1 - eta in one direction reverses in the other); B. Armstrong-Helouvry, P.
Dupont and C. Canudas de Wit, A survey of models, analysis tools and compensation methods for the control of
machines with friction, Automatica 30 (1994) 1083-1138, section 2.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS, Kind, kinds_that
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array, at_least_zero, number

# number of magnitudes whose sum is the load of a coordinate
TERMS = 3


@dataclass(frozen=True, slots=True)
class Friction:
    """Friction in a joint; it opposes the rate of the joint.

    In a revolute or prismatic joint the torque or force on link b along the joint's axis is
    -(viscous q' + coulomb sign q'). A cylindrical joint has this force along its axis and, with
    `viscous_turn` and `coulomb_turn`, a torque about it. A universal joint has a torque about each axis, by
    the rate about that axis. In a spherical joint it is a moment against the relative angular velocity w:
    `-(viscous w + coulomb w / |w|)`. A `coefficient` adds to `coulomb` what the load of the joint causes.

    Attributes:
        joint: name of the joint.
        viscous: coefficient in [N m s] for rotation, [N s/m] for sliding; 0 or more.
        coulomb: Coulomb friction in [N m] or [N], independent of the load on the joint; 0 or more.
        viscous_turn: coefficient of rotation in a cylindrical joint, in [N m s].
        coulomb_turn: Coulomb friction of rotation in a cylindrical joint, in [N m].
        coefficient: coefficient of friction mu, 0 or more.
        pin_radius: radius at which the friction of a rotation acts, in [m]: of the pin, ball or thread.
        collar_radius: radius at which the friction of the axial force of a pin acts, in [m].
        bearing_length: length l over which a pair of forces carries a bending moment, in [m].
        static: coefficient of friction at rest, or Coulomb friction at rest without a coefficient; 0 for that
            in motion.
        stribeck: rate v_s in [rad/s] or [m/s] by which friction falls to that in motion; 0 for at once.
        bristle_stiffness: k in [N m/rad] or [N/m], 0 for rigid contact; see `bristle_friction`.
        bristle_damping: d in [N m s/rad] or [N s/m].
        coupling: key of `Mechanism.named_laws` of a coupling whose force is the load, with the joint as its
            driver; empty for the joint's own reaction. See `of_efficiency`.
    """

    joint: str
    viscous: float = 0.0
    coulomb: float = 0.0
    viscous_turn: float = 0.0
    coulomb_turn: float = 0.0
    coefficient: float = 0.0
    pin_radius: float = 0.0
    collar_radius: float = 0.0
    bearing_length: float = 0.0
    static: float = 0.0
    stribeck: float = 0.0
    bristle_stiffness: float = 0.0
    bristle_damping: float = 0.0
    coupling: str = ""

    def __post_init__(self) -> None:
        for name in ("viscous", "viscous_turn"):
            at_least_zero(f"viscous friction in joint {self.joint!r}", getattr(self, name))
        for name in ("coulomb", "coulomb_turn"):
            at_least_zero(f"Coulomb friction in joint {self.joint!r}", getattr(self, name))
        for name in ("coefficient", *RADII, "static", "stribeck", *BRISTLES):
            what = f"{name} of friction in joint {self.joint!r}".replace("_", " ")
            at_least_zero(what, getattr(self, name))
        moving = self.coefficient or self.coulomb
        if self.static and not 0.0 < moving <= self.static:
            raise InputError(
                f"static friction in joint {self.joint!r} is {self.static}, below that in motion, "
                f"{moving}, or without any; give coulomb or a coefficient, and at least as much at rest"
            )
        if self.bristle_damping and not self.bristle_stiffness:
            raise InputError(
                f"bristle damping in joint {self.joint!r} has no effect without bristles; give "
                "bristle_stiffness, or leave it out"
            )
        if self.stribeck and not self.static:
            raise InputError(
                f"stribeck in joint {self.joint!r} has no effect without static friction; give static, or "
                "leave it out"
            )

    @staticmethod
    def of_efficiency(mechanism: Mechanism, name: str, efficiency: float) -> Friction:
        """Return the friction of a coupling whose driven side gets `efficiency` of the power of the driver.

        Args:
            mechanism: with the coupling.
            name: key of the coupling in `Mechanism.named_laws`, DRIVER-DRIVEN, as "pinion-wheel".
            efficiency: above 0, 1 at most.

        Raises:
            InputError: for another efficiency, or a coupling that is not linear between two hinges or slides.
        """
        if not 0.0 < number(efficiency) <= 1.0:
            raise InputError(
                f"efficiency of coupling {name} is {efficiency}; give a number above 0, 1 at most"
            )
        law = mechanism.named_laws[name]
        sides = [*law.left_terms.items(), *law.right_terms.items()]
        single = all(weight == 1.0 and KINDS[mechanism.joint_with(c)[0].kind].single for c, weight in sides)
        if len(sides) != 2 or not single or len(law.coefficients) != 2 or law.backlash:
            raise InputError(
                f"coupling {name} has an efficiency, but is not linear between two hinges or slides without "
                "backlash; give friction in its joints instead"
            )
        loss = abs(law.ratio) * (1.0 / efficiency - 1.0)
        return Friction(law.coordinates[1], coefficient=loss, coupling=name)

    @property
    def dry(self) -> bool:
        """Whether there is Coulomb friction."""
        return bool(self.coulomb or self.coulomb_turn or self.coefficient)

    @property
    def varies(self) -> bool:
        """Whether Coulomb friction depends on the load or the rate."""
        return bool(self.coefficient or self.static)

    @property
    def ratio_at_rest(self) -> float:
        """Friction at rest relative to that in motion, 1 or more."""
        return self.static / (self.coefficient or self.coulomb) if self.static else 1.0

    @property
    def smooth(self) -> Friction:
        """The viscous friction alone."""
        return Friction(self.joint, viscous=self.viscous, viscous_turn=self.viscous_turn)

    @property
    def at_rest(self) -> Friction:
        """The friction at rest, without viscous friction."""
        ratio, none = (
            self.ratio_at_rest,
            dict.fromkeys(("viscous", "viscous_turn", "static", "stribeck"), 0.0),
        )
        return replace(self, coulomb=ratio * self.coulomb, coefficient=ratio * self.coefficient, **none)

    def ratio(self, rate: Array) -> Array:
        """Return the friction at rates relative to that in fast motion."""
        if not self.stribeck:
            return np.ones(np.shape(rate))
        # beyond 30 v_s the exponential underflows
        relative = np.minimum(np.abs(rate) / self.stribeck, 30.0)
        return 1.0 + (self.ratio_at_rest - 1.0) * np.exp(-(relative**2))

    def check(self, joint: Joint) -> None:
        """Raise InputError unless the joint can have this friction."""
        kind = KINDS[joint.kind]
        where = f"{joint.kind} joint {joint.name!r}"
        if kind.dof in (0, 6):
            raise InputError(f"friction is given in {where}, which cannot have friction; leave it out")
        if not kind.mixed and (self.viscous_turn or self.coulomb_turn):
            raise InputError(
                f"friction of rotation besides that of sliding is given in {where}; only a "
                f"{kinds_that(lambda kind: kind.mixed)} joint has both"
            )
        if self.static and kind.mixed:
            raise InputError(
                f"static friction is given in {where}, which slides and rotates; give it in a joint that has "
                "one of both motions"
            )
        if self.bristle_stiffness and (self.coefficient or not self.coulomb or not kind.single):
            raise InputError(
                f"bristle stiffness is given in {where}; give it with `coulomb` and without a coefficient, "
                f"in a {kinds_that(lambda kind: kind.single)} joint"
            )
        if not self.varies or self.coupling:
            return
        if not _loaded(kind):
            raise InputError(
                f"a coefficient of friction, or static, is given in {where}; give `coulomb` alone, or it "
                f"in a {kinds_that(_loaded)} joint"
            )
        if self.coefficient and kind.turns and not self.pin_radius:
            raise InputError(
                f"the coefficient of friction in {where} has no radius at which the friction acts; give "
                "pin_radius"
            )

    def sizes(self, kind: Kind) -> list[tuple[float, float]]:
        """Return (viscous, Coulomb) of each coordinate of a joint; a spherical joint has one pair."""
        sliding, turning = (self.viscous, self.coulomb), (self.viscous_turn, self.coulomb_turn)
        turns = 1 if kind.ball else len(kind.turns)
        return [sliding] * len(kind.slides) + [turning if kind.mixed else sliding] * turns

    def loaded(self, mechanism: Mechanism) -> list[tuple[Joint, int, int, float]]:
        """Return joint, number, coordinate, and part without a load (0 in a screw), of each by the load."""
        joint = mechanism.joint(self.joint)
        kind = KINDS[joint.kind]
        sizes = [0.0] * kind.dof if kind.mixed else [coulomb for _, coulomb in self.sizes(kind)]
        numbered = enumerate(self.loads(joint, np.eye(3)[2:]) if self.varies else [])
        return [(joint, n, index, sizes[index]) for n, (index, maps) in numbered if self.static or maps.any()]

    def loads(self, joint: Joint, axis: Array) -> list[tuple[int, Array]]:
        """Return maps of the wrench that a joint transmits to the terms of its loads.

        Each friction is the sum of the terms' magnitudes. The wrench on link b, in ground axes and about the
        joint's point, includes the friction of the thread of a screw, the first of its two.

        Args:
            joint: the joint.
            axis: its axis, (n, 3); not used for a ball.

        Returns:
            For each friction the index of its coordinate in the joint, 0 for a ball, and (n, TERMS, 3, 6).
        """
        kind, mu, r = KINDS[joint.kind], self.coefficient, self.pin_radius
        if not mu:
            return [(0, np.zeros((len(axis), TERMS, 3, 6)))] if self.static else []
        if self.coupling:
            # the load has the force of the coupling in place of the first component of a wrench
            return [(0, _terms(force=mu * np.broadcast_to(np.diag([1.0, 0.0, 0.0]), (len(axis), 3, 3))))]
        along = axis[:, :, None] * axis[:, None, :]
        across = np.eye(3) - along
        arm = 1.0 / self.bearing_length if self.bearing_length else 0.0
        if kind.ball:
            return [(0, _terms(force=mu * r * np.broadcast_to(np.eye(3), across.shape)))]
        if kind.helical:
            tangent = joint.lead / (2.0 * np.pi * r)
            cosine = 1.0 / np.sqrt(1.0 + tangent**2)
            normal = np.concatenate([along * cosine, along * (-tangent * cosine / r)], 2)
            thread = np.zeros((len(axis), TERMS, 3, 6))
            thread[:, 0] = mu * r / cosine * normal
            return [(1, thread), (1, _terms(force=mu * self.collar_radius * along))]
        if kind.mixed:
            sliding = _terms(force=mu * across, moment=mu * arm * across)
            return [(0, sliding), (1, r * sliding)]
        if kind.hinge:
            axial = mu * self.collar_radius * along
            return [(0, _terms(force=mu * r * across, axial=axial, moment=mu * r * arm * across))]
        torsion = along * (mu / r if r else 0.0)
        return [(0, _terms(force=mu * across, moment=mu * arm * across, torsion=torsion))]


RADII = ("pin_radius", "collar_radius", "bearing_length")
BRISTLES = ("bristle_stiffness", "bristle_damping")


def _loaded(kind: Kind) -> bool:
    """Whether a joint kind can have a coefficient of friction."""
    return kind.drivable or (kind.ball and kind.pivot)


def _terms(**maps: Array) -> Array:
    """Return terms of a load, (n, TERMS, 3, 6), from maps (n, 3, 3) of the force and the moment."""
    result = np.zeros((len(maps["force"]), TERMS, 3, 6))
    for name, values in maps.items():
        row, columns = _PARTS_OF_LOAD[name]
        result[:, row, :, columns] = values
    return result


# map of the force or the moment -> its term, and its columns
_PARTS_OF_LOAD = {
    "force": (0, slice(3)),
    "axial": (1, slice(3)),
    "moment": (2, slice(3, 6)),
    "torsion": (1, slice(3, 6)),
}
