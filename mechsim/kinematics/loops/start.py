"""Assembly in coordinates of the tree, from the guess or random starts, and messages for open loops."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.constraints import CutGroup, TreeLoops, axes_aligned, axis_cosines, tree_loops
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, link_poses
from mechsim.kinematics.vector_method.rotations import from_quaternion
from mechsim.mechanism.joint_kinds import FIXED, KINDS, antiparallel_message
from mechsim.mechanism.joints import End, Joint, joint_coordinate
from mechsim.mechanism.link_poses import guessed_poses, initial_coordinates
from mechsim.mechanism.links import GROUND, IDENTITY, VIRTUAL_PREFIX, Pose, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array, scattered
from mechsim.numerics.graphs import components
from mechsim.numerics.loop_solver import MIN_UNKNOWNS, LoopSystem
from mechsim.numerics.newton import NewtonResult, NewtonSettings, newton, square_solution
from mechsim.numerics.rank import RANK_TOLERANCE, SPARSE, least_norm, rank, right_vectors, significant

# largest residual of closed loops, in radians and characteristic lengths
CLOSED = 1e-12
# relative motion of a loop along its gap below which the gap is immobile; distance of another pose in [rad]
# and characteristic lengths; and smallest component of a gap that is reported
IMMOBILE, OTHER_POSE, MIN_COMPONENT = 1e-6, 0.3, 1e-3
# gap in [rad] or characteristic lengths below which rounded dimensions of redundant loops cause it
CONTRADICTION = 1e-4
# Newton's method from a guess: no step rotates a joint by more than 0.5 rad
ASSEMBLY = NewtonSettings(
    max_iterations=60, tolerance=4.0 * float(np.finfo(np.float64).eps), rounding=CLOSED, max_step=0.5
)


def close_nearest(
    loops: TreeLoops, q: Coordinates, settings: NewtonSettings = ASSEMBLY, tolerance: float = RANK_TOLERANCE
) -> tuple[Coordinates, Array]:
    """Return configurations in which the loops close nearest to n given ones, and their residuals, (n,).

    Prescribed coordinates do not change. Residuals are in radians and characteristic lengths. Singular values
    below a fraction of the largest, the tolerance, count as zero.
    """
    if len(loops.unknown) >= SPARSE and loops.rows:
        from mechsim.kinematics.loops.sparse_loops import SparseLoops

        many = newton(SparseLoops(loops, loops.unknown, tolerance), q, settings)
        return many.q, many.residual
    system = LoopSystem(loops, loops.unknown)
    result = newton(system, q, settings, lambda matrix, right: least_norm(matrix, right, tolerance))
    return result.q, result.residual


def assembly_failure(loops: TreeLoops, initial: Coordinates, final: Coordinates, remaining: float) -> str:
    """Return the message with the residual, and the driver positions at which the loops would close.

    Args:
        loops: loop equations of the mechanism.
        initial: coordinates from which Newton's method started.
        final: coordinates at which it ended.
        remaining: residual there, in characteristic lengths.
    """
    mechanism = loops.tree.mechanism
    drivers = f" at {_driver_text(mechanism, loops, final)}" if mechanism.drivers else ""
    text = (
        f"{mechanism.name}: the loops do not close{drivers}: after "
        f"{ASSEMBLY.max_iterations} Newton steps a gap of {remaining:.3g} of the longest link remains"
    )
    undriven = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    solution, violation = close_nearest(undriven, initial)
    across = _across(undriven, solution) if violation[0] >= CLOSED else ""
    if violation[0] >= CLOSED and not across and mechanism.drivers:
        others = all_closed(undriven, disturbed(undriven, initial))
        solution = min(others, key=lambda q: float(np.abs(q.values - initial.values).max()), default=solution)
        violation = np.abs(undriven.linearise(solution)[0]).max(0, initial=0.0)
    if violation[0] < CLOSED:
        near_by = f"from the guess they close at {_driver_text(mechanism, loops, solution)}"
        return f"{text}; {near_by}: start there, or change the dimensions"
    if across:
        return f"{text}, because {across}; move one of its points by that"
    # the joint or coupling with the largest residual
    contradictory = remaining < CONTRADICTION
    residual = loops.linearise(final if contradictory else solution)[0]
    worst = loops.row_names[int(np.abs(residual[:, 0]).argmax())]
    if contradictory:
        return (
            f"{text} in {worst}: redundant dimensions contradict one another; give them more digits, or take "
            "`mechsim sample` or `closed_qpos`, which accept such gaps"
        )
    return (
        f"{text}, and with free drivers Newton's method and {STARTS} damped starts leave {worst} open; "
        "change the dimensions, the start of the drivers, or the guess"
    )


def _driver_text(mechanism: Mechanism, loops: TreeLoops, q: Coordinates) -> str:
    values = {name: q.values[loops.tree.index_of[name], 0] for name in mechanism.drivers}
    return ", ".join(f"{name} = {value:.6g} {mechanism.unit(name)}" for name, value in values.items())


def _across(loops: TreeLoops, q: Coordinates) -> str:
    """Return the joint with the largest gap that its loop cannot change, and the gap; empty for none."""
    residual, jacobian, _ = loops.linearise(q)
    # not only at this pose, where a stretched linkage can move in one direction only
    displaced = loops.displaced(
        q, OTHER_POSE * (1.0 + 0.3 * np.arange(loops.tree.count))[:, None] / loops.tree.count
    )
    jacobians = np.concatenate([jacobian, loops.linearise(displaced)[1]], -1)
    poses, largest, text = link_poses(loops.tree, q), CLOSED, ""
    for cut, rows in loops.gap_rows:
        gap = residual[rows, 0]
        violation = float(np.linalg.norm(gap))
        change = np.abs(np.tensordot(gap, jacobians[rows], 1)).max(initial=0.0)
        if violation > largest and change < IMMOBILE * violation:
            frame = CutGroup((cut,), np.zeros((1, cut.rows), dtype=np.intp)).frames(poses)[1]
            displacement = frame[:, cut.lengths, 0, 0] @ gap * cut.length
            displacement[np.abs(displacement) < MIN_COMPONENT * np.abs(displacement).max()] = 0.0
            along = ", ".join(f"{component:.3g}" for component in displacement)
            text = f"{cut.joint.name} has a gap of ({along}) m that no joint in its loop can close"
            largest = violation
    return text


# damped Gauss-Newton steps from a random start, and minimum-norm Newton steps after them
APPROACH = NewtonSettings(max_iterations=80, max_step=0.7)
POLISH = NewtonSettings(max_iterations=4, max_step=0.7)
# residual below which loops are expected to close
NEARLY_CLOSED = 1e-6
# singular values below this fraction of the largest are zero in the minimum-norm steps
STEP_CUTOFF = 1e-7
# the same at branch points
BRANCH_CUTOFF = 1e-6
# range of random displacements of slides, in characteristic lengths to either side
SLIDE_RANGE = 2.0
# bytes of the Jacobians of random starts that are solved together, and products for each row in a band
CHUNK_BYTES, PRODUCTS = 4e6, 14
# product of the number of starts and the cube of the unknowns above which a band saves more than the import
# of scipy
BANDED_WORK = 3e6
# distance from a branch point at which its branches are searched, in [rad] or characteristic lengths, and
# number of directions
BRANCH_DISTANCE, DIRECTIONS = 0.05, 16


def random_poses(
    loops: TreeLoops, reference: Coordinates, count: int, seed: int
) -> Iterator[tuple[int, Coordinates]]:
    """Yield closed poses from random starts, without those that do not close or have antiparallel axes.

    Screws start as in the reference: a nut threaded on elsewhere gives no other assembly. Chunks of starts
    limit the memory; each comes with the number of starts so far.

    Args:
        loops: loop equations of the mechanism.
        reference: a set of coordinates about which slides are displaced at random.
        count: number of starts.
        seed: seed of the random numbers.
    """
    tree, draw = loops.tree, np.random.default_rng(seed)
    angles = draw.uniform(-np.pi, np.pi, (tree.count, count))
    displacements = reference.values + SLIDE_RANGE * loops.units[:, None] * draw.uniform(
        -1.0, 1.0, (tree.count, count)
    )
    values = np.where(tree.slides[:, None], displacements, angles)
    screws = [joint for joint in tree.mechanism.joints if KINDS[joint.kind].helical]
    threaded = [
        tree.index_of[name] for joint in screws for name in joint.coordinates if name in tree.index_of
    ]
    kept = [*loops.driven, *threaded]
    values[kept] = reference.values[kept]
    quaternions = draw.normal(size=(len(tree.balls), 4, count))
    # rotation matrices, (balls, 3, 3, n), of quaternions (balls, 4, n) of any length
    unit = quaternions / np.sqrt((quaternions**2).sum(1, keepdims=True))
    initial = Coordinates(values, from_quaternion(*unit.transpose(1, 0, 2)).transpose(2, 0, 1, 3))
    width = tree.count + 1 if len(loops.unknown) < MIN_UNKNOWNS else PRODUCTS
    chunk_size = max(1, int(CHUNK_BYTES / (8 * (loops.rows + tree.count + 1) * width)))
    for first in range(0, count, chunk_size):
        indices = np.arange(first, min(first + chunk_size, count))
        yield int(indices[-1]) + 1, all_closed(loops, initial.select(indices))


def poses_around_branch_point(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return closed poses around a branch point: some on each branch."""
    _, jacobian, _ = loops.linearise(q)
    values, right = right_vectors(jacobian[:, loops.unknown, 0])
    null_space = right[int(significant(values, BRANCH_CUTOFF).sum()) :]
    if not len(null_space):
        return q.select(np.zeros(len(q), dtype=np.bool_))
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, len(null_space))) @ null_space
    step = np.zeros((loops.tree.count, DIRECTIONS))
    step[loops.unknown] = (BRANCH_DISTANCE * directions / np.linalg.norm(directions, axis=1)[:, None]).T
    return all_closed(loops, loops.displaced(q.repeated(DIRECTIONS), step))


