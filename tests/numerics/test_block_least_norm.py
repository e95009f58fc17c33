"""Minimum-norm solutions by blocks of rows are those of the pseudo-inverse."""

import numpy as np
import pytest

from mechsim.numerics.block_least_norm import block_least_norm

N, ROWS = 3, 6


def random_equations(random, blocks, in_cluster, density):
    """Return columns and clusters of random equations, each cluster in one or two blocks of rows."""
    columns, clusters = [], []
    for _ in range(int(random.integers(blocks, 2 * blocks + 1))):
        touched = random.integers(0, blocks, 1 + int(random.random() < 0.7)).tolist()
        clusters.append([*range(len(columns), len(columns) + in_cluster)])
        columns += [
            {
                block: random.normal(size=(N, ROWS)) * (random.random(ROWS) < density)
                for block in dict.fromkeys(touched)
            }
            for _ in range(in_cluster)
        ]
    return columns, clusters


def dense(columns, blocks):
    matrix = np.zeros((N, blocks, ROWS, len(columns)))
    for i, column in enumerate(columns):
        for block, values in column.items():
            matrix[:, block, :, i] = values
    return matrix.reshape(N, blocks * ROWS, -1)


@pytest.mark.parametrize("seed", range(12))
def test_solution_and_null_space_are_those_of_the_pseudo_inverse(seed):
    random = np.random.default_rng(seed)
    blocks = 2 + seed % 5
    columns, clusters = random_equations(random, blocks, 4 + seed % 2, 1.0 if seed % 2 else 0.4)
    matrix = dense(columns, blocks)
    right = matrix @ random.normal(size=(N, len(columns), 2))
    solved = block_least_norm(columns, clusters, right.reshape(N, blocks, ROWS, 2))
    inverse = np.linalg.pinv(matrix, rcond=1e-9)
    largest = np.abs(inverse).max()
    assert np.abs(solved.solution - inverse @ right).max() <= 1e-13 * largest * np.abs(right).max()
    projector = np.eye(len(columns)) - inverse @ matrix
    for cluster, null in zip(clusters, solved.null, strict=True):
        expected = projector[:, cluster][:, :, cluster]
        assert np.abs(null @ null.swapaxes(1, 2) - expected).max() <= 1e-12 * largest
    assert (solved.nullity == len(columns) - np.linalg.matrix_rank(matrix)).all()
    assert solved.complete.all()


def test_an_instant_with_a_smaller_rank_is_named():
    """Two columns of one block are parallel at the second of three instants."""
    first = np.broadcast_to(np.eye(ROWS)[0], (N, ROWS))
    second = np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 1.0]]) @ np.eye(2, ROWS) + first
    columns = [{0: first}, {0: second}, *({0: np.broadcast_to(row, (N, ROWS))} for row in np.eye(ROWS)[2:])]
    solved = block_least_norm(columns, [[*range(len(columns))]], np.ones((N, 1, ROWS, 1)))
    assert solved.complete.tolist() == [True, False, True]
    assert solved.nullity == 0
