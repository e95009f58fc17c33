"""The motion of any mechanism from its loop equations alone."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.loops.assembly import crank_angles
from mechsim.analytic.loops.checked_start import checked_start
from mechsim.analytic.loops.continuation_path import ContinuationPath
from mechsim.analytic.loops.joint_motion import joint_motions, point_on
from mechsim.analytic.loops.motion import crank_rate
from mechsim.analytic.loops.tree_assembly import locked_values, with_locked
from mechsim.analytic.loops.tree_motion import twists
from mechsim.analytic.loops.tree_rates import Instants, LoopMotion, loop_motion
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism, described, starting_at
from mechsim.model.motion import ChangePointPolicy, JointMotion, Motion
from mechsim.numerics.angles import TURN, other_laps
from mechsim.numerics.arrays import Array

# part of the quickest turn of any link along an idle freedom at which another turns with it
MIN_SPIN = 1e-6
# a gear ratio times turns of the crank is a whole number to this
INTEGER_TOLERANCE = 1e-12


def crank_path(mechanism: Mechanism, change_point: ChangePointPolicy = "smooth") -> ContinuationPath:
    """Return the path of a mechanism's assembly over its crank angle, as yet no longer than its start.

    Args:
        mechanism: its guess says which assembly is meant.
        change_point: "smooth" or "branch" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: where the crank leaves joints or tracked points open, or is held by the loops.
        InputError: for a mechanism without a crank.
    """
    mechanism = described(mechanism)
    crank = mechanism.crank.name
    first = checked_start(mechanism)
    initial = float(first.reference.values[first.loops.tree.index_of[crank], 0])
    locked = locked_values(mechanism)
    return ContinuationPath(first, lambda angle: with_locked(angle[None], locked), initial, change_point)


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
    crank_angle = crank_angles(mechanism, angles)
    path, motion = motion_along(
        crank_path(mechanism), crank_angle, np.zeros_like(crank_angle), np.zeros_like(crank_angle)
    )
    return {
        name: Pose(motion.position[:, i], motion.rotation[:, i]) for name, i in path.loops.tree.links.items()
    }


def solve(
    mechanism: Mechanism,
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    change_point: ChangePointPolicy = "smooth",
) -> Motion:
    """Return the motion of any mechanism from its loop equations alone.

    Where two assemblies meet on its path, as in a parallelogram laid flat, the motion goes on smoothly,
    and rates there are limits; or it folds into the other one, which keeps the sign of the loops'
    determinant, and rates there are those on one side.

    Args:
        mechanism: the mechanism, whose guess selects the assembly; or what has one, as those of the
            catalogue have, whose parameters select it at the first crank angle.
        angles: crank angles, not wrapped, in any order, (n,) in [rad] or text, as "0:360:5deg".
        speed: crank speed, scalar or (n,) in [rad/s] or text, as "600rpm".
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].
        change_point: "smooth" or "branch" where two assemblies meet.

    Raises:
        AssemblyError: where the loops do not close.
        MobilityError: where the crank leaves joints or tracked points open.

    Accuracy: relative errors of about 1e-15 times the condition of the loops; within 5e-3 rad of a change
        point 1e-12.
    """
    angles, speed = units.si_angles(angles), units.si(speed, "rad/s", "the crank's speed")
    crank_angle = crank_angles(described(mechanism), angles)
    rate = crank_rate(described(mechanism), "speed", speed, len(crank_angle))
    mechanism = starting_at(mechanism, crank_angle, float(rate[0]))
    return solve_along(crank_path(mechanism, change_point), angles, speed, acceleration)


def solve_along(
    path: ContinuationPath, angles: ArrayLike, speed: ArrayLike, acceleration: ArrayLike
) -> Motion:
    """Return the motion of a mechanism whose path may be known already; else as `solve`."""
    mechanism = path.loops.tree.mechanism
    crank_angle = crank_angles(mechanism, angles)
    rate = crank_rate(mechanism, "speed", speed, len(crank_angle))
    second = crank_rate(mechanism, "acceleration", acceleration, len(crank_angle))
    return motion_record(*motion_along(path, crank_angle, rate, second), crank_angle, rate, second)


def motion_along(
    path: ContinuationPath, angle: Array, speed: Array, acceleration: Array
) -> tuple[ContinuationPath, LoopMotion]:
    """Return the motion and its path, of a crank that only swings on whatever lap it is asked for."""
    instants = crank_instants(path, angle, speed, acceleration)
    try:
        return path, loop_motion(path, instants)
    except AssemblyError:
        for revolutions in other_laps(path.loops.tree.mechanism.start, angle):
            other_path = _on_other_revolution(path, revolutions)
            if other_path is not None:
                with suppress(AssemblyError):
                    return other_path, loop_motion(other_path, instants)
        raise


def crank_instants(path: ContinuationPath, angle: Array, speed: Array, acceleration: Array) -> Instants:
    """Return instants at crank angles (n,) in [rad] along a path, with the crank's rates (n,)."""
    zero = 0.0 * locked_values(path.loops.tree.mechanism)
    rates = with_locked(speed[None], zero), with_locked(acceleration[None], zero)
    return Instants(angle, speed, acceleration, path.prescribed(angle), *rates)


