"""Assembly in coordinates of the tree, from the guess or random starts, and messages for open loops."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.constraints import LoopSystem, TreeLoops, axes_aligned, axis_cosines, tree_loops
from mechsim.analytic.loops.kinematics import Coordinates, LinkPoses, link_poses
from mechsim.analytic.loops.oracle import completed_poses
from mechsim.analytic.vector_method.rotations import from_quaternion
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import antiparallel_message
from mechsim.model.joints import joint_coordinate
from mechsim.model.link_poses import guessed_poses, initial_coordinates
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton, square_solution
from mechsim.numerics.rank import least_norm, significant

# largest residual of closed loops, in radians and characteristic lengths
CLOSED = 1e-12
# relative motion of a loop along its gap below which the gap is immobile; distance of another pose in [rad]
# and characteristic lengths; and smallest component of a gap that is reported
IMMOBILE, OTHER_POSE, MIN_COMPONENT = 1e-6, 0.3, 1e-3
# Newton's method from a guess: no step rotates a joint by more than 0.5 rad
ASSEMBLY = NewtonSettings(
    max_iterations=60, tolerance=4.0 * float(np.finfo(np.float64).eps), rounding=CLOSED, max_step=0.5
)


def close_nearest(loops: TreeLoops, q: Coordinates) -> tuple[Coordinates, Array]:
    """Return configurations in which the loops close nearest to n given ones, and their residuals, (n,).

    Prescribed coordinates do not change. Residuals are in radians and characteristic lengths.
    """
    result = newton(LoopSystem(loops, loops.unknown), q, ASSEMBLY, least_norm)
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
    text = (
        f"{mechanism.name}: the loops do not close at {_driver_text(loops, final)}: after "
        f"{ASSEMBLY.max_iterations} Newton steps a gap of {remaining:.3g} of the longest link remains"
    )
    undriven = replace(loops, driven=loops.driven[len(mechanism.drivers) :])
    solution, violation = close_nearest(undriven, initial)
    if violation[0] < CLOSED:
        near_by = f"from the guess they close at {_driver_text(loops, solution)}"
        return f"{text}; {near_by}: start there, or change the dimensions"
    if across := _across(undriven, solution):
        return f"{text}, because {across}; move one of its points by that"
    return (
        f"{text}, and from the guess {_widest(undriven, solution)} remains open at any driver "
        "positions; change the dimensions, the start of the drivers, or the guess"
    )


def _driver_text(loops: TreeLoops, q: Coordinates) -> str:
    tree = loops.tree
    indices = {name: tree.index_of[name] for name in tree.mechanism.drivers}
    return ", ".join(
        f"{name} = {q.values[index, 0]:.6g} {'m' if tree.slides[index] else 'rad'}"
        for name, index in indices.items()
    )


def _across(loops: TreeLoops, q: Coordinates) -> str:
    """Return the joint with the largest gap that its loop cannot change, and the gap; empty for none."""
    residual, jacobian, _ = loops.linearise(q)
    # not only at this pose, where a stretched linkage can move in one direction only
    displaced = loops.displaced(
        q, OTHER_POSE * (1.0 + 0.3 * np.arange(loops.tree.count))[:, None] / loops.tree.count
    )
    jacobians = np.concatenate([jacobian, loops.linearise(displaced)[1]], -1)
    poses, first, largest, text = link_poses(loops.tree, q), 0, CLOSED, ""
    for cut in loops.cuts:
        rows = slice(first, first + len(cut.lengths))
        first += cut.rows
        gap = residual[rows, 0]
        violation = float(np.linalg.norm(gap))
        if (
            violation > largest
            and np.abs(np.tensordot(gap, jacobians[rows], 1)).max(initial=0.0) < IMMOBILE * violation
        ):
            displacement = cut.frames(poses)[1][:, cut.lengths, 0] @ gap * cut.length
            along = ", ".join(
                f"{component:.3g}"
                for component in np.where(
                    np.abs(displacement) < MIN_COMPONENT * np.abs(displacement).max(), 0.0, displacement
                )
            )
            largest, text = (
                violation,
                f"{cut.joint.name} has a gap of ({along}) m that no joint in its loop can close",
            )
    return text


def _widest(loops: TreeLoops, q: Coordinates) -> str:
    """Return the joint or coupling with the largest residual."""
    residual = np.abs(loops.linearise(q)[0][:, 0])
    names = [cut.joint.name for cut in loops.cuts for _ in range(cut.rows)]
    names += [row.coupling.name for row in loops.couplings]
    return names[int(residual.argmax())]


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
# bytes of the Jacobians of random starts that are solved together
CHUNK_BYTES = 4e6
# distance from a branch point at which its branches are searched, in [rad] or characteristic lengths, and
# number of directions
BRANCH_DISTANCE, DIRECTIONS = 0.05, 16


def random_poses(
    loops: TreeLoops, reference: Coordinates, count: int, seed: int
) -> Iterator[tuple[int, Coordinates]]:
    """Yield closed poses from random starts, without those that do not close or have antiparallel axes.

    Chunks of starts limit the memory; each comes with the number of starts so far.

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
    values[list(loops.driven)] = reference.values[list(loops.driven)]
    quaternions = draw.normal(size=(len(tree.balls), 4, count))
    initial = Coordinates(values, _rotations(quaternions))
    chunk_size = max(1, int(CHUNK_BYTES / (8 * (loops.rows + tree.count + 1) * (tree.count + 1))))
    for first in range(0, count, chunk_size):
        indices = np.arange(first, min(first + chunk_size, count))
        yield int(indices[-1]) + 1, all_closed(loops, initial.select(indices))


