"""Passive rotations of links without a moment of inertia about their line, such as a thin rod between balls.

They move no mass, and no force drives them: with any moment of inertia about the line the other links move in
the same way as long as the angular momentum about it is zero. Such a link therefore gets a moment about its
line, and its rates none of that momentum (Featherstone 2008, section 2.13: the inertia of an axisymmetric
body does not change as it spins).
"""

from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.loops.kinematics import twists
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import null_space

# eigenvalue of the reduced mass matrix relative to the trace of the mass matrix that counts as zero: rounding
NO_INERTIA = 1e-14
# velocity of a point on the axis of a rotation, force on it and change of rates that count as zero, relative
ROUNDING = 1e-9


def with_determined_motion(state: Kinematics) -> Kinematics:
    """Return a state whose equations let every motion move mass, with rates without passive rotations.

    Raises:
        InputError: if the loops allow another motion that moves no mass, so that its acceleration is
            undetermined, and for a force or a rate about the axis of a passive rotation.
    """
    equations = state.equations
    mass, null = state.mass[0], null_space(state.jacobian[0])
    values, vectors = np.linalg.eigh(null @ mass @ null.T)
    empty = values <= NO_INERTIA * np.trace(mass)
    if not empty.any() and (len(values) or equations.prescribed):
        return state
    directions = null.T @ vectors[:, empty]
    require_idle(equations, state, directions)
    moment = float(np.trace(mass)) / max(len(mass), 1) or 1.0
    moments = np.zeros((len(equations.links), 3, 3))
    for direction in directions.T:
        spins = _twists(equations, state, direction)[:, 3:]
        local = np.einsum("lji,lj->li", state.poses.rotation[equations.links, ..., 0], spins)
        moments += moment * np.einsum("li,lj->lij", local, local)
    equations = replace(equations, added_moments=moments)
    # rates without momentum along the passive rotations
    momenta = directions.T @ equations.kinematics(state.q, state.rates).mass[0]
    rates, free = state.rates.copy(), equations.free
    rates[free] -= directions @ np.linalg.solve(momenta @ directions, momenta @ state.rates[free])
    return equations.kinematics(state.q, rates)


def require_idle(equations: EquationsOfMotion, state: Kinematics, directions: Array) -> None:
    """Raise InputError unless motions (free, k) that move no mass are rotations of links without forces."""
    name = equations.model.mechanism.name
    force, magnitude = equations.smooth_forces(state)
    if not directions.shape[1]:
        raise InputError(f"{name} cannot move: its loops and locked joints leave no degree of freedom")
    for direction in directions.T:
        if not _rotates_in_place(equations, state, direction):
            moving = int(equations.free[np.argmax(np.abs(direction))])
            names = {index: joint for joint, index in equations.loops.tree.index_of.items()}
            raise InputError(
                f"{name}: {names.get(moving, 'a spherical joint')} can move without moving any mass, so that "
                "its acceleration is not determined; give the links that it moves a mass or moments of "
                "inertia, or drive it"
            )
        if abs(direction @ force[0]) > ROUNDING * float(magnitude[0].max()):
            raise InputError(
                f"{name}: a force acts about the line of a link that has no moment of inertia about it; give "
                "it one, or let the force act on the line"
            )


def _twists(equations: EquationsOfMotion, state: Kinematics, direction: Array) -> Array:
    """Return the twist of each link at the ground's origin for rates along a direction (free,), (L, 6)."""
    rates = np.zeros((equations.loops.tree.count, 1))
    rates[equations.free, 0] = direction
    tree = equations.loops.tree
    return twists(tree, state.poses, rates * equations.loops.units[:, None])[equations.links, :, 0]


def _rotates_in_place(equations: EquationsOfMotion, state: Kinematics, direction: Array) -> bool:
    """Return whether links only rotate about lines through their centres of mass and their joints."""
    mechanism = equations.model.mechanism
    floating = {joint.name for joint in mechanism.joints if KINDS[joint.kind].floating}
    twists_of_links = _twists(equations, state, direction)
    for link, index, twist in zip(mechanism.links, equations.links, twists_of_links, strict=True):
        points = [
            end.point
            for joint in mechanism.joints
            for end in (joint.a, joint.b)
            if end.link == link.name and joint.name not in floating
        ]
        if link.inertia is not None and link.inertia.mass:
            points.append(link.inertia.centre)
        rotation, origin = state.poses.rotation[index, ..., 0], state.poses.position[index, :, 0]
        for point in points:
            velocity = twist[:3] + np.cross(twist[3:], origin + rotation @ np.array(point))
            if np.abs(velocity).max() > ROUNDING * mechanism.characteristic_length:
                return False
    return True
