"""Coulomb friction that knows its load: frictions and reactions of a state are one problem.

The wrenches that joints transmit are linear in the frictions, and the frictions are sums of magnitudes of
these wrenches (`mechsim.model.joint_friction`). The solution is unique if its map is a contraction
(`mechsim.numerics.friction_balance`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics.applied_forces import (
    Applied,
    add_joint_forces,
    dry_friction,
    joint_rates,
    require_idle,
)
from mechsim.analytic.dynamics.reactions import linear_reactions
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.errors import FrictionError, InputError
from mechsim.model.forces import Forces
from mechsim.model.joint_friction import Friction
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.friction_balance import ROUNDED, balanced_friction

# share of a self-stress that changes the magnitude of a load, above rounding
FELT = 1e-6
# load relative to the largest one below which it is rounding, and has no direction
NO_LOAD = 1e-9


@dataclass(frozen=True, slots=True)
class LoadedCoordinate:
    """A friction by the load: its number among those of its joint, and the coordinate that it opposes."""

    friction: Friction
    joint: Joint
    number: int
    coordinate: int

    def unit_forces(self, direction: Array) -> list[Array]:
        """Return the forces (n,) along the joint's coordinates of a unit friction against a direction."""
        kind, zero = KINDS[self.joint.kind], np.zeros(len(direction))
        count = 1 if kind.ball else kind.dof
        return [-direction if i == self.coordinate else zero for i in range(count)]


def loaded_coordinates(forces: Forces, mechanism: Mechanism) -> list[LoadedCoordinate]:
    """Return the frictions by the load."""
    result: list[LoadedCoordinate] = []
    for friction in forces.friction:
        if friction.coefficient:
            joint = mechanism.joint(friction.joint)
            for number, (index, terms) in enumerate(friction.loads(joint, np.eye(3)[2:])):
                if terms.any():
                    result.append(LoadedCoordinate(friction, joint, number, index))
    return result


@dataclass(frozen=True, slots=True)
class LoadFriction:
    """Frictions at n instants.

    Attributes:
        magnitude: magnitude of each, (n, k) in [N] or [N m].
        radius: spectral radius of the map, (n,); below 1 the frictions exist and are unique.
        undetermined: whether self-stresses change the load of each, (n, k).
        jammed: whether no frictions were solution that balance the forces, (n,).
    """

    magnitude: Array
    radius: Array
    undetermined: NDArray[np.bool_]
    jammed: NDArray[np.bool_]

    def require_determined(self, coordinates: Sequence[LoadedCoordinate], labels: Sequence[str]) -> None:
        """Raise FrictionError at the first instant, labelled, without unique frictions."""
        loose, several = self.undetermined.any(1), self.radius >= 1.0
        wrong = loose | several | self.jammed
        if not wrong.any():
            return
        i = int(np.argmax(wrong))
        names = ", ".join(dict.fromkeys(item.joint.name for item in coordinates))
        if self.jammed[i]:
            raise FrictionError(
                f"{labels[i]}: friction jams the mechanism, since no friction in {names} balances the forces "
                f"(its loads grow by {self.radius[i]:.3g} of the friction); reduce a coefficient",
                "jammed",
            )
        if loose[i]:
            joint = coordinates[int(np.argmax(self.undetermined[i]))].joint.name
            raise FrictionError(
                f"{labels[i]}: the load of joint {joint!r} is undetermined, since redundant constraints "
                "share it, and so is its friction; give `coulomb` instead of a coefficient there",
                "undetermined",
            )
        raise FrictionError(
            f"{labels[i]}: several frictions in {names} balance the forces (loads grow by "
            f"{self.radius[i]:.3g} of the friction, 1 or more); reduce a coefficient",
            "undetermined",
        )


