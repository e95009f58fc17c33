"""The motion of any mechanism from its loop equations alone."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.assembly import assemble, crank_angles
from mechsim.analytic.closure.followed_path import FollowedPath
from mechsim.analytic.closure.motion import crank_rate, joint_motion, point_on
from mechsim.analytic.closure.open_joints import require_determined
from mechsim.analytic.closure.rank import conditioning
from mechsim.analytic.closure.tree_loops import tree_loops
from mechsim.analytic.closure.tree_rates import LoopMotion, loop_motion
from mechsim.errors import AssemblyError
from mechsim.maths.angles import TURN, other_laps
from mechsim.maths.arrays import Array
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import GROUND, Mechanism, Pose, described
from mechsim.model.motion import JointMotion, Motion, Through

# a gear ratio times turns of the crank is a whole number to this
WHOLE = 1e-12


def followed(mechanism: Mechanism, through: Through = "smooth") -> FollowedPath:
    """Return the path of a mechanism's assembly over its crank angle, as yet no longer than its start.

    Args:
        mechanism: its guess says which assembly is meant.
        through: "smooth" or "fold" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: where the crank leaves joints or tracked points open.
    """
    mechanism = described(mechanism)
    poses = assemble(mechanism, [mechanism.start])
    loops, start = tree_loops(mechanism, poses, mechanism.start)
    require_determined(loops, start)
    return FollowedPath(loops, lambda angle: angle[None], start, mechanism.start, through)


def follow(mechanism: Mechanism, angles: ArrayLike) -> dict[str, Pose]:
    """Return the poses at crank angles in the assembly of the mechanism's guess: moving link -> n poses.

    Args:
        mechanism: the mechanism; its guess says which assembly is meant.
        angles: crank angles, not wrapped, in any order, (n,) in [rad].

    Raises:
        AssemblyError: where the loops do not close.
        MobilityError: where the crank leaves joints or tracked points open.

    Accuracy: residuals of a few ulp of the longest link away from a dead centre.
    """
    mechanism = described(mechanism)
    asked = crank_angles(mechanism, angles)
    path, found = _moved(mechanism, asked, np.zeros_like(asked), np.zeros_like(asked))
    return {
        name: Pose(found.position[:, i], found.rotation[:, i]) for name, i in path.loops.tree.links.items()
    }


def solve(
    mechanism: Mechanism,
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    through: Through = "smooth",
) -> Motion:
    """Return the motion of any mechanism from its loop equations alone.

    Where two assemblies meet on its path, as in a parallelogram laid flat, the motion goes on smoothly,
    and rates there are limits; or it folds into the other one, which keeps the sign of the loops'
    determinant, and rates there are those on one side.

    Args:
        mechanism: the mechanism; its guess says which assembly is meant.
        angles: crank angles, not wrapped, in any order, (n,) in [rad].
        speed: crank speed, scalar or (n,) in [rad/s].
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].
        through: "smooth" or "fold" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close.
        MobilityError: where the crank leaves joints or tracked points open.

    Accuracy: relative errors of about 1e-15 times the condition of the loops; within 5e-3 rad of a change
        point 1e-12.
    """
    mechanism = described(mechanism)
    asked = crank_angles(mechanism, angles)
    rate = crank_rate(mechanism, "speed", speed, len(asked))
    second = crank_rate(mechanism, "acceleration", acceleration, len(asked))
    return recorded(*_moved(mechanism, asked, rate, second, through), asked, rate, second)


def _moved(
    mechanism: Mechanism, angle: Array, speed: Array, acceleration: Array, through: Through = "smooth"
) -> tuple[FollowedPath, LoopMotion]:
    """Return the motion and its path, of a crank that only swings on whatever lap it is asked for."""
    path = followed(mechanism, through)
    try:
        return path, loop_motion(path, angle, speed, acceleration)
    except AssemblyError:
        for laps in other_laps(mechanism.start, angle):
            other = _counted(path, laps)
            if other is not None:
                with suppress(AssemblyError):
                    return other, loop_motion(other, angle, speed, acceleration)
        raise


def _counted(path: FollowedPath, laps: int) -> FollowedPath | None:
    """Return a path from the same pose so many turns of the crank on; None where gears make it another."""
    winds = list(path.loops.winds)
    for i, gear in enumerate(path.loops.tree.mechanism.gears):
        if gear.driver == path.loops.tree.mechanism.driver:
            gain = gear.ratio * laps
            if abs(gain - round(gain)) > WHOLE:
                return None
            winds[i] -= round(gain) * TURN
    start = path.start.values.copy()
    start[list(path.loops.driven)] += laps * TURN
    loops = replace(path.loops, winds=tuple(winds))
    begin = path.begin + laps * TURN
    return FollowedPath(loops, path.drive, replace(path.start, values=start), begin, path.passing)


def recorded(
    path: FollowedPath, found: LoopMotion, angle: Array, speed: Array, acceleration: Array
) -> Motion:
    """Return the motion of points, links and joints as a record."""
    tree = path.loops.tree
    mechanism = tree.mechanism
    poses = {name: Pose(found.position[:, i], found.rotation[:, i]) for name, i in tree.links.items()}
    links = {name: found.link(i) for name, i in tree.links.items()}
    joints: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        if not kind.single:
            continue
        place = tree.place(joint.name)
        if place is None:
            joints[joint.name] = joint_motion(joint, links)
        else:
            joints[joint.name] = JointMotion(
                found.values[:, place],
                found.rates[:, place],
                found.second[:, place],
                "rad" if kind.hinge else "m",
            )
    return Motion(
        source="loop equations",
        angle=angle,
        speed=speed,
        acceleration=acceleration,
        points={
            point: point_on(links[link], local)
            for point, (link, local) in mechanism.points.items()
            if link != GROUND
        },
        links=links,
        joints=joints,
        conditioning=conditioning(mechanism, poses),
    )
