"""Joints to lock where the drivers leave some undetermined."""

import numpy as np

from mechsim.kinematics.loops import mobility
from mechsim.kinematics.loops.constraints import TreeSolver
from mechsim.kinematics.loops.kinematics import link_poses
from mechsim.kinematics.loops.mobility import MIN_PARTICIPATION, independent_coordinates
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX, Vector, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array


def undetermined_joints(mechanism: Mechanism) -> dict[str, Vector | None]:
    """Return what must be locked so that the drivers determine the rest, as in `joints_to_lock`.

    Raises:
        AssemblyError: where the loops do not close.
    """
    return joints_to_lock(mobility.solver_at_generic_pose(mechanism)[0])


def joints_to_lock(solver: TreeSolver) -> dict[str, Vector | None]:
    """Return coordinates, balls and floating joints whose locks make the motion determined.

    Those outside loops come first; in a loop there are as many as it has undetermined degrees of freedom. A
    ball of which one rotation alone is undetermined, as of a rod between two balls, has this spin for
    `spin_rod`; the others have None.
    """
    undetermined = [*mobility.undetermined_motions(solver, loops_last=True)] if solver.nullity else []
    names, loops = [name for _, name, _ in undetermined], solver.loops
    null_space = np.zeros((solver.nullity, loops.tree.count))
    null_space[:, loops.unknown] = solver.null_space
    locks: dict[str, Vector | None] = {}
    for ball in loops.tree.balls:
        name = ball.joint.name
        if name not in names:
            continue
        axes = [axis for _, other, axis in undetermined if other == name and axis is not None]
        single = len(axes) == 1 and names.count(name) == 1 and _joins_written_links(ball.joint)
        locks[name] = _spin(solver, ball.joint, axes[0]) if single else None
        # a locked ball loses three degrees of freedom, of which other locks can have counted one
        for axis in axes if single else np.eye(3):
            component = null_space[:, ball.first_angle : ball.first_angle + 3] @ axis
            if float(np.linalg.norm(component)) > MIN_PARTICIPATION:
                null_space = mobility.with_component_locked(null_space, component)
    others = [name for name in names if name not in locks]
    return locks | dict.fromkeys(independent_coordinates(loops, others, null_space)[0])


def _joins_written_links(joint: Joint) -> bool:
    """Whether a joint is a ball without slides between links of the file."""
    return KINDS[joint.kind].pivot and not any(
        end.link.startswith(VIRTUAL_PREFIX) for end in (joint.a, joint.b)
    )


def _spin(solver: TreeSolver, ball: Joint, axis: Array) -> Vector:
    """Return an axis in the frame of a ball's side a as one of link b, as long as the mechanism."""
    tree = solver.loops.tree
    poses = link_poses(tree, solver.reference)
    from_a, to_b = (
        np.eye(3) if end.link == GROUND else poses.rotation[tree.index[end.link]][..., 0]
        for end in (ball.a, ball.b)
    )
    return vector(to_b.T @ from_a @ ball.a.frame @ axis * tree.mechanism.characteristic_length)