def _on_other_revolution(path: ContinuationPath, revolutions: int) -> ContinuationPath | None:
    """Return a path from the same pose so many turns of the crank on; None where gears make it another."""
    turn_offsets = list(path.loops.turn_offsets)
    tree = path.loops.tree
    crank = tree.index_of[tree.mechanism.crank.name]
    for i, row in enumerate(path.loops.couplings):
        gain = (row.left[crank] - row.right[crank] * row.coupling.slope) * revolutions
        if abs(gain - round(gain)) > INTEGER_TOLERANCE or (gain and not row.turns):
            return None
        turn_offsets[i] += round(gain) * TURN
    start = path.start.values.copy()
    start[crank] += revolutions * TURN
    loops = replace(path.loops, turn_offsets=tuple(turn_offsets))
    first = replace(path.first, loops=loops, reference=replace(path.start, values=start))
    return ContinuationPath(first, path.prescribed, path.initial + revolutions * TURN, path.policy)


def spinning_links(path: ContinuationPath) -> frozenset[str]:
    """Return the links that turn while all that is driven, and every tracked point, stands: as rods spin."""
    tree = path.loops.tree
    names: set[str] = set()
    # where more is open at the start than elsewhere no path begins
    for direction in path.first.null_space:
        rates = np.zeros((tree.count, 1))
        rates[path.loops.unknown, 0] = direction
        link_twists = twists(tree, path.first.at_reference.poses, rates)
        angular = np.abs(link_twists[:, 3:]).max((1, 2))
        names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN * angular.max()}
    return frozenset(names)


def motion_record(
    path: ContinuationPath,
    motion: LoopMotion,
    angle: Array,
    speed: Array,
    acceleration: Array,
    dimensions: Mechanism | None = None,
) -> Motion:
    """Return the motion of points, links and joints as a record; the angle is the path's parameter.

    The dimensions are the path's own, or those of a mechanism like it.
    """
    tree = path.loops.tree
    mechanism = dimensions or tree.original
    links = {name: motion.link(i) for name, i in tree.links.items()}
    joints: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        if tree.first_index(joint.name) is None:
            joints |= joint_motions(joint, links)
            continue
        for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
            index = tree.index_of[name]
            component = None if kind.single else i
            value, rate, second = motion.values[:, index], motion.rates[:, index], motion.second[:, index]
            joints[name] = JointMotion(value, rate, second, "m" if unit == "m" else "rad", component)
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
        conditioning=motion.conditioning,
        spinning=spinning_links(path),
    )
