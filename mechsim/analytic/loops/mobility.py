"""What the drivers determine, by rank at generic poses: undetermined joints and redundant drivers."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.loops.constraints import LoopSystem, TreeLoops, TreeSolver, tree_loops
from mechsim.analytic.loops.kinematics import Coordinates, LinkPoses, link_poses
from mechsim.analytic.loops.start import assembled, closed
from mechsim.errors import STEPPED, AssemblyError, MobilityError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.link_poses import initial_coordinates, rough_poses
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.loop_solver import NEARBY, loop_solver
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, least_norm, null_spaces, rank, significant

# dimensions are taken to be known to this part of the size, and axes to as many radians: files with six
# digits are off by 1e-6, and no linkage that was meant to be rigid moves for so little. Rows below it at all,
# of a ball at the point through which all axes of its loop pass, are such digits and nothing else
DIMENSION_TOLERANCE = 1e-5
# displacement from one pose to the next, in radians or parts of the size
SPACING = 0.15
# poses at which ranks are evaluated: at one of them the rank may be lower
SAMPLED_POSES = 5
# generic poses at which the rank is compared with that at the start
PROBES = 2
# Gauss-Newton steps to a generic pose: the residual of inconsistent equations remains, the steps vanish
CONSISTENT = NewtonSettings(max_iterations=40, rounding=0.0, last_step=1e-12, max_step=0.3)


def generic_poses(
    loops: TreeLoops, start: Coordinates, count: int, tolerance: float, floor: float = FLOOR
) -> list[Coordinates]:
    """Return poses near a start, one after the other, drivers and holds as free as the rest.

    Args:
        loops: of the mechanism.
        start: one set of coordinates, closed or nearly so.
        count: of poses.
        tolerance: singular values below this part of the largest are zero.
        floor: so are those below it.
    """
    random, q = np.random.default_rng(7), nearest_consistent(loops, start, tolerance, floor)
    poses: list[Coordinates] = []
    for _ in range(count):
        null_space = null_spaces(loops.linearise(q)[1][..., 0], tolerance, floor)[1]
        step = null_space.T @ random.standard_normal(len(null_space))
        longest = float(np.abs(step).max(initial=0.0))
        if longest > 0.0:
            q = nearest_consistent(
                loops, loops.displaced(q, (step * SPACING / longest)[:, None]), tolerance, floor
            )
        poses.append(q)
    return poses


def nearest_consistent(
    loops: TreeLoops, q: Coordinates, tolerance: float, floor: float = FLOOR
) -> Coordinates:
    """Return the configuration nearest to one that reduces the residual of the independent equations most."""
    system = LoopSystem(loops, np.arange(loops.tree.count))
    return newton(system, q, CONSISTENT, lambda matrix, right: least_norm(matrix, right, tolerance, floor)).q


def with_coordinate_locked(null_space: Array, coordinate: int) -> Array:
    """Return the null_space in which a coordinate that has part in them does not move, one fewer."""
    component = null_space[:, coordinate]
    rows = np.flatnonzero(component)
    # a reflection puts all of the coordinate's part into the first of them
    mirror = component[rows]
    mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
    reflected = np.outer(2.0 / (mirror @ mirror) * mirror[1:], mirror @ null_space[rows])
    remaining = np.delete(null_space, rows[0], 0)
    remaining[rows[1:] - 1] -= reflected
    return remaining


# smallest participation of a driver in a degree of freedom
MIN_DRIVER_PARTICIPATION = 1e-7
# smallest share of a loop in dependent rows for it to be named
MIN_SHARE = 0.1


def require_no_redundant_drivers(solver: TreeSolver) -> None:
    """Reject drivers and locked joints that those before them determine already.

    Args:
        solver: of the mechanism's loops, about coordinates closed or nearly so; what cannot be closed at all
            is left to others.

    Raises:
        MobilityError: naming them.
    """
    loops, start = solver.loops, solver.reference
    if rank(solver.at_reference.jacobian[..., 0]) == len(solver.rows):
        return
    # at a dead centre a single crank cannot move either: another pose decides
    (q,) = generic_poses(loops, start, 1, RANK_TOLERANCE)
    if not np.abs(loops.linearise(q)[0]).max(initial=0.0) < CLOSED:
        return
    mechanism = loops.tree.mechanism
    jacobian = loops.linearise(q)[1][..., 0]
    names = (*mechanism.drivers, *mechanism.locked)
    independent, redundant = _independent(loops, names, null_spaces(jacobian)[1])
    nearly_free = null_spaces(jacobian, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)[1]
    locked = [name for name in redundant if name in _independent(loops, names, nearly_free)[0]]
    if locked:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {', '.join(locked)} cannot move, for "
            f"{' and '.join(_nearly_dependent_joints(loops, q))} ask for the same but for less than "
            f"{DIMENSION_TOLERANCE:g} of the size, and lock each other; make one of them "
            "inactive, or its dimensions exact",
            "overdetermined",
        )
    if redundant and not independent:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: joints and couplings leave {', '.join(redundant)} no "
            "freedom; leave one of them out, or change a ratio or a dimension by which they disagree",
            "overdetermined",
        )
    if redundant:
        listed = ", ".join(independent) if len(independent) <= LISTED else f"{len(independent)} others"
        determine = f"{listed} settle{'s' if len(independent) == 1 else ''}"
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {determine} {', '.join(redundant)} already; drive or hold no "
            f"more joints than {len(independent)}, as in --drive {independent[0]}=LAW",
            "overdetermined",
        )


def _independent(loops: TreeLoops, names: Iterable[str], null_space: Array) -> tuple[list[str], list[str]]:
    """Return which coordinates of a null space, (dofs, count), are independent, and which depend on those.

    Each coordinate in turn is locked: it is independent if it still moves with those before it locked.
    """
    independent: list[str] = []
    dependent: list[str] = []
    for name in names:
        index = loops.tree.index_of[name]
        if len(null_space) and float(np.linalg.norm(null_space[:, index])) > MIN_DRIVER_PARTICIPATION:
            null_space = with_coordinate_locked(null_space, index)
            independent.append(name)
        else:
            dependent.append(name)
    return independent, dependent


def _nearly_dependent_joints(loops: TreeLoops, q: Coordinates) -> list[str]:
    """Return the names of the cut joints whose constraint equations are nearly dependent."""
    u, values, _ = np.linalg.svd(loops.linearise(q)[1][..., 0], full_matrices=False)
    share = np.abs(
        u[:, significant(values) & ~significant(values, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)]
    ).max(1, initial=0.0)
    loop_of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    largest = share[: len(loop_of)].max(initial=0.0)
    indices = loop_of[share[: len(loop_of)] > MIN_SHARE * largest].tolist()
    return [loops.cuts[i].joint.name for i in dict.fromkeys(indices)] or ["couplings"]


# displacement along a freedom, in radians or parts of the size; a residual that is closed; and the part of
# the displacement by which a joint or a point is seen to move
NULL_DISPLACEMENT, CLOSED, MIN_MOTION = 1e-3, 1e-10, 1e-2
# smallest participation of a coordinate in a null direction; and largest number of names in a message
MIN_PARTICIPATION, LISTED = 1e-6, 12


def require_determined(solver: TreeSolver) -> None:
    """Reject a mechanism with undetermined degrees of freedom; passive ones, as a rod's spin, do not count.

    Args:
        solver: of its loops, about a pose that is no special one.

    Raises:
        MobilityError: names one joint or point for each undetermined degree of freedom.
    """
    loops, names = solver.loops, undetermined_names(solver)
    floating_joints = {joint.name for joint in loops.tree.mechanism.joints if KINDS[joint.kind].floating}
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


def undetermined_names(solver: TreeSolver) -> list[str]:
    """Return what can move while the drivers stand, one name for each undetermined degree of freedom."""
    names: list[str] = []
    for name, _ in _undetermined(solver) if solver.nullity else ():
        if len(names) == LISTED:
            return [*names, "others"]
        names += [name] if name not in names else []
    return names


def joints_to_lock(solver: TreeSolver) -> tuple[str, ...]:
    """Return coordinates, balls and floating joints with which locked nothing is undetermined.

    Those outside loops come first; in a loop as many as it has undetermined degrees of freedom.
    """
    names = (name for _, name in _undetermined(solver, loops_last=True)) if solver.nullity else ()
    return tuple(dict.fromkeys(names))


def _undetermined(solver: TreeSolver, *, loops_last: bool = False) -> Iterator[tuple[str, str]]:
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
            label = joints[name].name if KINDS[joints[name].kind].floating else name
            yield label, label
            null_space = with_coordinate_locked(null_space, columns[name])
    # rotations of balls, which have no coordinate
    for ball in tree.balls:
        for rotation in range(ball.first_angle, ball.first_angle + 3):
            column = int(np.searchsorted(loops.unknown, rotation))
            displaced = _displaced_by(solver, null_space, column)
            if displaced:
                yield ball.joint.name if ball.kind.floating else displaced[0], ball.joint.name
                null_space = with_coordinate_locked(null_space, column)


def _displaced_by(solver: TreeSolver, null_space: Array, column: int) -> list[str]:
    """Return what moves along the null directions of a coordinate; empty for a passive one."""
    loops, components = solver.loops, null_space[:, column]
    length = float(np.linalg.norm(components))
    if length < MIN_PARTICIPATION:
        return []
    step = np.zeros((loops.tree.count, 1))
    step[loops.unknown, 0] = NULL_DISPLACEMENT * (components / length) @ null_space
    displaced_q = loops.displaced(solver.reference, step)
    try:
        result = newton(replace(solver, reference=displaced_q), displaced_q, NEARBY)
    except np.linalg.LinAlgError:
        return []
    # at a singular pose the loops draw it back
    if np.abs(result.linearised.residual).max(initial=0.0) >= CLOSED:
        return []
    return _displaced_names(loops, solver.reference, result.q)


def _displaced_names(loops: TreeLoops, before: Coordinates, after: Coordinates) -> list[str]:
    """Return the coordinates and tracked points that differ between two poses."""
    tree = loops.tree
    displacement = np.abs(after.values - before.values)[:, 0] / loops.units
    names = [
        name for name, index in tree.index_of.items() if displacement[index] > MIN_MOTION * NULL_DISPLACEMENT
    ]
    points_before, points_after = (_points(loops, link_poses(tree, point)) for point in (before, after))
    threshold = MIN_MOTION * NULL_DISPLACEMENT * tree.mechanism.characteristic_length
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


@dataclass(frozen=True, slots=True)
class Determinacy:
    """What the drivers of a mechanism determine.

    Attributes:
        dofs: degrees of freedom left by loops, couplings and locked joints, passive ones included.
        drivers: names of the driven coordinates.
        undetermined: coordinates or points that can move while the drivers stand, one for each
            undetermined degree of freedom.
        redundant_drivers: drivers and locked joints that others determine already.
        redundant_equations: dependent equations of joints and couplings.
    """

    dofs: int
    drivers: tuple[str, ...]
    undetermined: tuple[str, ...]
    redundant_drivers: tuple[str, ...]
    redundant_equations: int

    @property
    def outcome(self) -> str:
        """One of "determined", "underdetermined" and "overdetermined"."""
        return (
            "overdetermined"
            if self.redundant_drivers
            else "underdetermined"
            if self.undetermined
            else "determined"
        )


def driver_determinacy(mechanism: Mechanism) -> Determinacy:
    """Return what the drivers of a mechanism determine near its initial pose.

    Raises:
        AssemblyError: where the loops do not close.
    """
    solver, jacobian = _at_generic_pose(mechanism)
    dependent_rows, null_space = null_spaces(jacobian)
    names = (*mechanism.locked, *mechanism.drivers)
    redundant = _independent(solver.loops, names, null_space)[1]
    return Determinacy(
        dofs=len(null_space) - len([name for name in mechanism.locked if name not in redundant]),
        drivers=mechanism.drivers,
        undetermined=tuple(undetermined_names(solver)),
        redundant_drivers=tuple(redundant),
        redundant_equations=dependent_rows.shape[1],
    )


@dataclass(frozen=True, slots=True)
class DofCount:
    """Numbers by the rank of the loop Jacobian, at that of several poses where it is largest.

    Attributes:
        mobility: degrees of freedom that all joints leave.
        passive: degrees of freedom with the drivers locked, which move no tracked point by themselves.
        redundant: dependent equations.
        rank: of the loop equations in maximal coordinates without drivers.
    """

    mobility: int
    passive: int
    redundant: int
    rank: int


def dof_count(mechanism: Mechanism, poses: Mapping[str, Pose]) -> DofCount:
    """Return mobility, passive degrees of freedom and redundant equations at n poses that close the loops.

    At most `SAMPLED_POSES` or a few more are used, evenly spread: at a single one the rank may be lower.
    """
    step = max(1, len(next(iter(poses.values())).position) // SAMPLED_POSES)
    sample = {name: pose.select(slice(None, None, step)) for name, pose in poses.items()}
    loops, _ = tree_loops(mechanism, {name: pose.select(0) for name, pose in sample.items()}, {})
    jacobians = loops.linearise(loops.read(sample))[1].transpose(2, 0, 1)
    free_rank, locked_rank = (
        max(rank(jacobian) for jacobian in matrices)
        for matrices in (jacobians, jacobians[:, :, loops.unknown])
    )
    mobility = loops.tree.count - free_rank
    return DofCount(
        mobility,
        len(loops.unknown) - locked_rank,
        loops.rows - free_rank,
        6 * len(mechanism.links) - mobility,
    )


def undetermined_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Return what is to be locked so that the drivers determine the rest, as `joints_to_lock` chooses it.

    Raises:
        AssemblyError: where the loops do not close.
    """
    return joints_to_lock(_at_generic_pose(mechanism)[0])