def all_closed(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return configurations closed from approximate ones, without those that do not close."""
    result = _approached(loops.one_sense, q)
    q = result.q.select(result.residual < NEARLY_CLOSED)
    if len(q):
        q, residual = close_nearest(loops, q, POLISH, STEP_CUTOFF)
        q = q.select(residual < CLOSED)
    return q.select(axes_aligned(loops, q))


def _approached(loops: TreeLoops, q: Coordinates) -> NewtonResult[Coordinates, Any]:
    """Return configurations after damped Gauss-Newton steps; those of many unknowns are solved in a band."""
    unknowns = len(loops.unknown)
    if len(q) and (unknowns >= MIN_UNKNOWNS or len(q) * unknowns**3 > BANDED_WORK):
        from mechsim.numerics.damped_band import DampedLoops

        if (normal := loops.normal_band) is not None:
            return newton(DampedLoops(loops, loops.unknown, normal, _damping), q, APPROACH)
    return newton(LoopSystem(loops, loops.unknown), q, APPROACH, _damped)


def _damped(jacobian: Array, residual: Array) -> Array:
    """Return damped Gauss-Newton steps, (n, count)."""
    transposed = jacobian.transpose(0, 2, 1)
    square = transposed @ jacobian
    added = _damping(residual, np.trace(square, axis1=1, axis2=2))
    square += added[:, None, None] * np.eye(square.shape[1])
    return square_solution(square, (transposed @ residual[..., None])[..., 0])


def _damping(residual: Array, trace: Array) -> Array:
    """Return the damping of matrices of a trace, (n,), which is proportional to the residual, (n, rows)."""
    # not lost in the rounding of the matrix
    least = np.maximum(1e-13, 4.0 * np.finfo(np.float64).eps * trace)
    return 0.1 * (residual**2).mean(1) + least


# distance from the stated values, in characteristic lengths and [rad], above which others are searched
MAX_DISTANCE = 0.5
# number of disturbed starts, and their smallest and largest disturbances in [rad] or characteristic lengths
STARTS, LEAST_DISTURBANCE, LARGEST_DISTURBANCE = 48, 0.05, float(np.pi)
# digits to which distances of assemblies are compared: mirrored ones differ by rounding
COMPARED_DIGITS = 6
# largest number of coordinates in a message
NAMED = 6


# what a failed search tried besides Newton's method
_TRIED = (
    f"{STARTS} damped starts with the unknown coordinates disturbed by up to "
    f"{np.rad2deg(LARGEST_DISTURBANCE):.0f} deg close nowhere"
)


@dataclass(frozen=True)
class _Assembly:
    """Closed coordinates of a mechanism.

    Attributes:
        loops: their loop equations.
        q: the coordinates, one set.
        stated: coordinate -> stated value.
        searched: whether Newton's method from the stated values found none.
    """

    loops: TreeLoops
    q: Coordinates
    stated: Mapping[str, float]
    searched: bool = False

    @cached_property
    def poses(self) -> LinkPoses:
        """Poses of the links."""
        return link_poses(self.loops.tree, self.q)

    @cached_property
    def distance(self) -> float:
        """Largest distance of links from their guess, and of coordinates from their stated values.

        It is in characteristic lengths and [rad].
        """
        if not self.loops.rows:
            return 0.0
        tree, worst = self.loops.tree, 0.0
        poses = self.poses
        for name, pose in tree.mechanism.guess.items():
            i = tree.links[name]
            distance = float(np.linalg.norm(poses.position[i, :, 0] - pose.position)) / tree.length
            trace = float(np.trace(pose.rotation.T @ poses.rotation[i, :, :, 0]))
            worst = max(worst, distance, float(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))))
        for name, value in self.stated.items():
            if (index := tree.index_of.get(name)) is not None:
                worst = max(worst, abs(float(self.q.values[index, 0]) - value) / float(tree.units[index]))
        return worst

    @cached_property
    def rank(self) -> int:
        """Rank of the equations by the unknown coordinates."""
        return rank(self.loops.linearise(self.q)[1][:, self.loops.unknown, 0], BRANCH_CUTOFF)

    @property
    def order(self) -> tuple[float | tuple[float, ...], ...]:
        """What the chosen assembly has least: distance, then largest coordinate; positive ones come first."""
        values = self.q.values[:, 0] / self.loops.units
        largest = float(np.abs(values).max(initial=0.0))
        return (
            round(self.distance, COMPARED_DIGITS),
            round(largest, COMPARED_DIGITS),
            tuple((-values).round(COMPARED_DIGITS).tolist()),
        )


def assembled(mechanism: Mechanism, needed: Iterable[str] = ()) -> tuple[TreeLoops, Coordinates]:
    """Return the loops of a mechanism and its assembly nearest to the stated values, as `_nearest`.

    `needed` are coordinates that the spanning tree must contain; their values are not stated.

    Raises:
        AssemblyError: if the loops do not close near these values; states the gap, or where they close.
    """
    counted = mechanism
    if unstated := dict.fromkeys(needed, 0.0):
        counted = replace(mechanism, guess_coordinates={**unstated, **mechanism.guess_coordinates})
    assembly = _nearest(counted, mechanism.guess_coordinates)
    if assembly.searched and assembly.distance > MAX_DISTANCE:
        raise AssemblyError(
            f"{mechanism.name}: {_distance_text(mechanism, assembly)}; start near these values"
        )
    return assembly.loops, assembly.q


def _nearest(mechanism: Mechanism, stated: Mapping[str, float]) -> _Assembly:
    """Return the assembly of a mechanism nearest to the stated values.

    The guess of links, some coordinates, the start and the locked values are stated. Drivers and locked
    coordinates keep them.
    Newton's method starts from these values, with unstated coordinates at 0. Where that fails, ends far away,
    or starts at a singular pose, damped steps (Levenberg-Marquardt) start there and at disturbed values.

    Raises:
        AssemblyError: if no start leads to closed loops; states the gap, and where they would close.
    """
    candidates: list[_Assembly] = []
    error: AssemblyError | None = None
    for poses in _initial_guesses(mechanism):
        loops, initial = tree_loops(mechanism, poses, initial_coordinates(mechanism, poses))
        try:
            q = closed(loops, initial)
            assembly = _Assembly(loops, _next_to_stated(loops, q, stated), stated)
            # the equations only require parallel axes and references
            for name, column, cosine in axis_cosines(loops, assembly.poses):
                if cosine[0] < 0.0:
                    raise AssemblyError(f"{loops.name}: {antiparallel_message(name, column)}")
        except AssemblyError as failure:
            error = error or failure
            continue
        if assembly.distance < MAX_DISTANCE and (q is initial or _regular(loops, initial)):
            return assembly
        candidates.append(assembly)
    poses = guessed_poses(mechanism)
    loops, initial = tree_loops(mechanism, poses, initial_coordinates(mechanism, poses))
    searched = _next_to_stated(loops, all_closed(loops, disturbed(loops, initial)), stated)
    failed = not candidates
    candidates += [_Assembly(loops, q, stated, searched=failed) for q in searched]
    if candidates:
        # from a singular assembly no motion is determined
        most = max(assembly.rank for assembly in candidates)
        nearest = min((each for each in candidates if each.rank == most), key=lambda assembly: assembly.order)
        return replace(nearest, q=closed(nearest.loops, nearest.q))
    assert error is not None
    raise AssemblyError(f"{error} ({_TRIED})")


def _next_to_stated(loops: TreeLoops, q: Coordinates, stated: Mapping[str, float]) -> Coordinates:
    """Return configurations with the angles of hinges within half a revolution of their stated values.

    Driven and coupled angles are unchanged.
    """
    tree, values = loops.tree, q.values.copy()
    coupled = {name for law in tree.mechanism.laws for name in law.coordinates}
    for name in ({*stated} & {*tree.index_of}) - coupled:
        joint, index = tree.mechanism.joint_with(name)[0], tree.index_of[name]
        if KINDS[joint.kind].hinge and index not in loops.driven:
            values[index] += REVOLUTION * np.round((stated[name] - values[index]) / REVOLUTION)
    return replace(q, values=values)


def disturbed(loops: TreeLoops, q: Coordinates, step: Array | None = None) -> Coordinates:
    """Return a configuration, and others with increasingly disturbed unknown coordinates.

    Disturbances are random, or those of steps (count, n). The arguments of functions, such as
    places along curves, are spread over their intervals.
    """
    if step is None:
        step = np.random.default_rng(1).uniform(-1.0, 1.0, (loops.tree.count, STARTS))
    n = step.shape[1]
    step = step * np.geomspace(LEAST_DISTURBANCE, LARGEST_DISTURBANCE, STARTS)[:n]
    step[list(loops.driven)] = 0.0
    step[:, 0] = 0.0
    starts = loops.displaced(q.repeated(n), step)
    values, indices = starts.values, loops.tree.index_of
    for law in loops.tree.mechanism.laws:
        if law.function is None or not isinstance(law.right, str) or not isinstance(law.left, str):
            continue
        if (argument := indices[law.right]) not in loops.driven:
            values[argument, 1:] = np.linspace(*law.function.interval, STARTS)[1:n]
        if (follower := indices[law.left]) not in loops.driven:
            values[follower, 1:] = law.zeros[0] + law.polynomial(values[argument, 1:])[0]
    return starts


def _regular(loops: TreeLoops, initial: Coordinates) -> bool:
    """Whether a start is closed, or its equations have the rank that they have at a disturbed one.

    From a singular start, such as links in line, rounding decides which assembly Newton's method finds.
    """
    if np.abs(loops.linearise(initial)[0]).max(initial=0.0) < NEARLY_CLOSED:
        return True
    q = disturbed(loops, initial, np.stack([scattered(loops.tree.count, k) for k in (0, 1)], 1))
    start, nearby = loops.linearise(q)[1][:, loops.unknown].transpose(2, 0, 1)
    return rank(start, BRANCH_CUTOFF) == rank(nearby, BRANCH_CUTOFF)


def _initial_guesses(mechanism: Mechanism) -> Iterator[Mapping[str, Pose]]:
    """Yield poses of all links: by joints in their order, about the guessed links, and with slides first."""
    yield guessed_poses(mechanism)
    if not len(mechanism.guess) < len(mechanism.links):
        return
    if mechanism.guess:
        yield {**_poses_about_guess(mechanism), **mechanism.guess}
    yield guessed_poses(mechanism, stiff_first=True)


def _poses_about_guess(mechanism: Mechanism) -> dict[str, Pose]:
    """Return poses of the links without a guess that close best while guessed links stand still.

    A chain of joints alone can place a leg anywhere, not towards the plate that it carries.
    """
    loops, initial = tree_loops(_with_guess_on_frame(mechanism))
    result = _approached(loops, disturbed(loops, initial))
    # the least disturbed start among those that close as well as any
    best = int(np.argmax(result.residual < NEARLY_CLOSED + result.residual.min()))
    poses = link_poses(loops.tree, result.q).by_link(loops.tree.links)
    return {name: pose.select(best) for name, pose in poses.items()}


def _with_guess_on_frame(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with the guessed links fixed to the frame, without the joints between them."""
    frame = {GROUND, *mechanism.guess}
    joints = [joint for joint in mechanism.joints if not frame.issuperset(joint.links)]
    kept = {name for joint in joints for name in joint.coordinates}
    for link, pose in mechanism.guess.items():
        x, _, z = map(vector, pose.rotation.T)
        on_frame = End(GROUND, vector(pose.position), z, x)
        joints.append(Joint(f"{VIRTUAL_PREFIX}guess of {link}", FIXED, on_frame, End(link)))
    return replace(
        mechanism,
        joints=tuple(joints),
        driver=tuple(name for name in mechanism.drivers if name in kept),
        gears=tuple(gear for gear in mechanism.gears if {gear.driver, gear.driven} <= kept),
        guess={},
        couplings=tuple(law for law in mechanism.couplings if kept.issuperset(law.coordinates)),
        locked={name: value for name, value in mechanism.locked.items() if name in kept},
        guess_coordinates={
            name: value for name, value in initial_coordinates(mechanism).items() if name in kept
        },
    )


def with_locked(mechanism: Mechanism, driven: Array, order: int = 0) -> Array:
    """Return all prescribed coordinates, (drivers + locked, n), from those of the drivers, (drivers, n).

    Of an order above 0 they are derivatives, which are 0 for locked coordinates.
    """
    if not mechanism.locked:
        return driven
    locked = np.array([*mechanism.locked.values()], dtype=np.float64) if order == 0 else 0.0
    return np.vstack([driven, np.broadcast_to(locked, (driven.shape[1], len(mechanism.locked))).T])


def closed(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return the coordinates in which the loops close nearest to given ones, at fixed prescribed coordinates.

    Raises:
        AssemblyError: if they do not close; states the gap, and where they would close.
    """
    solution, residual = close_nearest(loops, q)
    if residual[0] < CLOSED:
        return solution
    raise AssemblyError(assembly_failure(loops, q, solution, float(residual[0])))


# distance in characteristic lengths and matrix entries below which poses are equal
SAME_POSE = 1e-9


def with_closed_guess(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism of `closed_start`."""
    return closed_start(mechanism)[0]


def closed_start(mechanism: Mechanism) -> tuple[Mechanism, str]:
    """Return a mechanism whose guess is its assembly nearest to the stated values, and a note.

    Every method starts in this assembly. The guess includes revolutions of coupled joints, which a pose does
    not determine. The mechanism is the same if its guess is closed, or if its loops do not close. Drivers
    move only if the loops do not close at their stated values. The note is a sentence on distant stated
    values; empty if the assembly is near them.
    """
    stated = mechanism
    try:
        assembly = _nearest(stated, stated.guess_coordinates)
    except AssemblyError:
        try:
            # drivers may leave their values, of which those that no start and no guess states are 0
            values = initial_coordinates(mechanism)
            drivers = {name: values.get(name, 0.0) for name in mechanism.drivers}
            coordinates = {**mechanism.guess_coordinates, **drivers}
            stated = replace(mechanism, driver=(), guess_coordinates=coordinates)
            assembly = _nearest(stated, {name: values[name] for name in coordinates if name in values})
        except AssemblyError:
            return mechanism, ""
    poses, values = _poses_and_values(assembly.loops, assembly.q)
    # the coupled angles beyond half a revolution, which poses and prescribed values leave open
    counted = {*mechanism.guess_coordinates, *mechanism.drivers, *mechanism.locked}
    uncounted = (name for law in mechanism.laws if not law.turns for name in law.coordinates)
    coupled = [name for name in uncounted if name not in counted and mechanism.unit(name) == "rad"]
    revolutions = {name: values[name] for name in coupled if abs(values[name]) > np.pi}
    if assembly.distance > MAX_DISTANCE or stated is not mechanism:
        coordinates = revolutions | {name: values[name] for name in stated.guess_coordinates}
        start = values[mechanism.drivers[0]] if mechanism.has_crank else mechanism.start
        started = replace(mechanism, guess=poses, start=start, guess_coordinates=coordinates)
        if assembly.distance > MAX_DISTANCE or initial_coordinates(mechanism).keys() & {*mechanism.drivers}:
            return started, f"{_distance_text(stated, assembly)}; it starts there"
        drivers = _driver_text(mechanism, assembly.loops, assembly.q)
        return started, f"no start of the drivers is stated; the loops close at {drivers}; it starts there"
    coordinates = {**mechanism.guess_coordinates, **revolutions}
    if coordinates == mechanism.guess_coordinates and _is_closed_guess(mechanism, poses):
        return mechanism, ""
    return replace(mechanism, guess=poses, guess_coordinates=coordinates), ""


def with_requested_start(mechanism: Mechanism, requested: Mapping[str, float]) -> Mechanism:
    """Return a mechanism in the assembly nearest to requested coordinates; other drivers keep stated values.

    Loops without a requested coordinate keep the assembly that they have without a request, and where only
    drivers are requested, joints between links with a guess are near it.

    Raises:
        AssemblyError: if the loops do not close.
    """
    initial = initial_coordinates(mechanism)
    stated = {name: initial[name] for name in mechanism.drivers if name in initial} | dict(requested)
    # a driver without a stated value leaves the requested coordinates at theirs
    driver = mechanism.driver if stated.keys() >= {*mechanism.drivers} else tuple(stated)
    described = replace(mechanism, driver=driver)
    start = stated[described.drivers[0]] if described.has_crank else 0.0
    # joints without coordinates, such as of floating bases, keep the guess of their links
    loose = {joint.b.link for joint in mechanism.joints if not joint.coordinates}
    guess = {link: pose for link, pose in mechanism.guess.items() if link in loose}
    values = {**_unmoved_values(mechanism, requested), **stated}
    started = with_closed_guess(replace(described, guess=guess, guess_coordinates=values, start=start))
    poses, values = start_poses(started)
    coordinates = {name: values[name] for name in (*mechanism.guess_coordinates, *mechanism.drivers, *stated)}
    start = started.start if mechanism.has_crank else 0.0
    return replace(started, driver=mechanism.driver, guess=poses, guess_coordinates=coordinates, start=start)


def _unmoved_values(mechanism: Mechanism, requested: Collection[str]) -> dict[str, float]:
    """Return the coordinates, in [m] or [rad], that a request leaves as they are, as nearly as loops let."""
    try:
        loops, q = assembled(mechanism, requested)
    except AssemblyError:
        poses = guessed_poses(mechanism)
        initial = {**dict.fromkeys(requested, 0.0), **initial_coordinates(mechanism, poses)}
        loops, q = tree_loops(mechanism, poses, initial)
    index_of = loops.tree.index_of
    rows = [np.flatnonzero(row).tolist() for row in loops.linearise(q)[1][:, :, 0]]
    moved = {index_of.get(name) for name in requested}
    for joined in components(range(loops.tree.count), [pair for row in rows for pair in pairwise(row)]):
        moved |= joined if joined & moved else set()
    guessed = {GROUND, *mechanism.guess} if {*requested} <= {*mechanism.drivers} else set[str]()
    between = (joint.coordinates for joint in mechanism.joints if guessed.issuperset(joint.links))
    unmoved = {name for name, i in index_of.items() if i not in moved}.union(*between)
    return {name: value for name, value in _poses_and_values(loops, q)[1].items() if name in unmoved}


def _is_closed_guess(mechanism: Mechanism, poses: Mapping[str, Pose]) -> bool:
    """Whether the guess of all links is an assembly already."""
    return mechanism.guess.keys() == poses.keys() and all(
        np.abs(pose.position - poses[name].position).max() < SAME_POSE * mechanism.characteristic_length
        and np.abs(pose.rotation - poses[name].rotation).max() < SAME_POSE
        for name, pose in mechanism.guess.items()
    )


def _distance_text(stated: Mechanism, assembly: _Assembly) -> str:
    """Return where the loops close, far from the stated values."""
    initial, (_, values) = initial_coordinates(stated), _poses_and_values(assembly.loops, assembly.q)
    change = {name: abs(value - initial.get(name, 0.0)) for name, value in values.items()}
    stated_names = initial if stated.drivers else stated.guess_coordinates
    first = [name for name in stated_names if not stated.drivers or name in stated.drivers]
    ordered = dict.fromkeys([*first, *sorted(change, key=lambda name: -change[name])])
    written = {name for joint in stated.written_joints for name in joint.coordinates}
    names = [name for name in ordered if name in written or name in first][:NAMED]
    # zeros have the rounding of the solution
    zero = SAME_POSE * min(1.0, stated.characteristic_length)
    rounded = {name: 0.0 if abs(values[name]) < zero else values[name] for name in names}
    listed = ", ".join(f"{name} = {value:.4g} {stated.unit(name)}" for name, value in rounded.items())
    return (
        f"the loops do not close at the stated values; the nearest assembly found is {assembly.distance:.3g} "
        f"away, in rad or lengths of the longest link, at {listed}"
    )


def start_poses(mechanism: Mechanism) -> tuple[dict[str, Pose], dict[str, float]]:
    """Return the poses of the moving links, closed nearest to the guess, and all coordinates there.

    Returns:
        Link -> pose; coordinate -> value in [m] or [rad], with revolutions if the mechanism has them.

    Raises:
        AssemblyError: where the loops do not close.
    """
    return _poses_and_values(*assembled(mechanism))


def _poses_and_values(loops: TreeLoops, q: Coordinates) -> tuple[dict[str, Pose], dict[str, float]]:
    """Return the poses of the moving links, and the values of all coordinates in [m] or [rad]."""
    tree = loops.tree
    poses = {name: pose.select(0) for name, pose in link_poses(tree, q).by_link(tree.links).items()}
    everywhere = {GROUND: IDENTITY, **poses}
    values: dict[str, float] = {}
    for joint in tree.original.joints:
        read = np.atleast_1d(joint_coordinate(joint, everywhere[joint.a.link], everywhere[joint.b.link]))
        for name, value in zip(joint.coordinates, read.tolist(), strict=False):
            index = tree.index_of.get(name)
            values[name] = value if index is None else float(q.values[index, 0])
    return poses, values
