import numpy as np
import pytest
from hypothesis import assume, given, settings
from model_files import stated_mechanism
from strategies import EPS, rssrs

from mechsim import catalog, loops
from mechsim.kinematics.loops import path
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinematics.vector_method.vectors import rotation
from mechsim.mechanism.links import Pose

# a joint of every kind with inclined axes and a gear; not assembled, only differentiated
EVERY_JOINT = stated_mechanism("closure_every_joint.toml")
# gear and driver equations are linearised at assembled joints; tests of rates cover them
JOINT_ROWS = slice(0, -2)


@pytest.fixture
def random_state():
    random = np.random.default_rng(20240229)
    poses, twists = {}, {}
    for link in EVERY_JOINT.links:
        x, y, z = random.uniform(-0.6, 0.6, 3)
        rotated = rotation("x", x) @ rotation("y", y) @ rotation("z", z)
        poses[link.name] = Pose(random.uniform(-0.2, 0.2, (1, 3)), rotated[None])
        twists[link.name] = random.uniform(-1.0, 1.0, (1, 6))
    return poses, twists


def displaced(poses, twists, time):
    """Return the poses after motion at constant velocity and angular velocity."""
    return {
        name: Pose(
            pose.position + time * twists[name][:, :3],
            loops.turned_by(pose.rotation, time * twists[name][:, 3:]),
        )
        for name, pose in poses.items()
    }


def test_jacobian_is_the_derivative_of_the_residual(random_state):
    poses, twists = random_state
    step = 1e-5
    ahead, behind = (loops.equations(EVERY_JOINT, displaced(poses, twists, t), 0.2) for t in (step, -step))
    equations = loops.equations(EVERY_JOINT, poses, 0.2)
    rate = equations.jacobian @ np.concatenate([twists[link.name][0] for link in EVERY_JOINT.links])
    # central differences: an error of step squared, and of rounding over the step
    error = (ahead.residual - behind.residual) / (2 * step) - rate
    assert np.abs(error[:, JOINT_ROWS]).max() <= 1e-9


def test_the_velocity_product_term_is_the_second_derivative_of_the_residual(random_state):
    poses, twists = random_state
    step = 1e-3
    values = [
        loops.equations(EVERY_JOINT, displaced(poses, twists, i * step), 0.2).residual for i in range(-2, 3)
    ]
    second = (-values[0] + 16 * values[1] - 30 * values[2] + 16 * values[3] - values[4]) / (12 * step**2)
    velocity_product = loops.equations(EVERY_JOINT, poses, 0.2, twists).bias
    # fourth-order differences: an error of step to the fourth, and of rounding over step squared
    assert np.abs(second - velocity_product)[:, JOINT_ROWS].max() <= 1e-8


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


def test_a_geared_crank_turns_beyond_one_revolution():
    angles = np.linspace(0.0, 9.0, 4)
    motion = loops.solve(stated_mechanism("closure_pair.toml"), angles, 2.0, 1.0)
    rotated = -1.5 * angles + 0.4
    expected = np.stack([0.1 + 0.02 * np.cos(rotated), 0.02 * np.sin(rotated), 0 * rotated], 1)
    assert np.abs(motion.points["P"].position - expected).max() <= 1e-14
    assert np.abs(motion.joints["second"].rate + 3.0).max() <= 1e-12
    assert np.abs(motion.joints["second"].acceleration + 1.5).max() <= 1e-12


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


def test_conditioning_vanishes_at_a_dead_centre():
    linkage = catalog.make("four_bar", crank=0.08)
    (low, high), *_ = linkage.crank_range().arcs

    def nearest(angle):
        motion = linkage.solve([angle])
        poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
        return loops.conditioning(linkage.mechanism, poses)[0]

    assert nearest(high - 1e-8) < 1e-3 < nearest((low + high) / 2)


def test_a_guess_with_a_link_turned_over_is_assembled_with_parallel_axes():
    linkage = catalog.make("four_bar")
    mechanism = linkage.mechanism
    guess = dict(mechanism.guess)
    # the rocker rotated about its length satisfies the equations of parallel axes
    rocker = guess["rocker"]
    guess["rocker"] = type(rocker)(rocker.position, rocker.rotation @ np.diag([1.0, -1.0, -1.0]))
    poses = loops.assemble(mechanism, [mechanism.start], guess)
    assert np.abs(poses["rocker"].rotation[0] - rocker.rotation).max() < 1e-12