def _at_generic_pose(mechanism: Mechanism) -> tuple[TreeSolver, Array]:
    """Return a solver about the pose near the start where the rank is highest, and the Jacobian there."""
    loops, guess = tree_loops(mechanism, rough_poses(mechanism), initial_coordinates(mechanism))
    try:
        start = closed(replace(loops, driven=()), guess)
    except AssemblyError:  # with the drivers at their start the loops may close, or the error says why not
        loops, start = assembled(mechanism)
    poses = [start, *generic_poses(loops, start, PROBES, RANK_TOLERANCE)]
    poses = [q for q in poses if np.abs(loops.linearise(q)[0]).max(initial=0.0) < CLOSED]
    best = max(poses, key=lambda q: rank(loops.linearise(q)[1][..., 0]))
    return loop_solver(loops, best), loops.linearise(best)[1][..., 0]


def checked_start(mechanism: Mechanism) -> TreeSolver:
    """Return what solves the loops of a mechanism about the coordinates in which it begins to move.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    try:
        loops, start = assembled(mechanism)
    except AssemblyError:
        # drivers that are too many seldom agree to the last digit
        require_no_redundant_drivers(
            loop_solver(*tree_loops(mechanism, rough_poses(mechanism), initial_coordinates(mechanism)))
        )
        raise
    solver = loop_solver(loops, start)
    require_no_redundant_drivers(solver)
    require_determined(solver)
    return solver