def poses_around_branch_point(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return closed poses around a branch point: some on each branch."""
    _, jacobian, _ = loops.linearise(q)
    _, values, right = np.linalg.svd(jacobian[:, loops.unknown, 0])
    null_space = right[int(significant(values, BRANCH_CUTOFF).sum()) :]
    if not len(null_space):
        return q.select(np.zeros(len(q), dtype=np.bool_))
    draw = np.random.default_rng(0)
    directions = draw.normal(size=(DIRECTIONS, len(null_space))) @ null_space
    step = np.zeros((loops.tree.count, DIRECTIONS))
    step[loops.unknown] = (BRANCH_DISTANCE * directions / np.linalg.norm(directions, axis=1)[:, None]).T
    return all_closed(loops, loops.displaced(q.repeated(DIRECTIONS), step))


def all_closed(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return configurations closed from approximate ones, without those that do not close."""
    system = LoopSystem(loops, loops.unknown)
    result = newton(system, q, APPROACH, _damped)
    nearly_closed = result.q.select(result.residual < NEARLY_CLOSED)
    result = newton(
        system, nearly_closed, POLISH, lambda matrix, right: least_norm(matrix, right, STEP_CUTOFF)
    )
    q = result.q.select(result.residual < CLOSED)
    return q.select(axes_aligned(loops, q))


def _damped(jacobian: Array, residual: Array) -> Array:
    """Return damped Gauss-Newton steps, (n, count); the damping is proportional to the residual."""
    transposed = jacobian.transpose(0, 2, 1)
    square = transposed @ jacobian
    damping = 0.1 * (residual**2).mean(1) + 1e-13
    square += damping[:, None, None] * np.eye(square.shape[1])
    return square_solution(square, (transposed @ residual[..., None])[..., 0])


def _rotations(quaternions: Array) -> Array:
    """Return rotation matrices, (balls, 3, 3, n), of quaternions (balls, 4, n) of any length."""
    unit = quaternions / np.sqrt((quaternions**2).sum(1, keepdims=True)) if quaternions.size else quaternions
    return from_quaternion(*unit.transpose(1, 0, 2)).transpose(2, 0, 1, 3)


# distance of a link from its guess, in characteristic lengths and [rad], above which other configurations are
# tried
MAX_DISTANCE = 0.5
# number of random starts if an incomplete guess fails
STARTS = 48
# largest number of coordinates in a message
NAMED = 6


def assembled(mechanism: Mechanism) -> tuple[TreeLoops, Coordinates]:
    """Return the loops of a mechanism and the coordinates in which they close nearest to its guess.

    Raises:
        AssemblyError: if they do not close; states the gap, and where they would close.
    """
    candidates: list[tuple[float, TreeLoops, Coordinates]] = []
    first_error: AssemblyError | None = None
    for poses in _initial_guesses(mechanism):
        try:
            loops, initial = tree_loops(mechanism, poses, initial_coordinates(mechanism))
            q = closed(loops, initial)
            tree_poses = link_poses(loops.tree, q)
            for name, column, cosine in axis_cosines(loops, tree_poses):
                if cosine[0] < 0.0:
                    raise AssemblyError(f"{mechanism.name}: {antiparallel_message(name, column)}")
            candidates.append((_distance_from_guess(loops, tree_poses), loops, q))
        except AssemblyError as error:
            first_error = first_error or error
        if candidates and candidates[-1][0] < MAX_DISTANCE:
            break
    if not candidates:
        assert first_error is not None
        return _from_random_starts(mechanism, first_error)
    return min(candidates, key=lambda candidate: candidate[0])[1:]


def _initial_guesses(mechanism: Mechanism) -> Iterator[Mapping[str, Pose]]:
    """Yield initial poses of all links: with joints in their order, completed, and with slides first."""
    guess = guessed_poses(mechanism)
    yield guess
    completed = completed_poses(mechanism, guess)
    if completed is not None:
        yield completed
    if len(mechanism.guess) < len(mechanism.links):
        yield guessed_poses(mechanism, stiff_first=True)


def _from_random_starts(mechanism: Mechanism, first_error: AssemblyError) -> tuple[TreeLoops, Coordinates]:
    """Return loops closed from random starts: nearest to an incomplete guess, else nearest to zero.

    Raises:
        AssemblyError: if the guess is complete, with other configurations in which they close; `first_error`
            if they never close, or not near the guess.
    """
    loops, initial = tree_loops(mechanism, guessed_poses(mechanism), initial_coordinates(mechanism))
    batches = [batch for _, batch in random_poses(loops, initial, STARTS, seed=1)]
    if len(mechanism.guess) == len(mechanism.links):
        raise _closes_elsewhere(loops, initial, batches) or first_error
    best: tuple[float, float] = (MAX_DISTANCE, np.inf)
    chosen: Coordinates | None = None
    for q in (batch.select(np.array([i])) for batch in batches for i in range(len(batch))):
        rank = (
            _distance_from_guess(loops, link_poses(loops.tree, q)),
            float(np.abs(q.values / loops.units[:, None]).max(initial=0.0)),
        )
        if rank[0] < MAX_DISTANCE and rank < best:
            best, chosen = rank, q
    if chosen is None:
        raise first_error
    return loops, closed(loops, chosen)


def _closes_elsewhere(
    loops: TreeLoops, initial: Coordinates, batches: Iterable[Coordinates]
) -> AssemblyError | None:
    """Return the error of a guess if the loops close at other configurations; else None."""
    mechanism, index_of = loops.tree.mechanism, loops.tree.index_of
    displacements = [(batch.values - initial.values) / loops.units[:, None] for batch in batches]
    all_displacements = np.concatenate([np.zeros((loops.tree.count, 0)), *displacements], 1)
    if not all_displacements.shape[1]:
        return None
    nearest = (
        initial.values
        + (loops.units * all_displacements[:, np.abs(all_displacements).max(0).argmin()])[:, None]
    )
    prescribed = (*mechanism.drivers, *mechanism.locked)
    listed = [name for name in index_of if name not in prescribed][:NAMED]

    def values_text(names: Iterable[str]) -> str:
        return ", ".join(f"{name} = {nearest[index_of[name], 0]:.4g}" for name in names)

    return AssemblyError(
        f"{mechanism.name}: {'at ' + values_text(prescribed[:NAMED]) + ' ' if prescribed else ''}the loops "
        f"do not close at the start of the other joints, but they do with {values_text(listed)}; start near "
        "these values, by a keyframe, the positions of the bodies, or the guess"
    )


def _distance_from_guess(loops: TreeLoops, poses: LinkPoses) -> float:
    """Return the largest distance of links from their guess, in characteristic lengths and [rad]."""
    worst = 0.0
    for name, pose in loops.tree.mechanism.guess.items():
        i = loops.tree.links[name]
        distance = float(np.linalg.norm(poses.position[i, :, 0] - pose.position)) / loops.tree.length
        trace = float(np.trace(pose.rotation.T @ poses.rotation[i, :, :, 0]))
        worst = max(worst, distance, float(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))))
    return worst


