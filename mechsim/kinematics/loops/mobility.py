"""Undetermined joints and redundant drivers, by the rank of the loop Jacobian at generic poses."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mechsim.errors import STEPPED, AssemblyError, MobilityError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver, tree_loops
from mechsim.kinematics.loops.kinematics import Coordinates, link_poses
from mechsim.kinematics.loops.start import all_closed, assembled, close_nearest, closed, disturbed
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import EPS, Array, scattered
from mechsim.numerics.loop_solver import NEARBY, LoopSystem, loop_solver
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, least_norm, null_space, rank, significant

# accuracy of dimensions relative to the size, and of axes in [rad]: files with six digits have errors of
# 1e-6, and no rigid linkage moves by so little. Equations below it (of a spherical joint at the common point
# of all axes of its loop) consist of rounding only
DIMENSION_TOLERANCE = 1e-5
# displacement from a pose to the next, in [rad] or characteristic lengths
SPACING = 0.15
# number of poses at which ranks are evaluated: at a single pose the rank can be lower
SAMPLED_POSES = 5
# number of generic poses at which the rank is compared with that at the start
PROBES = 2
# Gauss-Newton steps to a generic pose: inconsistent equations keep a residual, but steps vanish
CONSISTENT = NewtonSettings(40, 4.0 * EPS, rounding=0.0, last_step=1e-12, max_step=0.3)


def generic_poses(
    loops: TreeLoops, start: Coordinates, count: int, tolerance: float, floor: float = FLOOR
) -> list[Coordinates]:
    """Return successive poses near a start, with drivers and locked coordinates free.

    Args:
        loops: the loop equations.
        start: a set of coordinates, closed or nearly so.
        count: number of poses.
        tolerance: singular values below this fraction of the largest are zero.
        floor: singular values below it are zero.

    Raises:
        AssemblyError: if a coupling has no value at the start.
    """
    with np.errstate(all="ignore"):
        residual, jacobian, _ = loops.linearise(start)
    if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
        raise AssemblyError(
            f"{loops.tree.mechanism.name}: the function of a coupling has no finite value or derivative at "
            "the start of its driver; start where it has one"
        )
    loops = replace(loops, driven=())
    q = nearest_consistent(loops, start, tolerance, floor)
    jacobian = loops.linearise(q)[1]
    poses: list[Coordinates] = []
    for k in range(count):
        basis = null_space(jacobian[..., 0], tolerance, floor)
        step = basis.T @ scattered(len(basis), k + 1)
        longest = float(np.abs(step).max(initial=0.0))
        # from the end of a table only one direction leads to poses
        for sign in (1.0, -1.0) if longest > 0.0 else ():
            displaced = loops.displaced(q, (sign * step * SPACING / longest)[:, None])
            with np.errstate(all="ignore"):
                nearby = nearest_consistent(loops, displaced, tolerance, floor)
                residual, moved, _ = loops.linearise(nearby)
                if np.isfinite(residual).all():
                    q, jacobian = nearby, moved
                    break
        poses.append(q)
    return poses


def nearest_consistent(
    loops: TreeLoops, q: Coordinates, tolerance: float, floor: float = FLOOR
) -> Coordinates:
    """Return the nearest configuration with the least residual of the independent equations.

    Prescribed coordinates do not change.
    """
    if (tolerance, floor) == (RANK_TOLERANCE, FLOOR):
        return close_nearest(loops, q, CONSISTENT)[0]
    system = LoopSystem(loops, loops.unknown)
    return newton(system, q, CONSISTENT, lambda matrix, right: least_norm(matrix, right, tolerance, floor)).q


def with_component_locked(null_space: Array, component: Array) -> Array:
    """Return the null space, (dofs, count), without the motion of a component, (dofs,): one dimension less.

    The component of each null direction is that of a coordinate, or of a rotation about some axis.
    """
    rows = np.flatnonzero(component)
    # a reflection moves the component into the first vector
    mirror = component[rows]
    mirror[0] += np.copysign(np.linalg.norm(mirror), mirror[0])
    reflected = np.outer(2.0 / (mirror @ mirror) * mirror[1:], mirror @ null_space[rows])
    remaining = np.delete(null_space, rows[0], 0)
    remaining[rows[1:] - 1] -= reflected
    return remaining


# smallest participation of a driver in a degree of freedom
MIN_DRIVER_PARTICIPATION = 1e-7
# smallest fraction of a dependent combination of equations for which a loop is named
MIN_SHARE = 0.1


def require_no_redundant_drivers(solver: TreeSolver) -> None:
    """Raise MobilityError for drivers and locked coordinates that others determine already.

    Args:
        solver: solver about coordinates closed or nearly so; loops that cannot close raise errors elsewhere.

    Raises:
        MobilityError: names the coordinates.
    """
    loops, start = solver.loops, solver.reference
    if rank(solver.at_reference.jacobian[..., 0]) == len(solver.rows):
        return
    # at a dead centre a single crank cannot move either: use another pose
    (q,) = generic_poses(loops, start, 1, RANK_TOLERANCE)
    if _redundant(loops, q):
        q = _least_redundant(loops, q, start)
    residual, jacobian, _ = loops.linearise(q)
    if not np.abs(residual).max(initial=0.0) < CLOSED:
        return
    mechanism = loops.tree.mechanism
    names = (*mechanism.drivers, *mechanism.locked)
    independent, redundant = independent_coordinates(loops, names, null_space(jacobian[..., 0]))
    nearly_free = null_space(jacobian[..., 0], DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)
    locked = [name for name in redundant if name in independent_coordinates(loops, names, nearly_free)[0]]
    if locked:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {', '.join(locked)} cannot move, for "
            f"{' and '.join(_nearly_dependent_joints(loops, q))} have nearly dependent constraints, with a "
            f"difference below {DIMENSION_TOLERANCE:g} of the size, and lock each other; make one of them "
            "inactive, or its dimensions exact",
            "overdetermined",
        )
    if redundant and not independent:
        raise MobilityError(
            f"{mechanism.name}: overdetermined: joints and couplings leave {', '.join(redundant)} no degree "
            "of freedom; leave one of them out, or change a ratio or a dimension that contradicts another",
            "overdetermined",
        )
    if redundant:
        listed = ", ".join(independent) if len(independent) <= LISTED else f"{len(independent)} others"
        determine = f"{listed} determine{'s' if len(independent) == 1 else ''}"
        raise MobilityError(
            f"{mechanism.name}: overdetermined: {determine} {', '.join(redundant)} already; drive or lock at "
            f"most {len(independent)} joint{'s' if len(independent) > 1 else ''}, as in "
            f"--drive {independent[0]}=LAW",
            "overdetermined",
        )


def _redundant(loops: TreeLoops, q: Coordinates) -> list[str]:
    """Return the drivers and locked coordinates that others determine already at a configuration."""
    mechanism, motions = loops.tree.mechanism, null_space(loops.linearise(q)[1][..., 0])
    return independent_coordinates(loops, (*mechanism.locked, *mechanism.drivers), motions)[1]


def _least_redundant(loops: TreeLoops, q: Coordinates, start: Coordinates) -> Coordinates:
    """Return a configuration at which as few drivers as possible are redundant; `q` if none is better.

    At a folded start a driver can stand still although it moves the mechanism elsewhere. It is not redundant
    if the loops close with it and the independent drivers at other values.
    """
    names, redundant = (*loops.tree.mechanism.locked, *loops.tree.mechanism.drivers), _redundant(loops, q)
    starts = disturbed(replace(loops, driven=()), start)
    for name in redundant:
        independent = [each for each in names if each not in redundant]
        driven = tuple(loops.tree.index_of[each] for each in (*independent, name))
        moved = all_closed(replace(loops, driven=driven), starts.select(np.arange(1, len(starts))))
        if len(moved) and len(_redundant(loops, best := next(iter(moved)))) < len(redundant):
            return _least_redundant(loops, best, start)
    return q


def independent_coordinates(
    loops: TreeLoops, names: Iterable[str], null_space: Array
) -> tuple[list[str], list[str]]:
    """Return which coordinates of a null space, (dofs, count), are independent, and which depend on them.

    A coordinate is independent if it can still move with all independent ones before it locked.
    """
    independent: list[str] = []
    dependent: list[str] = []
    for name in names:
        index = loops.tree.index_of[name]
        if len(null_space) and float(np.linalg.norm(null_space[:, index])) > MIN_DRIVER_PARTICIPATION:
            null_space = with_component_locked(null_space, null_space[:, index])
            independent.append(name)
        else:
            dependent.append(name)
    return independent, dependent


def _nearly_dependent_joints(loops: TreeLoops, q: Coordinates) -> list[str]:
    """Return the names of the cut joints with nearly dependent constraint equations."""
    u, values, _ = np.linalg.svd(loops.linearise(q)[1][..., 0], full_matrices=False)
    nearly_zero = significant(values) & ~significant(values, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)
    share = np.abs(u[: loops.rows - len(loops.couplings), nearly_zero]).max(1, initial=0.0)
    rows = np.flatnonzero(share > MIN_SHARE * share.max(initial=0.0))
    return [*dict.fromkeys(loops.row_names[i] for i in rows)] or ["couplings"]


# displacements along a degree of freedom, in [rad] or characteristic lengths: a point at the top or bottom of
# its path moves by a fraction of their square only, as of a bar on two ropes that turns; residual of closed
# loops; and fraction of the displacement above which a joint or a point counts as moved
NULL_DISPLACEMENTS, CLOSED, MIN_MOTION = (1e-3, 0.1, 0.5), 1e-10, 1e-2
# smallest participation of a coordinate in a null direction; and largest number of names in a message, and of
# coordinates that are examined together
MIN_PARTICIPATION, LISTED, TOGETHER = 1e-6, 12, 16


def require_determined(solver: TreeSolver) -> None:
    """Raise MobilityError for a mechanism with undetermined degrees of freedom, passive ones excepted.

    Args:
        solver: solver of its loops about a generic pose.

    Raises:
        MobilityError: names one joint or point for each undetermined degree of freedom.
    """
    loops, names = solver.loops, undetermined_names(solver)
    floating_joints = {joint.name for joint in loops.tree.mechanism.joints if KINDS[joint.kind].floating}
    if names:
        listed = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
        base = ", fix the base (--fix-base)" if floating_joints & {*names} else ""
        raise MobilityError(
            f"{loops.tree.mechanism.name}: underdetermined: with the drivers locked, {listed} can still "
            f"move; drive, lock or couple {'them' if len(names) > 1 else 'it'}{base}, lock "
            f"all undetermined joints (--lock others), or {STEPPED}",
            "underdetermined",
        )


def undetermined_names(solver: TreeSolver) -> list[str]:
    """Return what can move at fixed driver positions, one name for each undetermined degree of freedom."""
    names: list[str] = []
    for name, _, _ in undetermined_motions(solver) if solver.nullity else ():
        if len(names) == LISTED:
            return [*names, "others"]
        names += [name] if name not in names else []
    return names


def undetermined_motions(
    solver: TreeSolver, *, loops_last: bool = False
) -> Iterator[tuple[str, str, Array | None]]:
    """Yield one name for each undetermined degree of freedom, with all names before it locked.

    Each has what locks it: its coordinate, or the ball or floating joint, whose rotation about an axis in the
    frame of side a, (3,), is undetermined.
    """
    loops, null_space = solver.loops, solver.null_space
    tree = loops.tree
    columns = {name: int(np.searchsorted(loops.unknown, index)) for name, index in tree.index_of.items()}
    free = [name for name, index in tree.index_of.items() if index in loops.unknown]
    joints = {name: joint for joint in tree.mechanism.joints for name in joint.coordinates}
    if loops_last:
        # a coordinate that is in no loop is a null direction itself
        free.sort(
            key=lambda name: float(np.linalg.norm(null_space[:, columns[name]])) < 1.0 - MIN_PARTICIPATION
        )
    named: set[str] = set()
    first, together = 0, 1
    while names := free[first : first + together]:
        displaced = _displaced_by(solver, null_space, null_space[:, [columns[name] for name in names]].T)
        moving = next((i for i, name in enumerate(names) if name in displaced[i]), None)
        if moving is None:
            first, together = first + len(names), min(2 * together, TOGETHER)
            continue
        name, first, together = names[moving], first + moving + 1, 1
        label = joints[name].name if KINDS[joints[name].kind].floating else name
        named.add(name)
        yield label, label, None
        null_space = with_component_locked(null_space, null_space[:, columns[name]])
    # rotations of balls, which have no coordinate, about the axes of their largest rotations
    for ball in tree.balls:
        first = int(np.searchsorted(loops.unknown, ball.first_angle))
        for axis in np.linalg.svd(null_space[:, first : first + 3])[2]:
            component = null_space[:, first : first + 3] @ axis
            (displaced,) = _displaced_by(solver, null_space, component[None])
            if displaced:
                moved = next((name for name in displaced if name not in named), displaced[0])
                yield ball.joint.name if ball.kind.floating else moved, ball.joint.name, axis
                null_space = with_component_locked(null_space, component)


def _displaced_by(solver: TreeSolver, null_space: Array, components: Array) -> list[list[str]]:
    """Return what moves along the null directions with each component, (k, dofs); empty for a passive one."""
    lengths = np.linalg.norm(components, axis=1)
    moved: list[list[str]] = [[] for _ in components]
    for displacement in NULL_DISPLACEMENTS:
        left = [i for i, names in enumerate(moved) if not names and lengths[i] >= MIN_PARTICIPATION]
        directions = (components[left] / lengths[left, None]) @ null_space
        for i, names in zip(left, _moved_by(solver, directions, displacement), strict=True):
            moved[i] = names
    return moved


def _moved_by(solver: TreeSolver, directions: Array, displacement: float) -> Iterator[list[str]]:
    """Yield what moves in a displacement along each null direction, (k, unknowns); empty if nothing can."""
    loops, reference = solver.loops, solver.reference
    if not len(directions):
        return
    displaced_q = solver.retract(reference.repeated(len(directions)), displacement * directions)
    try:
        result = newton(replace(solver, reference=displaced_q), displaced_q, NEARBY)
    except np.linalg.LinAlgError:  # of one direction or more
        for half in np.array_split(directions, 2) if len(directions) > 1 else ():
            yield from _moved_by(solver, half, displacement)
        yield from [[]] * (len(directions) == 1)
        return
    # at a singular pose the loops do not allow the displacement
    closed = np.abs(result.linearised.residual).max(0, initial=0.0) < CLOSED
    for after, closes in zip(result.q, closed, strict=True):
        yield _displaced_names(loops, reference, after, MIN_MOTION * displacement) if closes else []


def _displaced_names(loops: TreeLoops, before: Coordinates, after: Coordinates, least: float) -> list[str]:
    """Return the coordinates and tracked points that differ between two poses by more than a least motion."""
    tree = loops.tree
    displacement = np.abs(after.values - before.values)[:, 0] / loops.units
    names = [name for name, index in tree.index_of.items() if displacement[index] > least]
    poses, moved = (link_poses(tree, coordinates) for coordinates in (before, after))
    for name, (link, local) in tree.mechanism.points.items():
        if link != GROUND:
            i, point = tree.links[link], np.array(local)
            step = moved.position[i] - poses.position[i]
            step = step[:, 0] + (moved.rotation[i] - poses.rotation[i])[..., 0] @ point
            names += [f"point {name}"] * bool(
                np.abs(step).max() > least * tree.mechanism.characteristic_length
            )
    return names


@dataclass(frozen=True, slots=True)
class Determinacy:
    """The degrees of freedom that the drivers of a mechanism determine.

    Attributes:
        dofs: degrees of freedom left by loops, couplings and locked joints, passive ones included.
        drivers: names of the driven coordinates.
        undetermined: coordinates or points that can move at fixed driver positions, one for each undetermined
            degree of freedom.
        redundant_drivers: drivers and locked joints that others determine already.
        redundant_equations: dependent equations of joints and couplings.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        "dofs",
        "drivers",
        "open=undetermined",
        "redundant_drivers",
        "redundant=redundant_equations",
    )

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
    solver, jacobian = solver_at_generic_pose(mechanism)
    motions, names = null_space(jacobian), (*mechanism.locked, *mechanism.drivers)
    redundant = independent_coordinates(solver.loops, names, motions)[1]
    return Determinacy(
        dofs=len(motions) - len([name for name in mechanism.locked if name not in redundant]),
        drivers=mechanism.drivers,
        undetermined=tuple(undetermined_names(solver)),
        redundant_drivers=tuple(redundant),
        redundant_equations=len(jacobian) - jacobian.shape[1] + len(motions),
    )


