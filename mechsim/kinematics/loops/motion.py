"""The motion of any mechanism from its loop equations alone."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver, axis_cosines, tree_loops
from mechsim.kinematics.loops.kinematics import link_poses, twists
from mechsim.kinematics.loops.mobility import checked_start
from mechsim.kinematics.loops.path import Instants, LoopMotion, LoopPath, loop_motion
from mechsim.kinematics.loops.record import tracked_points, tree_joint_motions
from mechsim.kinematics.loops.start import ASSEMBLY, CLOSED, close_nearest, with_locked
from mechsim.kinematics.path_instants import crank_angles, crank_motion
from mechsim.mechanism.joint_kinds import antiparallel_message
from mechsim.mechanism.links import Pose
from mechsim.mechanism.mechanism import Mechanism, described, starting_at
from mechsim.mechanism.motion import ChangePointPolicy, Motion
from mechsim.mechanism.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import REVOLUTION, Array, other_revolutions
from mechsim.numerics.continuation import PathNames
from mechsim.numerics.loop_solver import loop_solver
from mechsim.numerics.path_segments import PrescribedValues
from mechsim.numerics.rank import significant

# angular velocity of a link in a passive motion, relative to the largest, above which it rotates
MIN_SPIN = 1e-6
# tolerance of integers, for a gear ratio times revolutions of the crank
INTEGER_TOLERANCE = 1e-12


def solve(
    mechanism: Mechanism,
    angles: ArrayLike,
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    change_point: ChangePointPolicy = "smooth",
) -> Motion:
    """Return the motion of any mechanism from its loop equations alone.

    At change points, such as the flat pose of a parallelogram, the motion continues by the policy: smoothly,
    with rates that are limits, or in the branch with the same sign of the loops' determinant, with one-sided
    limits of the rates.

    Args:
        mechanism: the mechanism, whose guess selects the assembly mode; or an object that has one, such as a
            catalogue mechanism, whose parameters select it at the first crank angle.
        angles: crank angles, not wrapped, in any order, (n,) in [rad] or text such as "0:360:5deg".
        speed: crank speed, scalar or (n,) in [rad/s] or text such as "600rpm".
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].
        change_point: policy "smooth" or "branch" at change points.

    Raises:
        AssemblyError: where the loops do not close.
        MobilityError: if the crank leaves joints or tracked points undetermined.

    Accuracy: relative errors of about 1e-15 times the condition number of the loops; within 5e-3 rad of a
        change point 1e-12.
    """
    name, speed = described(mechanism).name, units.si(speed, "rad/s", "the crank's speed")
    crank = crank_motion(name, angles, speed, acceleration)
    mechanism = described(starting_at(mechanism, crank[0], float(crank[1][0])))
    return solve_along(driven_path(mechanism, CRANK, change_point), *crank)


def assemble(
    mechanism: Mechanism, angles: ArrayLike, guess: Mapping[str, Pose] | None = None
) -> Mapping[str, Pose]:
    """Close the loops at each crank angle by Newton's method from a guess.

    Args:
        mechanism: the mechanism.
        angles: crank angles, (n,) in [rad].
        guess: moving link -> one pose or n poses; the default is the mechanism's own guess.

    Returns:
        Moving link -> n poses.

    Raises:
        AssemblyError: where the loops do not close; names the crank angle and the loop-closure error.

    Accuracy: residuals of a few ulp of the longest link away from a dead centre.
    """
    mechanism = described(mechanism)
    angles = crank_angles(mechanism.name, angles)
    loops, q = tree_loops(mechanism, guess)
    q = q.repeated(len(angles)) if len(q) == 1 else q
    if mechanism.has_crank:
        q.values[loops.tree.index_of[mechanism.crank.name]] = angles
    q, residual = close_nearest(loops, q)
    if not residual.max() <= CLOSED:
        index = int(np.argmax(residual))
        raise AssemblyError(
            f"{mechanism.name}: the loops do not close at crank angle {angles[index]:.6g} rad: after "
            f"{ASSEMBLY.max_iterations} Newton steps a gap of {residual[index]:.3g} of the longest link "
            "remains; change the dimensions, the crank angle or the guess"
        )
    closed_poses = link_poses(loops.tree, q)
    for name, column, cosine in axis_cosines(loops, closed_poses):
        if cosine.min() < 0.0:
            where = f"crank angle {angles[np.argmin(cosine)]:.6g} rad"
            raise AssemblyError(f"{mechanism.name}: at {where} {antiparallel_message(name, column)}")
    return closed_poses.by_link(loops.tree.links)


def solve_along(
    path: LoopPath,
    parameter: ArrayLike,
    speed: ArrayLike,
    acceleration: ArrayLike,
    motion_laws: MotionLaws = CRANK,
) -> Motion:
    """Return the motion at values of the path parameter, (n,), with its rates; otherwise as `solve`.

    Args:
        path: from `driven_path`.
        parameter: crank angles in [rad], or times multiplied by the rate of the motion laws.
        speed: rate of the parameter, scalar or (n,) in [rad/s].
        acceleration: its second derivative, scalar or (n,) in [rad/s2].
        motion_laws: motion laws of the drivers.

    Raises:
        AssemblyError: at the instant beyond which the loops cannot close in this assembly mode.
    """
    motion = crank_motion(path.name, parameter, speed, acceleration)
    return solve_prescribed(path, motion_laws, instants_of_laws(motion_laws, *motion))


def motion_along(
    path: LoopPath, angle: Array, speed: Array, acceleration: Array
) -> tuple[LoopPath, LoopMotion]:
    """Return the motion of a crank and its path, which can be that of another revolution."""
    return _motion_at(
        path, with_locked_values(path.loops, instants_of_laws(CRANK, angle, speed, acceleration)), CRANK
    )


def _motion_at(path: LoopPath, instants: Instants, motion_laws: MotionLaws) -> tuple[LoopPath, LoopMotion]:
    try:
        return path, loop_motion(path, instants)
    except AssemblyError:
        if not motion_laws.crank:
            raise
        for revolutions in other_revolutions(path.loops.tree.mechanism.start, instants.parameter):
            other_path = _on_other_revolution(path, revolutions)
            if other_path is not None:
                with suppress(AssemblyError):
                    return other_path, loop_motion(other_path, instants)
        raise


def _on_other_revolution(path: LoopPath, revolutions: int) -> LoopPath | None:
    """Return a path from the same pose other crank revolutions later; None if laws change the pose."""
    turn_offsets = list(path.loops.turn_offsets)
    tree = path.loops.tree
    crank = tree.index_of[tree.mechanism.crank.name]
    for i, row in enumerate(path.loops.couplings):
        gain = (row.left_weights[crank] - row.right_weights[crank] * row.coupling.ratio) * revolutions
        # a rotation of another joint by the crank, which a rack or a screw turns into a displacement
        carried = not row.has_revolutions and any(
            not tree.slides[i] for i in np.flatnonzero(row.right_weights) if i != crank
        )
        if abs(gain - round(gain)) > INTEGER_TOLERANCE or (gain and not row.has_revolutions) or carried:
            return None
        turn_offsets[i] += round(gain) * REVOLUTION
    start = path.start.values.copy()
    start[crank] += revolutions * REVOLUTION
    loops = replace(path.loops, turn_offsets=tuple(turn_offsets))
    first = replace(path.first, loops=loops, reference=replace(path.start, values=start))
    return LoopPath(first, path.prescribed, path.initial + revolutions * REVOLUTION, path.policy)


def spinning_links(solver: TreeSolver) -> frozenset[str]:
    """Return the links that rotate while all drivers are at rest, as spinning rods.

    Args:
        solver: about a pose that the drivers determine: tracked points are at rest too.
    """
    tree = solver.loops.tree
    names: set[str] = set()
    for direction in solver.null_space:
        rates = np.zeros((tree.count, 1))
        rates[solver.loops.unknown, 0] = direction
        link_twists = twists(tree, solver.at_reference.poses, rates)
        angular = np.abs(link_twists[:, 3:]).max((1, 2))
        names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN * angular.max()}
    return frozenset(names)


def motion_record(
    path: LoopPath, motion: LoopMotion, instants: Instants, dimensions: Mechanism | None = None
) -> Motion:
    """Return the motion of points, links and joints as a record; the angle is the path parameter.

    The dimensions are those of the path, or of a mechanism of the same structure.
    """
    tree = path.loops.tree
    mechanism = dimensions or tree.original
    links = {name: motion.link(i) for name, i in tree.links.items()}
    coordinates = motion.values.T, motion.rates.T, motion.second.T
    return Motion(
        source="loop equations",
        angle=instants.parameter,
        speed=instants.speed,
        acceleration=instants.acceleration,
        points=tracked_points(mechanism, links),
        links=links,
        joints=tree_joint_motions(tree, mechanism.joints, links, coordinates),
        conditioning=motion.conditioning,
        # with more undetermined motions at the start than elsewhere no path begins
        spinning=spinning_links(path.first),
    )


def driven_path(
    mechanism: Mechanism, motion_laws: MotionLaws = CRANK, change_point: ChangePointPolicy = "smooth"
) -> LoopPath:
    """Return the path of a mechanism's assembly mode over its crank angle, or over its motion laws.

    It contains only its start.

    Args:
        mechanism: its guess selects the assembly mode; from the guess the drivers move straight to the start
            of their laws.
        motion_laws: motion laws of its drivers.
        change_point: policy "smooth" or "branch" at change points.

    Raises:
        AssemblyError: where the loops do not close at the guess or on the path to the start of the laws.
        MobilityError: if the drivers leave joints or tracked points undetermined, or are redundant.
        InputError: for a mechanism without a crank, if no motion laws are given.
    """
    crank = mechanism.crank.name if motion_laws.crank else None
    first = checked_start(mechanism)

    def prescribed(parameter: Array) -> Array:
        return with_locked(mechanism, motion_laws.along_path(parameter)[0])

    if crank is not None:
        initial = float(first.reference.values[first.loops.tree.index_of[crank], 0])
        return LoopPath(first, prescribed, initial, change_point)
    first = _moved_to_start(first, prescribed(np.zeros(1)), change_point)
    names = PathNames("the drivers", motion_laws.instant_label, motion_laws.instant_label)
    return LoopPath(first, prescribed, 0.0, change_point, names)


def straight_line(loops: TreeLoops, start: Array, target: Array) -> tuple[PrescribedValues, float]:
    """Return the straight line between two sets of prescribed coordinates, (driven, 1), and its length."""
    distance = float(np.abs((target - start) / loops.units[[*loops.driven], None]).max())
    return lambda s: start + (target - start) * (s / distance), distance


def _moved_to_start(first: TreeSolver, target: Array, policy: ChangePointPolicy) -> TreeSolver:
    """Return the solver after the prescribed coordinates, (driven, 1), have moved straight to a target."""
    loops = first.loops
    prescribed, distance = straight_line(loops, first.reference.values[[*loops.driven]], target)
    if distance == 0.0:
        return first

    def position(s: float) -> str:
        names = (*loops.tree.mechanism.drivers, *loops.tree.mechanism.locked)
        values = prescribed(np.array([s]))[:, 0]
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, values, strict=True))

    path_names = PathNames("the drivers on their way to the start of the motion laws", position, position)
    path = LoopPath(first, prescribed, 0.0, policy, path_names)
    path.reach(distance, 1)
    # the last segment may continue to a dead centre
    last, s = path.segments[1][-1], np.array([distance])
    return loop_solver(loops, path.unflat(last.evaluate(s), s, target))


def instants_of_laws(
    motion_laws: MotionLaws, parameter: Array, speed: Array, acceleration: Array
) -> Instants:
    """Return the driver positions at path parameters, with its rates, (n,) each."""
    value, first, second = motion_laws.along_path(parameter)
    rate, second_rate = first * speed, first * acceleration + second * speed**2
    return Instants(parameter, speed, acceleration, value, rate, second_rate)


def solve_prescribed(path: LoopPath, motion_laws: MotionLaws, instants: Instants) -> Motion:
    """Return the motion at instants, whose driver positions may deviate slightly from their motion laws.

    Raises:
        AssemblyError: as `solve_along`.
    """
    path, motion = _motion_at(path, with_locked_values(path.loops, instants), motion_laws)
    record = motion_record(path, motion, instants)
    return replace(record, time=motion_laws.time(instants.parameter), drivers=motion_laws.drivers)


def with_locked_values(loops: TreeLoops, instants: Instants) -> Instants:
    """Return instants of the drivers completed by the locked coordinates."""
    mechanism = loops.tree.mechanism
    return replace(
        instants,
        value=with_locked(mechanism, instants.value),
        rate=with_locked(mechanism, instants.rate, 1),
        second=with_locked(mechanism, instants.second, 2),
    )


def conditioning(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Array:
    """Return the distance of closed poses from singular ones with the drivers fixed, (n,), 0 to about 1.

    It is the smallest singular value of the loop Jacobian, as `LoopMotion.conditioning`, without those that
    are zero at every pose, of redundant equations and passive degrees of freedom.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses.
    """
    loops, q = tree_loops(mechanism, poses, {})
    jacobian = loops.linearise(q)[1][:, loops.unknown]
    values = np.asarray(np.linalg.svd(jacobian.transpose(2, 0, 1), compute_uv=False), dtype=np.float64)
    rank = int(significant(values).sum(1).max(initial=0))
    return values[:, rank - 1] if rank else np.ones(len(values))


def conditioning_of(mechanism: Mechanism, motion: Motion) -> Array:
    """Return the distance of each configuration of a motion from a singular one, (n,)."""
    if motion.conditioning is not None:
        return motion.conditioning
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    return conditioning(mechanism, poses)
