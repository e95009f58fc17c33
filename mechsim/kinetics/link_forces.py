"""Generalised forces and mass matrices from forces and inertias of links, on arrays over n states.

Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), sections 2.13 and 6.5.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.kinetics.applied_forces import add_joint_force, add_joint_forces
from mechsim.kinetics.unit_motion import UnitMotion, mass_matrices
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joints import Joint
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.rank import significant


@dataclass(frozen=True, slots=True)
class LoadedCoordinate:
    """A friction by the load: its number in its joint, the coordinate that it opposes, its constant part."""

    friction: Friction
    joint: Joint
    number: int
    coordinate: int
    constant: float


@dataclass(frozen=True, slots=True)
class DryFriction:
    """A Coulomb friction: a joint, the index of its coordinate, and its magnitude in [N m] or [N].

    The magnitude is without the frictions by the load, which are `loads`.
    """

    joint: Joint
    coordinate: int
    magnitude: float
    friction: Friction
    loads: tuple[LoadedCoordinate, ...] = ()


def spatial_inertias(unit: UnitMotion, masses: Array, centres: Array, moments: Array) -> Array:
    """Return each link's spatial inertia at the ground's origin, linear before angular, (n, L, 6, 6).

    Args:
        unit: the links' motion.
        masses: (L,) in [kg].
        centres: centres of mass in the links' frames, (L, 3).
        moments: inertia matrices about them in the links' frames, (L, 3, 3).
    """
    rotation = unit.rotation
    centre = unit.position + (rotation @ centres[..., None])[..., 0]
    return mass_matrices(masses, centre, rotation @ moments @ np.swapaxes(rotation, -1, -2))


def inertial_wrenches(twist: Array, bias: Array, inertia: Array) -> Array:
    """Return the inertial wrenches at zero accelerations, at the ground's origin, (n, L, 6).

    Args:
        twist: twist of each link at the ground's origin, (n, L, 6).
        bias: acceleration of each link at constant rates, (n, L, 6).
        inertia: spatial inertias, (n, L, 6, 6).
    """
    momentum, wrench = ((inertia @ value[..., None])[..., 0] for value in (twist, bias))
    linear, angular = twist[..., :3], twist[..., 3:]
    wrench[..., :3] += cross(angular, momentum[..., :3])
    wrench[..., 3:] += cross(angular, momentum[..., 3:]) + cross(linear, momentum[..., :3])
    return wrench


def generalised_forces(
    unit: UnitMotion, jacobians: Array, wrenches: Array, less: Array | float = 0.0
) -> Array:
    """Return the generalised forces, (n, free).

    Args:
        unit: the links' motion.
        jacobians: Jacobians of the links, (n, L, 6, free).
        wrenches: wrenches about the links' origins, (n, L, 6).
        less: wrenches at the ground's origin that are subtracted.
    """
    moved = wrenches - less
    moved[..., 3:] += cross(unit.position, wrenches[..., :3])
    return np.einsum("nlij,nli->nj", jacobians, moved)


def mass_matrix(jacobians: Array, inertia: Array) -> Array:
    """Return the mass matrix (n, free, free) from Jacobians and spatial inertias of the links."""
    n, links, _, columns = jacobians.shape
    momentum = (inertia @ jacobians).reshape(n, 6 * links, columns)
    return jacobians.reshape(n, 6 * links, columns).transpose(0, 2, 1) @ momentum


def kinetic_energy(mass: Array, rates: Array) -> Array:
    """Return the kinetic energy, (n,) in [J], from mass matrices (n, k, k) and rates (n, k)."""
    return 0.5 * np.einsum("ni,nij,nj->n", rates, mass, rates)


def friction_wrenches(friction: DryFriction, unit: UnitMotion) -> Array:
    """Return the wrenches of a unit force of a friction on the links, (n, L, 6)."""
    stack = np.zeros_like(unit.twist)
    add_joint_force(unit, stack, friction.joint, friction.coordinate, np.ones(len(unit)))
    return stack


def joint_wrenches(unit: UnitMotion, forces: Mapping[str, Array]) -> Array:
    """Return the wrenches on the links, (n, L, 6), of forces (n,) along joint coordinates."""
    stack, zero = np.zeros_like(unit.twist), np.zeros(len(unit))
    for joint in unit.mechanism.joints:
        if not forces.keys().isdisjoint(joint.coordinates):
            add_joint_forces(unit, stack, joint, [forces.get(name, zero) for name in joint.coordinates])
    return stack


def causing_wrenches(unit: UnitMotion, acceleration: Array) -> Array:
    """Return the wrenches about the links' origins that cause accelerations, (n, L, 6) each.

    The accelerations are spatial ones at the ground's origin, those of inertial_wrenches.
    """
    linear = acceleration[..., :3] + cross(acceleration[..., 3:], unit.position)
    linear = linear + cross(unit.twist[..., 3:], unit.twist[..., :3])
    moved = replace(unit, bias=np.concatenate([linear, acceleration[..., 3:]], -1))
    return moved.inertial(np.ones(len(unit)), np.zeros(len(unit)))


def constrained_acceleration(mass: Array, force: Array, rows: Array, gamma: Array) -> tuple[Array, Array]:
    """Solve M a = Q + J' lambda, J a + gamma = 0, also for redundant constraints.

    Args:
        mass: (n, k, k), positive definite.
        force: (n, k).
        rows: constraint Jacobian J, (n, m, k).
        gamma: (n, m).

    Returns:
        Accelerations, (n, k), and the minimum-norm multipliers, (n, m).
    """
    if not rows.shape[1]:
        unconstrained: Any = np.linalg.solve(mass, force[..., None])[..., 0]
        return unconstrained, np.zeros_like(gamma)
    u, values, vh = np.linalg.svd(rows, full_matrices=False)
    kept = significant(values)
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    basis = vh * kept[..., None]
    along = np.swapaxes(vh, 1, 2) * inverse[:, None]
    particular = -(along @ (np.swapaxes(u, 1, 2) @ gamma[..., None]))
    projector = np.eye(mass.shape[1]) - np.swapaxes(basis, 1, 2) @ basis
    scale = np.trace(mass, axis1=1, axis2=2)[:, None, None] / mass.shape[1]
    # drivers may move links without mass
    reduced = projector @ mass @ projector + (scale + (scale == 0.0)) * (np.eye(mass.shape[1]) - projector)
    # forces that are not finite give such accelerations, which the integrator rejects
    with np.errstate(invalid="ignore", over="ignore"):
        free = np.linalg.solve(reduced, projector @ (force[..., None] - mass @ particular))
        acceleration = projector @ free + particular
        multipliers = u @ (inverse[..., None] * (vh @ (mass @ acceleration - force[..., None])))
    result: Array = np.asarray(acceleration[..., 0])
    return result, multipliers[..., 0]


def responses(mass: Array, forces: Array, rows: Array) -> tuple[Array, Array]:
    """Return the accelerations (c, n, k) and multipliers (c, n, m) by c forces (c, n, k) alone.

    They solve the equations of `constrained_acceleration` without velocity-product terms.
    """
    count, n, _ = forces.shape
    many_masses, many_rows = (np.tile(value, (count, 1, 1)) for value in (mass, rows))
    still = np.zeros((count * n, rows.shape[1]))
    solution = constrained_acceleration(many_masses, forces.reshape(count * n, -1), many_rows, still)
    acceleration, multipliers = (values.reshape(count, n, -1) for values in solution)
    return acceleration, multipliers
