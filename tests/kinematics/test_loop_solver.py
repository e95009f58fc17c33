"""Selection of loop equations near a configuration, and the null-space basis of undetermined DOFs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.loops.mobility import checked_start
from mechsim.numerics.loop_solver import Linearised, LoopSolver, loop_solver
from mechsim.numerics.path_segments import PathStates

# differences of the fourth order
WEIGHTS, STEP = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0, 1e-3


def rssr():
    """Return the loops of a spatial four-bar with a passive spin, and its assembled configuration."""
    first = checked_start(ms.catalog.make("rssr").mechanism)
    return first.loops, first.reference


def six_bar():
    first = checked_start(ms.load("watt_six_bar").mechanism)
    return first.loops, first.reference


def perturbed(loops, q, distance):
    """Return coordinates perturbed at random, each by a similar amount."""
    step = distance * np.random.default_rng(7).uniform(0.5, 1.0, (loops.tree.count, 1))
    step[list(loops.driven)] = 0.0
    return loops.displaced(q, step), step


def test_the_null_space_basis_measures_undetermined_displacement():
    loops, start = rssr()
    solver = loop_solver(loops, start)
    assert solver.nullity == 1
    displaced, step = perturbed(loops, start, 1e-4)
    displacement = solver.linearise(displaced).rhs[0, len(solver.rows) :]
    assert displacement == pytest.approx(solver.null_space @ step[loops.unknown, 0], rel=1e-3)
    assert abs(displacement[0]) > 1e-6


@pytest.mark.parametrize("distance", [0.0, 0.3])
def test_the_solver_matrix_is_the_jacobian_of_its_residual(distance):
    loops, start = rssr()
    solver = loop_solver(loops, start)
    q, _ = perturbed(loops, start, distance)
    result = solver.linearise(q).matrix[0]
    for column, index in enumerate(loops.unknown):
        total = 0.0
        for weight, times in zip(WEIGHTS, (-2, -1, 0, 1, 2), strict=True):
            step = np.zeros((loops.tree.count, 1))
            step[index] = times * STEP
            total = total + weight * solver.linearise(loops.displaced(q, step)).rhs[0]
        assert total / STEP == pytest.approx(result[:, column], abs=1e-10)


@pytest.mark.parametrize("fraction", [0.0, 0.19, 0.39, 0.41, 0.49, 0.51, 1.0])
def test_equation_selection_requires_a_minimum_rank_margin(fraction):
    # singular values of all equations are 8, 4 and 2; the first three equations keep a fraction of the last
    gradient = np.eye(4, 3)[..., None] * np.array([[8.0], [4.0], [2.0]])
    gradient[2:, 2, 0] = 2.0 * fraction, 2.0 * np.sqrt(1.0 - fraction**2)
    empty = np.concatenate([gradient, 0.0 * gradient], -1)
    matrix = empty[:3].transpose(2, 0, 1)
    result = Linearised(gradient, empty, None, matrix, gradient, np.arange(3), np.array([3]))
    solver = LoopSolver(SimpleNamespace(rows=4), np.arange(3), np.zeros((0, 3)), None)
    reported = [bool(item[0]) for item in solver.adequate(result)]
    assert reported == [fraction > 0.4, fraction > 0.5]
    # a Jacobian of zero has the ratio one
    assert solver.share(result) == pytest.approx([fraction, 1.0], abs=1e-15)


def test_violated_redundant_equations_are_detected():
    loops, start = six_bar()
    solver = loop_solver(loops, start)
    redundant = next(row for row in range(loops.rows) if row not in solver.rows)
    evaluate = loops.linearise

    def violated(q):
        residual, gradient, poses = evaluate(q)
        residual[redundant] += 1e-9
        return residual, gradient, poses

    vars(loops)["linearise"] = violated
    guess, _ = perturbed(loops, start, 5e-5)
    path = PathStates(loops, lambda _: start.values[list(loops.driven)])
    assert path.closed(solver, np.zeros(1), path.loops.flat(guess), 1e-12) is None
    result = path.closed(solver, np.zeros(1), path.loops.flat(guess), 2e-9).linearised
    assert np.abs(result.residual).max() == pytest.approx(1e-9, rel=1e-3)


def test_all_singular_values_include_the_unsolved_equations():
    loops, start = six_bar()
    solver = loop_solver(loops, start)
    result = solver.linearise(start)
    gradient = result.jacobian[:, loops.unknown].transpose(2, 0, 1)
    expected = np.linalg.svd(gradient, compute_uv=False)
    assert result.all_singular_values == pytest.approx(expected, abs=1e-14)
    assert result.all_singular_values is result.singular_values
    tilted = gradient.transpose(1, 2, 0).copy()
    tilted[result.others[0]] = 0.5
    reported = replace(result, derivatives=np.insert(tilted, loops.driven, 0.0, axis=1))
    assert reported.all_singular_values == pytest.approx(
        np.linalg.svd(tilted.transpose(2, 0, 1), compute_uv=False), abs=1e-14
    )
    assert reported.all_singular_values[0, -1] > 1.01 * expected[0, -1]


def test_a_wrong_null_space_basis_is_rejected():
    loops, start = rssr()
    solver = loop_solver(loops, start)
    assert solver.nullity == 1
    assert len(solver.others) == 0
    row = solver.at_reference.jacobian[0, loops.unknown, 0]
    other = replace(solver, null_space=row[None] / np.linalg.norm(row))
    assert all(solver.adequate(solver.at_reference))
    assert not any(other.adequate(other.at_reference))
    assert other.share(other.at_reference) < 1e-12


def test_signed_distance_has_the_sign_of_the_determinant():
    right, left = (np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0] for seed in (3, 4))
    matrix = np.stack([right @ np.diag([0.9, 0.5, 0.2]) @ left, right @ np.diag([0.9, -0.5, 0.1]) @ left])
    empty = np.zeros((3, 0))
    side = Linearised(empty, empty, None, matrix, empty, np.arange(3), np.arange(0)).signed_distance
    rotated = np.sign(np.linalg.det(right @ left))
    np.testing.assert_allclose(side, rotated * np.array([0.2, -0.1]), rtol=1e-12)
