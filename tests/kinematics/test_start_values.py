"""The initial configuration: the assembly mode of the guess, from which every method starts."""

from dataclasses import replace

import numpy as np
import pytest
from change_point_linkages import CHANGE_POINT_LINKAGES
from model_files import changed_model, stated_mechanism
from motions import largest_difference

import mechsim as ms
from mechsim import loops, simulate
from mechsim.io.readers import load
from mechsim.io.toml_writer import to_toml
from mechsim.kinematics.loops.start import start_poses, with_closed_guess
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Link, Pose
from mechsim.mechanism.motion_laws import Arcs

# four revolute joints through one point, with an inaccurate guess
SPHERICAL = stated_mechanism("start_values_spherical.toml")


def test_both_methods_start_from_the_assembled_configuration():
    mechanism = with_closed_guess(SPHERICAL)
    poses = {name: Pose(item.position[None], item.rotation[None]) for name, item in mechanism.guess.items()}
    assert max(opened.max() for opened in loops.residual_norms(mechanism, poses, 0.0)) < 1e-14
    assert with_closed_guess(mechanism) is mechanism
    result = simulate(mechanism, speed=1.0, turns=0.2, method="pose").motion
    exact = loops.solve(SPHERICAL, result.angle)
    assert max(difference.max() for difference in result.position_errors(exact).values()) < 1e-13


def test_a_cylinder_without_a_guess_has_the_length_between_its_guessed_ends():
    barrel = "barrel = { at = [0.5, -0.2, 0], turn = { axis = [0, 0, 1], angle = 1 } }"
    path = changed_model("driven_mechanisms_boom.toml", ("start = { stroke = 0.7 }", ""), (barrel, ""))
    # the boom keeps its guess, or a requested start
    for lift, requested in ((0.5, {}), (0.6, {"lift": "0.6 rad"})):
        _, values = start_poses(load(path, start=requested, still=True).mechanism)
        # from the foot to the head on the boom
        length = np.hypot(np.cos(lift) - 0.5, np.sin(lift) + 0.2)
        assert np.abs([values["lift"] - lift, values["stroke"] - length]).max() < 1e-14


def test_an_assembled_file_is_written_and_read_back(tmp_path):
    source = tmp_path / "rough.toml"
    source.write_text(to_toml(SPHERICAL), "utf-8")
    started = load(str(source)).mechanism
    reported = stated_mechanism(source).guess["three"].rotation
    assert np.abs(started.guess["three"].rotation - reported).max() > 0.1
    again = tmp_path / "again.toml"
    again.write_text(to_toml(started), "utf-8")
    back = load(str(again)).mechanism
    assert all((back.guess[link].rotation == pose.rotation).all() for link, pose in started.guess.items())


def test_a_loose_body_stays_where_it_is_and_changes_nothing():
    crank = SPHERICAL
    joints = (*crank.joints, Joint("free", "floating", End(GROUND), End("body")))
    result = simulate(replace(crank, links=(*crank.links, Link("body")), joints=joints), speed=1.0).motion
    assert not np.ptp(result.links["body"].position, axis=0).any()
    exact = loops.solve(crank, result.angle)
    # the tolerance of stepped positions, 1e-8 of the unit length of the arcs
    assert max(difference.max() for difference in result.position_errors(exact).values()) < 1e-8


def test_the_start_is_zero_or_the_middle_of_the_longest_arc():
    assert Arcs(True, ((-np.pi, np.pi),)).start() == 0.0
    assert Arcs(False, ((-0.2, 0.1),)).start() == 0.0
    assert Arcs(False, ((3.0, 7.0),)).start() == 0.0  # wraps past a whole turn
    assert Arcs(False, ((0.5, 0.6), (1.0, 2.0))).start() == 1.5
    assert Arcs(False, ()).start() == 0.0


PARALLELOGRAM = {"ground": 0.1, "crank": 0.04, "coupler": 0.1, "rocker": 0.04}


def deviation(linkage, angles, speed=1.0):
    """Return the deviation of AB from parallel to the frame of a four-bar, in [m]."""
    points = linkage.solve(np.deg2rad(angles), speed).points
    along = points["B"].position - points["A"].position
    return np.abs(along - [linkage.ground, 0.0, 0.0]).max()


@pytest.mark.parametrize(
    ("angles", "speed", "branch"),
    [
        ([1, 90, 200, 359], 1.0, 1),
        ([0, 90, 200], 1.0, 1),
        ([0], 1.0, 1),
        ([361, 90, 200], 1.0, 1),
        ([359, 200, 90, 1], -1.0, -1),
        ([0, -90, -200], -1.0, -1),
        ([200, 300, 400], 1.0, -1),
        ([180, 170, 90], -1.0, 1),
        ([180, 190, 300], 1.0, -1),
    ],
)
def test_the_branch_selects_parallelogram_or_antiparallelogram(angles, speed, branch):
    assert deviation(ms.catalog.make("four_bar", **PARALLELOGRAM, branch=branch), angles, speed) <= 1e-15
    if len(angles) > 1:
        assert deviation(ms.catalog.make("four_bar", **PARALLELOGRAM, branch=-branch), angles, speed) > 0.01


@pytest.mark.parametrize("which", CHANGE_POINT_LINKAGES)
def test_the_branch_applies_to_the_loop_equations(which):
    linkage = CHANGE_POINT_LINKAGES[which]
    angles = 3.7 + np.linspace(0.0, 3.0, 12)
    off = largest_difference(ms.loops.solve(linkage, angles), linkage.solve(angles))
    assert off <= 1e-12 * linkage.mechanism.characteristic_length


def test_starting_at_an_angle_selects_the_assembly_mode():
    linkage = ms.catalog.make("four_bar", **PARALLELOGRAM)
    later = np.deg2rad([200.0, 300.0])
    kept = linkage.starting_at(np.deg2rad([1.0, 359.0]))
    assert np.abs(kept.positions(later)["B"] - linkage.positions(later)["B"]).max() > 0.01
    assert deviation(kept, [200.0, 300.0]) <= 1e-15
    assert {item.branch for item in kept.assemblies(4.0)} == {1, -1}
    positions = [points["B"] for _, points in kept.assembly_points(4.0)]
    assert np.abs(positions[0] - positions[1]).max() > 0.01


def test_the_start_does_not_matter_without_change_points():
    linkage = ms.catalog.make("four_bar")
    assert linkage.starting_at([3.0]) is linkage


def test_the_torque_belongs_to_the_first_assembly_mode():
    linkage = ms.catalog.make("four_bar", **PARALLELOGRAM, branch=-1)
    angles = np.deg2rad(np.linspace(195.0, 255.0, 7))
    model = ms.dynamics.dynamic_model(linkage, ms.Forces(gravity=(0.0, -9.81, 0.0)))
    own = ms.dynamics.prescribed(model, angles, 1e-6).forces.torque
    # the links of a parallelogram rise equally: the torque is the weight times a cosine
    assert np.abs(own / np.cos(angles) - own[0] / np.cos(angles[0])).max() <= 1e-9 * np.abs(own).max()
    other = ms.dynamics.dynamic_model(linkage.with_parameters(branch=1), model.forces)
    result = ms.dynamics.prescribed(other, angles, 1e-6).forces.torque
    assert np.abs(result / np.cos(angles) - own[0] / np.cos(angles[0])).max() > 0.1 * np.abs(own).max()
