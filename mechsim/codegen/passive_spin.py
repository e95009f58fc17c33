"""Links whose spin nothing determines, as rods between two balls: a universal joint holds the spin.

Positions, rates of everything else and drive torques are the same: such a link is round about its line.
"""

from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.kinematics import LinkPoses, twists
from mechsim.analytic.loops.mobility import checked_start
from mechsim.analytic.loops.solver import LoopSolver
from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# angular velocity along a null-space vector, relative to the largest, below which a link does not spin
STILL = 1e-6
# directions among which the first axis of a universal joint is chosen
DIRECTIONS = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (0, 1) if x or y or z], float
)


def without_passive_spin(solver: LoopSolver, poses: LinkPoses) -> tuple[Mechanism, dict[str, Array]]:
    """Return a mechanism in which universal joints replace balls that leave links to spin.

    Args:
        solver: of the loops at the start, with a null space.
        poses: of the links over the range of the motion.

    Returns:
        The mechanism, and spinning link -> axis in its frame, (3,).

    Raises:
        InputError: where no ball leads from a link that does not spin to one that does.
    """
    mechanism, spinning = solver.loops.tree.mechanism, dict[str, Array]()
    index = solver.loops.tree.index
    while solver.nullity:
        axes = _spin_axes(solver)
        rotation = solver.at_reference.poses.rotation
        spinning |= {name: rotation[index[name], :, :, 0].T @ axis for name, axis in axes.items()}
        joint = next((joint for joint in mechanism.joints if _holds_spin(joint, axes)), None)
        if joint is None:
            raise InputError(
                f"{mechanism.name}: nothing determines the spin of link {next(iter(axes))!r}, which no "
                "spherical joint joins to a link that does not spin; lock it, or give it a universal joint"
            )
        replaced = _as_universal(joint, axes, solver, poses, spinning)
        mechanism = replace(
            mechanism, joints=tuple(replaced if other is joint else other for other in mechanism.joints)
        )
        solver = checked_start(mechanism)
    return mechanism, spinning


def _spin_axes(solver: LoopSolver) -> dict[str, Array]:
    """Return the links that move along the null space -> the direction of their angular velocity, (3,)."""
    loops, count = solver.loops, solver.nullity
    rates = np.zeros((loops.tree.count, count, 1))
    rates[loops.unknown, :, 0] = solver.null_space.T
    angular = np.stack(
        [
            twists(loops.tree, solver.at_reference.poses, rates[:, k] * loops.units[:, None])[:, 3:, 0]
            for k in range(count)
        ]
    )
    fastest = np.abs(angular).max()
    axes: dict[str, Array] = {}
    for name, i in loops.tree.index.items():
        if np.abs(angular[:, i]).max() > STILL * fastest:
            axes[name] = np.linalg.svd(angular[:, i])[2][0]
    return axes


def _holds_spin(joint: Joint, axes: dict[str, Array]) -> bool:
    return (
        KINDS[joint.kind].ball
        and not KINDS[joint.kind].slides
        and ((joint.a.link in axes) != (joint.b.link in axes))
    )


def _as_universal(
    joint: Joint, axes: dict[str, Array], solver: LoopSolver, poses: LinkPoses, spinning: dict[str, Array]
) -> Joint:
    """Return a universal joint in place of a ball, its first axis far from the line of the spinning link."""
    index = solver.loops.tree.index
    other, spinner = (joint.a, joint.b) if joint.b.link in axes else (joint.b, joint.a)
    line = np.einsum("ijn,j->in", poses.rotation[index[spinner.link]], spinning[spinner.link])
    if other.link != GROUND:
        line = np.einsum("jin,jn->in", poses.rotation[index[other.link]], line)
    directions = DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]
    fixed = directions[np.argmin(np.abs(directions @ line).max(1))]
    at_start = solver.at_reference.poses.rotation[..., 0]
    in_ground = fixed if other.link == GROUND else at_start[index[other.link]] @ fixed
    across = at_start[index[spinner.link]].T @ np.cross(in_ground, axes[spinner.link])
    first = replace(other, axis=_vector(fixed), reference=None)
    second = replace(spinner, axis=_vector(across), reference=None)
    a, b = (first, second) if spinner is joint.b else (second, first)
    return Joint(joint.name, "universal", a, b)


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values / np.linalg.norm(values))
    return x, y, z
