"""Rank of the loop equations: mobility, redundant rows, distance to a singular pose, least-norm solutions."""

from dataclasses import dataclass

import numpy as np

from mechsim.analytic.loops.loop_equations import Poses, equations, scaled
from mechsim.analytic.loops.numerical_rank import RANK_TOLERANCE
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# poses at which ranks are looked at: so many are not all special ones
SAMPLED_POSES = 5
# condition of the normal equations below which two refinements leave rounding
MAX_CONDITION = 1e10
# what is smaller than this part of the largest is nought
NEGLIGIBLE = 1e-40


def singular_values(mechanism: Mechanism, poses: Poses, *, crank_free: bool = False) -> Array:
    """Return the singular values of the loop Jacobian in units of the mechanism's size, (n, k), falling.

    With the crank held, the smallest of them that belongs to a determined coordinate is the
    distance to a singular pose (a dead centre of the crank).
    """
    angle = None if crank_free else 0.0
    rows = equations(mechanism, poses, angle)
    values = np.linalg.svd(scaled(mechanism, rows.jacobian), compute_uv=False)
    return values.astype(np.float64, copy=False)


def conditioning(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the distance of each pose from a singular one with the crank held, (n,), 0 to about 1.

    The smallest singular value of the loop Jacobian in units of the mechanism's size; those that are
    nought at every pose, of redundant rows and passive freedoms, do not count.
    """
    values = singular_values(mechanism, poses)
    rank = int((values > RANK_TOLERANCE * values[:, :1]).sum(1).max())
    return values[:, rank - 1]


@dataclass(frozen=True, slots=True)
class Freedom:
    """What the rank of the loop Jacobian says, at the pose of several where it is largest.

    Attributes:
        mobility: freedoms left by all joints.
        passive: freedoms left once the crank is held, which move no tracked point by themselves.
        redundant: rows that repeat what others say.
        rank: of the loop Jacobian without the driver row.
    """

    mobility: int
    passive: int
    redundant: int
    rank: int


def freedom(mechanism: Mechanism, poses: Poses) -> Freedom:
    """Return mobility, passive freedoms and redundant rows, by `SEEN` poses or a few more, evenly spread.

    A pose at which assemblies meet says no more than that it is one.

    Source: rank of the Jacobian of the loop equations; papers.md sections 1-3 for what is expected.
    """
    count = len(next(iter(poses.values())).position)
    sample = {
        name: pose.at(slice(None, None, max(1, count // SAMPLED_POSES))) for name, pose in poses.items()
    }
    unknowns = 6 * len(mechanism.links)

    def rank(crank_free: bool) -> tuple[int, int]:
        values = singular_values(mechanism, sample, crank_free=crank_free)
        rows = equations(mechanism, sample, None if crank_free else 0.0).residual.shape[1]
        return int((values > RANK_TOLERANCE * values[:, :1]).sum(1).max()), rows

    free_rank, rows = rank(True)
    crank_locked_rank, _ = rank(False)
    return Freedom(unknowns - free_rank, unknowns - crank_locked_rank, rows - free_rank, free_rank)


def least_norm(mechanism: Mechanism, jacobian: Array, right: Array) -> Array:
    """Least-norm solution of J x = right, (n, 6 links): redundant rows, passive freedoms do no harm.

    Where the columns of J are far from dependent, by refined normal equations, to rounding too and ten
    times as fast as by singular values.
    """
    columns = np.tile([mechanism.size] * 3 + [1.0] * 3, len(mechanism.links))
    matrix = jacobian * columns
    solution = _by_normal_equations(matrix, right[..., None])
    if solution is None:
        solution = np.linalg.pinv(matrix, rcond=RANK_TOLERANCE) @ right[..., None]
    return columns * solution[..., 0]


def _by_normal_equations(matrix: Array, right: Array) -> Array | None:
    """Return the least-squares solution, (n, k, 1); None where columns are dependent or nearly so."""
    transposed = np.swapaxes(matrix, 1, 2)
    gram = transposed @ matrix
    try:
        inverse = np.linalg.inv(gram)
    except np.linalg.LinAlgError:
        return None
    with np.errstate(all="ignore"):
        condition = np.abs(gram).sum(1).max(1) * np.abs(inverse).sum(1).max(1)
    if not (condition < MAX_CONDITION).all():
        return None
    solution = inverse @ (transposed @ right)
    for _ in range(2):
        solution = solution + inverse @ (transposed @ (right - matrix @ solution))
    # products of rounding, which underflow when squared
    return np.where(np.abs(solution) < NEGLIGIBLE * np.abs(solution).max(1, keepdims=True), 0.0, solution)
