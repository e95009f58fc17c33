"""Open chains of balls and universal joints, which have no coordinate, are validated and drawn."""

import mujoco
import numpy as np
import pytest
from model_files import FOLDER, changed_model, load_model

import mechsim as ms
from mechsim.shapes.joints import link_shapes


@pytest.mark.parametrize(("kind", "axis"), [("spherical", ""), ("universal", ", axis = [0, 1, 0]")])
def test_the_first_joint_turns_about_one_axis(kind, axis):
    solver = load_model("balls_alone_pendulum.toml", kind=kind, axis=axis)
    assert any("turns once about one oblique axis" in fact for fact in solver.facts)
    motion = solver.solve(t=np.linspace(0.0, 1.0, 9))
    start, end = motion.points["C"].position[[0, -1]]
    assert start == pytest.approx(end, abs=1e-12)
    if kind == "spherical":
        # Rodrigues' formula about (1, 2, 3)
        axis_, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0), 2.0 * np.pi * motion.time
        point = np.array([1.0, 0.0, 0.0])
        expected = (
            np.outer(np.cos(angle), point)
            + np.outer(np.sin(angle), np.cross(axis_, point))
            + np.outer(1.0 - np.cos(angle), axis_ * (axis_ @ point))
        )
        np.testing.assert_allclose(motion.points["C"].position, expected, atol=1e-12)
    validation = ms.validate(solver)
    assert validation.passed
    assert len(validation.checks) > 5


def test_an_undriven_ball_is_exported_as_a_ball_and_not_driven_in_a_live_page(mechsim):
    path = changed_model("balls_alone_pendulum.toml", kind="spherical", axis="")
    model = mujoco.MjModel.from_xml_string(ms.export(path).text)
    assert [int(kind) for kind in model.jnt_type] == [mujoco.mjtJoint.mjJNT_BALL]
    code, _, err = mechsim("view", path, "--live", "-o", "a.html")
    assert (code, "nothing is driven, and --live moves drivers; leave it out" in err) == (2, True)


@pytest.mark.long
def test_a_twin_in_mjcf_moves_alike_and_agrees_with_mujoco():
    # the ropes of the bar are rods with small inertias about their lines
    solver = ms.load(FOLDER / "balls_alone_bar.xml", drive={"P.y": "0.3*sin(2*pi*t)"}, lock_others=True)
    height = solver.solve(t=np.array([0.0, 0.25])).points["P"].position[1, 2]
    assert height == pytest.approx(-0.75 - np.sqrt(0.0175), abs=1e-12)
    validation = ms.validate(solver)
    assert validation.passed, validation
    assert len(validation.checks) == 16


def test_the_equations_of_a_driven_link_are_not_drawn():
    drawn, driven = (
        link_shapes(ms.load(FOLDER / "balls_alone_rod.toml", drive=laws, still=True).mechanism)
        for laws in ({}, {"a.rx": "0.3*sin(2*pi*t)"})
    )
    assert [len(shapes) for shapes in driven.values() if shapes] == [len(shapes) for shapes in drawn.values()]