def locked_values(mechanism: Mechanism) -> Array:
    """Return the values of locked coordinates, (locked,) in [m] or [rad]."""
    return np.array([*mechanism.locked.values()], dtype=np.float64)


def with_locked(driven: Array, locked: Array) -> Array:
    """Return all prescribed coordinates, (drivers + locked, n), from drivers (drivers, n) and (locked,)."""
    if not len(locked):
        return driven
    return np.vstack([driven, np.broadcast_to(locked[:, None], (len(locked), driven.shape[1]))])


def closed(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return the coordinates in which the loops close nearest to given ones, at fixed prescribed coordinates.

    Raises:
        AssemblyError: if they do not close; states the gap, and where they would close.
        AssemblyError: where they do not close; names the gap that is left, and where they would.
    """
    solution, residual = close_nearest(loops, q)
    if residual[0] < CLOSED:
        return solution
    raise AssemblyError(assembly_failure(loops, q, solution, float(residual[0])))


# distance in characteristic lengths and matrix entries below which poses are equal
SAME_POSE = 1e-9


def with_closed_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose guess is its assembled configuration: every method starts in it.

    Revolutions of coupled joints, which a pose does not determine, are included. A mechanism whose guess is
    closed, or whose loops do not close, is returned unchanged.
    """
    try:
        poses, values = start_poses(mechanism)
    except AssemblyError:
        return mechanism
    counted = {*mechanism.guess_coordinates, *mechanism.drivers, *mechanism.locked}
    uncounted = (name for law in mechanism.laws if not law.turns for name in law.coordinates)
    coupled = [name for name in uncounted if name not in counted and mechanism.unit(name) == "rad"]
    guess_coordinates = dict(mechanism.guess_coordinates)
    guess_coordinates |= {name: values[name] for name in coupled if abs(values[name]) > np.pi}
    if (
        guess_coordinates == mechanism.guess_coordinates
        and mechanism.guess.keys() == poses.keys()
        and all(
            np.abs(pose.position - poses[name].position).max() < SAME_POSE * mechanism.characteristic_length
            and np.abs(pose.rotation - poses[name].rotation).max() < SAME_POSE
            for name, pose in mechanism.guess.items()
        )
    ):
        return mechanism
    return replace(mechanism, guess=poses, guess_coordinates=guess_coordinates)


def start_poses(mechanism: Mechanism) -> tuple[dict[str, Pose], dict[str, float]]:
    """Return the poses of the moving links, closed nearest to the guess, and all coordinates there.

    Returns:
        Link -> pose; coordinate -> value in [m] or [rad], with revolutions if the mechanism has them.

    Raises:
        AssemblyError: where the loops do not close.
    """
    loops, q = assembled(mechanism)
    tree = loops.tree
    tree_poses = link_poses(tree, q)
    poses = {name: pose.select(0) for name, pose in tree_poses.by_link(tree.links).items()}
    everywhere = {GROUND: IDENTITY, **poses}
    values: dict[str, float] = {}
    for joint in mechanism.joints:
        read = np.atleast_1d(joint_coordinate(joint, everywhere[joint.a.link], everywhere[joint.b.link]))
        for name, value in zip(joint.coordinates, read.tolist(), strict=False):
            index = tree.index_of.get(name)
            values[name] = value if index is None else float(q.values[index, 0])
    return poses, values