def friction_by_load(
    unit: UnitMotion, needed: Array, coordinates: Sequence[LoadedCoordinate], directions: Sequence[Array]
) -> LoadFriction:
    """Return the frictions of a state.

    A self-stress that changes no load to first order is taken as zero: in a planar mechanism, forces across
    the plane.

    Args:
        unit: the motion.
        needed: wrenches that the joints exert on the links, in columns, (n, L, 6, 1 + k): without these
            frictions, and changes by a unit of each.
        coordinates: the k coordinates with friction.
        directions: sign of the rate of each, (n,).
    """
    wrenches = linear_reactions(unit, needed, [item.joint for item in coordinates])
    terms: list[Array] = []
    stresses: list[Array] = []
    for k, (item, (wrench, alone, sound)) in enumerate(zip(coordinates, wrenches, strict=True)):
        axis, kind = unit.axis(item.joint), KINDS[item.joint.kind]
        _, maps = item.friction.loads(item.joint, axis)[item.number]
        if kind.helical and not item.number:
            wrench[:, 3:, 1 + k] -= directions[k][:, None] * axis
        terms.append(np.einsum("ntcw,nwj->ntcj", maps, wrench))
        stresses.append(np.einsum("ntcw,nws->ntcs", maps, alone * sound[:, None, None]))
    loads = np.stack(terms, 1)
    base, response = loads[..., 0], loads[..., 1:]
    magnitude, radius, residual = balanced_friction(base, response)
    final = base + np.einsum("nktcj,nj->nktc", response, magnitude)
    amount = np.sqrt((final**2).sum(-1))
    clear = amount > NO_LOAD * amount.max((1, 2), keepdims=True)
    along = final / np.where(clear, amount, np.inf)[..., None]
    stress = np.stack(stresses, 1)
    felt = np.abs(np.einsum("nktc,nktcs->nkts", along, stress))
    scale = np.sqrt((stress**2).sum(3)).max((1, 2, 3), initial=0.0)
    undetermined = (felt > FELT * scale[:, None, None, None]).any((2, 3))
    return LoadFriction(magnitude, radius, undetermined, ~(residual <= ROUNDED))


def with_load_friction(
    unit: UnitMotion, forces: Forces, acting: Applied, needed: Array, speed: Array
) -> Applied:
    """Return the applied forces of a prescribed motion with the friction by the load.

    Args:
        unit: the motion per radian of the crank.
        forces: all forces.
        acting: applied forces without this friction.
        needed: wrenches on the links that cause the motion, less loads and drives, (n, L, 6).
        speed: crank speed, (n,) in [rad/s].

    Raises:
        FrictionError: at instants without unique frictions.
    """
    coordinates = loaded_coordinates(forces, unit.mechanism)
    if not coordinates:
        return acting
    if np.iscomplexobj(unit.position):
        raise InputError(
            f"{unit.mechanism.name}: derivatives of friction by the load are not computed; give `coulomb` "
            "instead of a coefficient"
        )
    frictions = [
        dry_friction(unit, item.joint, joint_rates(unit, item.joint), item.coordinate) for item in coordinates
    ]
    sign, stacks = np.sign(speed), list[Array]()
    for item, dry in zip(coordinates, frictions, strict=True):
        stack = np.zeros_like(needed)
        add_joint_forces(unit, stack, item.joint, item.unit_forces(dry.direction))
        require_idle(unit, stack, "friction")
        stacks.append(stack)
    columns = [needed - acting.total(speed), *(-sign[:, None, None] * stack for stack in stacks)]
    directions = [sign * dry.direction for dry in frictions]
    solution = friction_by_load(unit, np.stack(columns, -1), coordinates, directions)
    solution.require_determined(
        coordinates, [f"{unit.mechanism.name} at {value:.6g} rad" for value in unit.angle]
    )
    coulomb = acting.coulomb + sum(
        (
            magnitude[:, None, None] * stack
            for magnitude, stack in zip(solution.magnitude.T, stacks, strict=True)
        ),
        0.0,
    )
    loaded = [
        replace(dry, magnitude=magnitude)
        for dry, magnitude in zip(frictions, solution.magnitude.T, strict=True)
    ]
    return replace(acting, coulomb=coulomb, dry=(*acting.dry, *loaded))
