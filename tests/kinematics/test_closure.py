import numpy as np
import pytest
from hypothesis import assume, given, settings
from strategies import EPS, rssrs

from mechsim import catalog, loops
from mechsim.kinematics.loops import path
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import Pose


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("four_bar", {}, (1, 0, 3)),
        ("slider_crank", {}, (1, 0, 3)),
        ("rssr", {}, (2, 1, 0)),
        ("rssr", {"guide": True}, (1, 0, 0)),
    ],
)
def test_the_rank_determines_mobility_passive_dofs_and_redundant_equations(name, changes, expected):
    mechanism = catalog.make(name, **changes).mechanism
    poses = loops.assemble(mechanism, [0.3])
    result = loops.dof_count(mechanism, poses)
    assert (result.mobility, result.passive, result.redundant) == expected


@settings(max_examples=10)
@given(rssrs())
def test_assembly_from_a_guess_gives_the_selected_branch(linkage):
    assume(linkage.crank_range().arcs)
    mechanism = linkage.mechanism
    start = np.array([mechanism.start])
    # near a dead centre a guess is as close to the other branch
    assume(linkage.transmission_angle(start)[0] > 0.3)
    guess = {name: Pose(pose.position + 1e-4, pose.rotation) for name, pose in mechanism.guess.items()}
    poses = loops.assemble(mechanism, start, guess)
    assert loops.residual_norms(mechanism, poses, start)[0][0] <= 8 * EPS * mechanism.characteristic_length
    tip = poses["rocker"].point((linkage.rocker, 0.0, 0.0))
    assert np.abs(tip - linkage.positions(start)["P3"]).max() <= 1e-12 * mechanism.characteristic_length / 0.3


def test_poses_solved_one_by_one_are_those_of_the_closed_form(monkeypatch):
    """A long row of loops is solved so, in little memory."""
    monkeypatch.setattr(path, "CHUNK_BYTES", 1.0)
    exact = catalog.make("four_bar")
    angles = np.linspace(0.0, 1.0, 5)
    solved, expected = (
        solver.solve(angles, 2.0).points["B"] for solver in (KinematicSolver(exact.mechanism), exact)
    )
    np.testing.assert_allclose(solved.position, expected.position, atol=8 * EPS)
    np.testing.assert_allclose(solved.acceleration, expected.acceleration, rtol=1e-12)


def test_a_guess_with_a_link_turned_over_is_assembled_with_parallel_axes():
    linkage = catalog.make("four_bar")
    mechanism = linkage.mechanism
    guess = dict(mechanism.guess)
    # the rocker rotated about its length satisfies the equations of parallel axes
    rocker = guess["rocker"]
    guess["rocker"] = type(rocker)(rocker.position, rocker.rotation @ np.diag([1.0, -1.0, -1.0]))
    poses = loops.assemble(mechanism, [mechanism.start], guess)
    assert np.abs(poses["rocker"].rotation[0] - rocker.rotation).max() < 1e-12
