"""Joints whose motion the drivers do not determine."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.generic_pose import with_coordinate_locked
from mechsim.analytic.loops.loop_solver import LoopSolver
from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import Coordinates, LinkPoses, link_poses
from mechsim.errors import STEPPED, MobilityError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array

# displacement along a freedom, in radians or parts of the size; a residual that is closed; and the part of
# the displacement by which a joint or a point is seen to move
DISPLACEMENT, CLOSED, MIN_MOTION = 1e-3, 1e-10, 1e-2
# a coordinate that takes part in a freedom by less takes none; and names that a refusal lists
MIN_PARTICIPATION, LISTED = 1e-6, 12


def require_determined(solver: LoopSolver) -> None:
    """Reject a mechanism with undetermined degrees of freedom; passive ones, as a rod's spin, do not count.

    Args:
        solver: of its loops, about a pose that is no special one.

    Raises:
        MobilityError: names one joint or point for each undetermined degree of freedom.
    """
    loops, names = solver.loops, undetermined_names(solver)
    floating_joints = {joint.name for joint in loops.tree.mechanism.joints if KINDS[joint.kind].floats}
    if names:
        listed = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
        base = ", hold the base (--fix-base)" if floating_joints & {*names} else ""
        raise MobilityError(
            f"{loops.tree.mechanism.name}: underdetermined: with what is driven held, {listed} "
            f"{'are' if len(names) > 1 else 'is'} left open; drive, hold or couple "
            f"{'them' if len(names) > 1 else 'it'}{base}, lock what is left open (--lock-others), "
            f"or {STEPPED}",
            "underdetermined",
        )


def undetermined_names(solver: LoopSolver) -> list[str]:
    """Return what can move while the drivers stand, one name for each undetermined degree of freedom."""
    names: list[str] = []
    for name, _ in _undetermined(solver) if solver.nullity else ():
        if len(names) == LISTED:
            return [*names, "others"]
        names += [name] if name not in names else []
    return names


def joints_to_lock(solver: LoopSolver) -> tuple[str, ...]:
    """Return coordinates, balls and floating joints with which locked nothing is undetermined.

    Those outside loops come first; in a loop as many as it has undetermined degrees of freedom.
    """
    names = (name for _, name in _undetermined(solver, loops_last=True)) if solver.nullity else ()
    return tuple(dict.fromkeys(names))


def _undetermined(solver: LoopSolver, *, loops_last: bool = False) -> Iterator[tuple[str, str]]:
    """Yield what can move, one name for each freedom: with all before it held, it still can.

    Each comes with what locks it: its coordinate, or the ball or floating joint.
    """
    loops, null_space = solver.loops, solver.null_space
    tree = loops.tree
    columns = {name: int(np.searchsorted(loops.unknown, index)) for name, index in tree.index_of.items()}
    free = [name for name, index in tree.index_of.items() if index in loops.unknown]
    joints = {name: joint for joint in tree.mechanism.joints for name in joint.coordinates}
    if loops_last:
        # a coordinate that no loop ties to others is a null-space direction of its own
        free.sort(
            key=lambda name: float(np.linalg.norm(null_space[:, columns[name]])) < 1.0 - MIN_PARTICIPATION
        )
    for name in free:
        displaced = _displaced_by(solver, null_space, columns[name])
        if displaced and name in displaced:
            label = joints[name].name if KINDS[joints[name].kind].floats else name
            yield label, label
            null_space = with_coordinate_locked(null_space, columns[name])
    # rotations of balls, which have no coordinate
    for ball in tree.balls:
        for rotation in range(ball.first_angle, ball.first_angle + 3):
            column = int(np.searchsorted(loops.unknown, rotation))
            displaced = _displaced_by(solver, null_space, column)
            if displaced:
                yield ball.joint.name if ball.kind.floats else displaced[0], ball.joint.name
                null_space = with_coordinate_locked(null_space, column)


def _displaced_by(solver: LoopSolver, null_space: Array, column: int) -> list[str]:
    """Return what moves along the null directions of a coordinate; empty for a passive one."""
    loops, components = solver.loops, null_space[:, column]
    length = float(np.linalg.norm(components))
    if length < MIN_PARTICIPATION:
        return []
    step = np.zeros((loops.tree.count, 1))
    step[loops.unknown, 0] = DISPLACEMENT * (components / length) @ null_space
    displaced_q = loops.displaced(solver.reference, step)
    try:
        closed, linearised, _ = replace(solver, reference=displaced_q).close(displaced_q)
    except np.linalg.LinAlgError:
        return []
    # at a singular pose the loops draw it back
    if np.abs(linearised.residual).max(initial=0.0) >= CLOSED:
        return []
    return _displaced_names(loops, solver.reference, closed)


def _displaced_names(loops: TreeLoops, before: Coordinates, after: Coordinates) -> list[str]:
    """Return the coordinates and tracked points that differ between two poses."""
    tree = loops.tree
    displacement = np.abs(after.values - before.values)[:, 0] / loops.units
    names = [name for name, index in tree.index_of.items() if displacement[index] > MIN_MOTION * DISPLACEMENT]
    points_before, points_after = (_points(loops, link_poses(tree, point)) for point in (before, after))
    threshold = MIN_MOTION * DISPLACEMENT * tree.mechanism.size
    return names + [
        f"point {name}"
        for name, point in points_before.items()
        if np.abs(points_after[name] - point).max() > threshold
    ]


def _points(loops: TreeLoops, poses: LinkPoses) -> Mapping[str, Array]:
    tree = loops.tree
    return {
        name: poses.position[tree.links[link], :, 0]
        + poses.rotation[tree.links[link], :, :, 0] @ np.array(local)
        for name, (link, local) in tree.mechanism.points.items()
        if link != GROUND
    }
