"""Poses from random starts: closed by damped Gauss-Newton steps, all together, the crank as free as any."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.telling import least_part, telling
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates, placed
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS

# damped steps, the longest of them in radians or parts of the size, and polishing steps after them
STEPS, LONGEST, POLISH = 80, 0.7, 4
# residuals that promise to close, and that are closed
PROMISING, CLOSED = 1e-6, 1e-12
# singular values below this part of the largest tell nothing of a step
NOTHING = 1e-7
# and below this part, where assemblies meet, do not count
MET = 1e-6
# how far slides are thrown, in sizes to either side
THROW = 2.0
# bytes of slopes of random starts that are closed together
TOGETHER = 4e6
# how far from a meeting its branches are looked for, in radians or parts of the size, and how many ways
NEARBY, DIRECTIONS = 0.05, 16


def random_poses(
    loops: TreeLoops, own: Coordinates, count: int, seed: int
) -> Iterator[tuple[int, Coordinates]]:
    """Yield closed poses from random starts, without those that close not at all or with axes opposed.

    So many starts at a time as fit into little memory, each time with how many were begun so far.

    Args:
        loops: of the mechanism.
        own: one set of coordinates about which slides are thrown.
        count: how many starts.
        seed: of the random numbers.
    """
    tree, draw = loops.tree, np.random.default_rng(seed)
    angles = draw.uniform(-np.pi, np.pi, (tree.count, count))
    thrown = own.values + THROW * loops.units[:, None] * draw.uniform(-1.0, 1.0, (tree.count, count))
    values = np.where(tree.slides[:, None], thrown, angles)
    values[list(loops.driven)] = own.values[list(loops.driven)]
    quaternions = draw.normal(size=(len(tree.balls), 4, count))
    begun = Coordinates(values, _rotations(quaternions))
    most = max(1, int(TOGETHER / (8 * (loops.rows + tree.count + 1) * (tree.count + 1))))
    for first in range(0, count, most):
        some = np.arange(first, min(first + most, count))
        yield int(some[-1]) + 1, closed(loops, taken(begun, some))


def poses_beside(loops: TreeLoops, at: Coordinates) -> Coordinates:
    """Return closed poses all around a place where assemblies meet: some on each branch that leaves it."""
    _, slope, _ = loops.linearise(at)
    _, values, right = np.linalg.svd(slope[:, loops.unknown, 0])
    free = right[int(telling(values, MET).sum()) :]
    if not len(free):
        return taken(at, np.zeros(len(at), dtype=np.bool_))
    draw = np.random.default_rng(0)
    directions = draw.normal(size=(DIRECTIONS, len(free))) @ free
    step = np.zeros((loops.tree.count, DIRECTIONS))
    step[loops.unknown] = (NEARBY * directions / np.linalg.norm(directions, axis=1)[:, None]).T
    many = Coordinates(np.repeat(at.values, DIRECTIONS, 1), np.repeat(at.turns, DIRECTIONS, -1))
    return closed(loops, loops.moved(many, step))


def closed(loops: TreeLoops, at: Coordinates) -> Coordinates:
    """Return coordinates closed from rough ones; those that do not close are left out."""
    for count in range(STEPS + POLISH):
        residual, slope, _ = loops.linearise(at)
        if count == STEPS:
            at = taken(at, np.abs(residual).max(0, initial=0.0) < PROMISING)
            residual, slope, _ = loops.linearise(at)
        if not len(at) or not loops.rows:
            return at
        make = _damped if count < STEPS else _least
        move = make(slope[:, loops.unknown].transpose(2, 0, 1), residual.T)
        step = np.zeros_like(at.values)
        step[loops.unknown] = (move * np.minimum(1.0, LONGEST / _length(move))[:, None]).T
        at = loops.moved(at, step)
    residual = loops.linearise(at)[0]
    at = taken(at, np.abs(residual).max(0) < CLOSED)
    return taken(at, axes_alike(loops, at))


def taken(at: Coordinates, which: NDArray[np.bool_] | NDArray[np.intp]) -> Coordinates:
    """Return some of many coordinates."""
    return Coordinates(at.values[:, which], at.turns[..., which])


def _damped(slope: Array, residual: Array) -> Array:
    """Return damped Gauss-Newton steps, (n, count): the damping goes with the residual."""
    turned = slope.transpose(0, 2, 1)
    square = turned @ slope
    damping = 0.1 * (residual**2).mean(1) + 1e-13
    square += damping[:, None, None] * np.eye(square.shape[1])
    return -np.linalg.solve(square, turned @ residual[..., None])[..., 0]


def _least(slope: Array, residual: Array) -> Array:
    """Return least-norm steps, (n, count)."""
    return -(np.linalg.pinv(slope, rcond=least_part(slope, NOTHING)) @ residual[..., None])[..., 0]


def _length(move: Array) -> Array:
    return np.maximum(np.abs(move).max(1, initial=0.0), 1e-300)


def axes_alike(loops: TreeLoops, at: Coordinates) -> NDArray[np.bool_]:
    """Return which poses have no cut joint put together with its axes, or marks, opposed, (n,)."""
    here, alike = placed(loops.tree, at), np.ones(len(at), dtype=np.bool_)
    for cut in loops.cuts:
        _, frame_a, _, frame_b = cut.frames(here)
        for i in KINDS[cut.joint.kind].alike:
            alike &= (frame_a[:, i] * frame_b[:, i]).sum(0) > 0.0
    return alike


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
