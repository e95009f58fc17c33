"""The initial configuration: the assembly mode of the guess, from which every method starts."""

from dataclasses import replace

import numpy as np
from model_files import changed_model, stated_mechanism

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