@dataclass(frozen=True, slots=True)
class DofCount:
    """Counts by the rank of the loop Jacobian, at the pose with the largest rank of several.

    Attributes:
        mobility: degrees of freedom of all joints.
        passive: degrees of freedom with the drivers locked that move no tracked point.
        redundant: number of dependent equations.
        rank: rank of the loop equations in maximal coordinates without drivers.
    """

    mobility: int
    passive: int
    redundant: int
    rank: int


def dof_count(mechanism: Mechanism, poses: Mapping[str, Pose]) -> DofCount:
    """Return mobility, passive degrees of freedom and redundant equations at n poses that close the loops.

    About `SAMPLED_POSES` evenly spread poses are used: at a single pose the rank can be lower.
    """
    step = max(1, len(next(iter(poses.values())).position) // SAMPLED_POSES)
    sample = {name: pose.select(slice(None, None, step)) for name, pose in poses.items()}
    loops, q = tree_loops(mechanism, sample, {})
    jacobians = loops.linearise(q)[1].transpose(2, 0, 1)
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


def solver_at_generic_pose(mechanism: Mechanism) -> tuple[TreeSolver, Array]:
    """Return a solver about the pose near the start with the highest rank, and the Jacobian there."""
    loops, guess = tree_loops(mechanism)
    try:
        start = closed(replace(loops, driven=()), guess)
    except AssemblyError:  # at the drivers' start the loops may close; otherwise the error gives the reason
        loops, start = assembled(mechanism)
    poses = [start, *generic_poses(loops, start, PROBES, RANK_TOLERANCE)]
    poses = [q for q in poses if np.abs(loops.linearise(q)[0]).max(initial=0.0) < CLOSED]
    best = max(poses, key=lambda q: rank(loops.linearise(q)[1][..., 0]))
    if _redundant(loops, best):
        best = _least_redundant(loops, best, start)
    return loop_solver(loops, best), loops.linearise(best)[1][..., 0]


def checked_start(mechanism: Mechanism) -> TreeSolver:
    """Return the solver about the configuration in which a mechanism starts to move.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: if the drivers leave joints or tracked points undetermined, or are redundant.
    """
    try:
        loops, start = assembled(mechanism)
    except AssemblyError:
        # redundant drivers seldom agree to the last digit
        require_no_redundant_drivers(loop_solver(*tree_loops(mechanism)))
        raise
    solver = loop_solver(loops, start)
    require_no_redundant_drivers(solver)
    require_determined(solver)
    return solver
