"""The motion of any mechanism from its loop equations alone."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.closure.assembly import crank_angles
from mechsim.analytic.closure.checked_start import checked_start
from mechsim.analytic.closure.followed_path import FollowedPath
from mechsim.analytic.closure.joint_motion import joint_motions, point_on
from mechsim.analytic.closure.motion import crank_rate
from mechsim.analytic.closure.tree_assembly import held_values, with_holds
from mechsim.analytic.closure.tree_motion import twists
from mechsim.analytic.closure.tree_rates import Instants, LoopMotion, loop_motion
from mechsim.errors import AssemblyError
from mechsim.maths.angles import TURN, other_laps
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism, described, starting_at
from mechsim.model.motion import ChangePointPolicy, JointMotion, Motion

# part of the quickest turn of any link along an idle freedom at which another turns with it
SPINS = 1e-6
# a gear ratio times turns of the crank is a whole number to this
WHOLE = 1e-12


def followed(mechanism: Mechanism, change_point: ChangePointPolicy = "smooth") -> FollowedPath:
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
    begin = float(first.pinned.values[first.loops.tree.places[crank], 0])
    held = held_values(mechanism)
    return FollowedPath(first, lambda angle: with_holds(angle[None], held), begin, change_point)


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
    path, found = moved_along(followed(mechanism), asked, np.zeros_like(asked), np.zeros_like(asked))
    return {
        name: Pose(found.position[:, i], found.rotation[:, i]) for name, i in path.loops.tree.links.items()
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
    asked = crank_angles(described(mechanism), angles)
    rate = crank_rate(described(mechanism), "speed", speed, len(asked))
    mechanism = starting_at(mechanism, asked, float(rate[0]))
    return solve_along(followed(mechanism, change_point), angles, speed, acceleration)


def solve_along(path: FollowedPath, angles: ArrayLike, speed: ArrayLike, acceleration: ArrayLike) -> Motion:
    """Return the motion of a mechanism whose path may be known already; else as `solve`."""
    mechanism = path.loops.tree.mechanism
    asked = crank_angles(mechanism, angles)
    rate = crank_rate(mechanism, "speed", speed, len(asked))
    second = crank_rate(mechanism, "acceleration", acceleration, len(asked))
    return recorded(*moved_along(path, asked, rate, second), asked, rate, second)


def moved_along(
    path: FollowedPath, angle: Array, speed: Array, acceleration: Array
) -> tuple[FollowedPath, LoopMotion]:
    """Return the motion and its path, of a crank that only swings on whatever lap it is asked for."""
    instants = crank_instants(path, angle, speed, acceleration)
    try:
        return path, loop_motion(path, instants)
    except AssemblyError:
        for laps in other_laps(path.loops.tree.mechanism.start, angle):
            other = _counted(path, laps)
            if other is not None:
                with suppress(AssemblyError):
                    return other, loop_motion(other, instants)
        raise


def crank_instants(path: FollowedPath, angle: Array, speed: Array, acceleration: Array) -> Instants:
    """Return instants at crank angles (n,) in [rad] along a path, with the crank's rates (n,)."""
    still = 0.0 * held_values(path.loops.tree.mechanism)
    rates = with_holds(speed[None], still), with_holds(acceleration[None], still)
    return Instants(angle, speed, acceleration, path.drive(angle), *rates)


def _counted(path: FollowedPath, laps: int) -> FollowedPath | None:
    """Return a path from the same pose so many turns of the crank on; None where gears make it another."""
    winds = list(path.loops.winds)
    tree = path.loops.tree
    crank = tree.places[tree.mechanism.crank.name]
    for i, row in enumerate(path.loops.couplings):
        gain = (row.left[crank] - row.right[crank] * row.coupling.slope) * laps
        if abs(gain - round(gain)) > WHOLE or (gain and not row.turns):
            return None
        winds[i] += round(gain) * TURN
    start = path.start.values.copy()
    start[crank] += laps * TURN
    loops = replace(path.loops, winds=tuple(winds))
    first = replace(path.first, loops=loops, pinned=replace(path.start, values=start))
    return FollowedPath(first, path.drive, path.begin + laps * TURN, path.passing)


def spinning(path: FollowedPath) -> frozenset[str]:
    """Return the links that turn while all that is driven, and every tracked point, stands: as rods spin."""
    tree = path.loops.tree
    found: set[str] = set()
    # where more is open at the start than elsewhere no path begins
    for freedom in path.first.gauge:
        rates = np.zeros((tree.count, 1))
        rates[path.loops.unknown, 0] = freedom
        moved = twists(tree, path.first.there.here, rates)
        turning = np.abs(moved[:, 3:]).max((1, 2))
        found |= {name for name, i in tree.links.items() if turning[i] > SPINS * turning.max()}
    return frozenset(found)


def recorded(
    path: FollowedPath,
    found: LoopMotion,
    angle: Array,
    speed: Array,
    acceleration: Array,
    dimensions: Mechanism | None = None,
) -> Motion:
    """Return the motion of points, links and joints as a record; the angle is the path's parameter.

    The dimensions are the path's own, or those of a mechanism like it.
    """
    tree = path.loops.tree
    mechanism = dimensions or tree.given
    links = {name: found.link(i) for name, i in tree.links.items()}
    joints: dict[str, JointMotion] = {}
    for joint in mechanism.joints:
        kind = KINDS[joint.kind]
        if tree.place(joint.name) is None:
            joints |= joint_motions(joint, links)
            continue
        for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
            of = tree.places[name]
            part = None if kind.single else i
            value, rate, second = found.values[:, of], found.rates[:, of], found.second[:, of]
            joints[name] = JointMotion(value, rate, second, "m" if unit == "m" else "rad", part)
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
        conditioning=found.conditioning,
        spinning=spinning(path),
    )
