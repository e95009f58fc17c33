"""Poses from random starts: closed by damped Gauss-Newton steps, all together, the crank as free as any."""

from collections.abc import Iterator

import numpy as np

from mechsim.analytic.loops.constraints import LoopSystem, TreeLoops, axes_aligned
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import least_norm, significant

# damped Gauss-Newton steps from a random start, and least-norm Newton steps after them
APPROACH = NewtonSettings(max_iterations=80, max_step=0.7)
POLISH = NewtonSettings(max_iterations=4, max_step=0.7)
# residuals that promise to close, and that are closed
NEARLY_CLOSED, CLOSED = 1e-6, 1e-12
# singular values below this fraction of the largest are zero in the least-norm steps
STEP_CUTOFF = 1e-7
# and below this part, where assemblies meet, do not count
BRANCH_CUTOFF = 1e-6
# how far slides are thrown, in sizes to either side
SLIDE_RANGE = 2.0
# bytes of Jacobians of random starts that are closed together
CHUNK_BYTES = 4e6
# how far from a branch point its branches are looked for, in radians or parts of the size, and how many ways
BRANCH_DISTANCE, DIRECTIONS = 0.05, 16


def random_poses(
    loops: TreeLoops, reference: Coordinates, count: int, seed: int
) -> Iterator[tuple[int, Coordinates]]:
    """Yield closed poses from random starts, without those that close not at all or with axes opposed.

    Chunks of starts need little memory; each comes with the number of starts so far.

    Args:
        loops: of the mechanism.
        reference: one set of coordinates about which slides are thrown.
        count: how many starts.
        seed: of the random numbers.
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
        yield int(indices[-1]) + 1, closed(loops, initial.select(indices))


def poses_around_branch_point(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return closed poses all around a place where assemblies meet: some on each branch that leaves it."""
    _, jacobian, _ = loops.linearise(q)
    _, values, right = np.linalg.svd(jacobian[:, loops.unknown, 0])
    null_space = right[int(significant(values, BRANCH_CUTOFF).sum()) :]
    if not len(null_space):
        return q.select(np.zeros(len(q), dtype=np.bool_))
    draw = np.random.default_rng(0)
    directions = draw.normal(size=(DIRECTIONS, len(null_space))) @ null_space
    step = np.zeros((loops.tree.count, DIRECTIONS))
    step[loops.unknown] = (BRANCH_DISTANCE * directions / np.linalg.norm(directions, axis=1)[:, None]).T
    return closed(loops, loops.displaced(q.repeated(DIRECTIONS), step))


def closed(loops: TreeLoops, q: Coordinates) -> Coordinates:
    """Return coordinates closed from rough ones; those that do not close are left out."""
    system = LoopSystem(loops, loops.unknown)
    result = newton(system, q, APPROACH, _damped)
    nearly_closed = result.q.select(result.residual < NEARLY_CLOSED)
    result = newton(
        system, nearly_closed, POLISH, lambda matrix, right: least_norm(matrix, right, STEP_CUTOFF)
    )
    q = result.q.select(result.residual < CLOSED)
    return q.select(axes_aligned(loops, q))


def _damped(jacobian: Array, residual: Array) -> Array:
    """Return damped Gauss-Newton steps, (n, count): the damping goes with the residual."""
    transposed = jacobian.transpose(0, 2, 1)
    square = transposed @ jacobian
    damping = 0.1 * (residual**2).mean(1) + 1e-13
    square += damping[:, None, None] * np.eye(square.shape[1])
    return np.linalg.solve(square, transposed @ residual[..., None])[..., 0]


def _rotations(quaternions: Array) -> Array:
    """Return rotation matrices, (balls, 3, 3, n), of quaternions (balls, 4, n) of any length."""
    unit = quaternions / np.sqrt((quaternions**2).sum(1, keepdims=True)) if quaternions.size else quaternions
    w, x, y, z = unit.transpose(1, 0, 2)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1, 3)
