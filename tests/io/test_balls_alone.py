"""Open chains of balls and universal joints, which have no coordinate, are validated and drawn."""

import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.errors import InputError, MobilityError
from mechsim.shapes.joints import link_shapes


@pytest.mark.parametrize(("kind", "axis"), [("spherical", ""), ("universal", ", axis = [0, 1, 0]")])
def test_the_first_joint_turns_about_one_axis(tmp_path, kind, axis):
    path = tmp_path / "pendulum.toml"
    path.write_text(model_text("balls_alone_pendulum.toml", kind=kind, axis=axis))
    solver = ms.load(str(path))
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


def test_a_run_from_an_initial_state_keeps_the_ball(tmp_path):
    path = tmp_path / "pendulum.toml"
    path.write_text(model_text("balls_alone_pendulum.toml", kind="spherical", axis=""))
    assert ms.load(str(path), still=True).mechanism.joints[0].kind == "spherical"


def test_initial_values_of_a_ball_that_is_driven_as_a_hinge_name_the_remedy(tmp_path):
    path = tmp_path / "pendulum.toml"
    text = model_text("balls_alone_pendulum.toml", kind="spherical", axis="")
    path.write_text(text + "\n[initial]\nball = { q = [0, 0, 1, 0] }\n")
    with pytest.raises(InputError, match=r"ball\.q is .*but the joint has one coordinate.*still=True"):
        ms.dynamics.run(ms.load(str(path)), duration=0.1)
    assert ms.dynamics.run(str(path), duration=0.01).motion.time[-1] == pytest.approx(0.01)


def test_requests_for_a_ball_without_a_driver_are_not_ignored(tmp_path):
    path = tmp_path / "pendulum.toml"
    path.write_text(model_text("balls_alone_pendulum.toml", kind="spherical", axis=""))
    with pytest.raises(InputError, match="has no coordinate 'nonsense' to drive"):
        ms.load(str(path), drive={"nonsense": "1rad/s"})
    solver = ms.load(str(path), track=["tip,ground@1,2,3"], duration=2.0)
    assert (list(solver.mechanism.points), solver.motion_laws.duration) == (["tip"], 2.0)


def test_an_undriven_ball_is_exported_as_a_ball_and_not_driven_in_a_live_page(tmp_path, mechsim):
    path, copy = tmp_path / "pendulum.toml", tmp_path / "copy.toml"
    path.write_text(model_text("balls_alone_pendulum.toml", kind="spherical", axis=""))
    model = mujoco.MjModel.from_xml_string(ms.export(str(path)).text)
    assert [int(kind) for kind in model.jnt_type] == [mujoco.mjtJoint.mjJNT_BALL]
    ms.export(str(path), copy, format="toml")
    assert ms.load(str(copy), still=True).mechanism.joints[0].kind == "spherical"
    code, _, err = mechsim("view", str(path), "--live", "-o", "a.html")
    assert (code, "nothing is driven, and --live moves drivers; leave it out" in err) == (2, True)


ROD_TOML = model_text("balls_alone_rod.toml")
ROD_XML = """<mujoco><worldbody><body name="a"><joint name="A" type="ball"/>
<geom size=".1" pos=".5 .1 0"/><site name="P" pos=".5 .1 0"/></body></worldbody>
<equality><connect body1="a" body2="world" anchor="1 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize(("name", "text"), [("rod.toml", ROD_TOML), ("rod.xml", ROD_XML)])
def test_a_loop_of_balls_is_driven_by_the_rotation_of_a_link(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=r"'a\.rx="):
        ms.load(str(path)).solve(t=np.linspace(0.0, 1.0, 9))
    motion = ms.load(str(path), drive={"a.rx": "0.3*sin(2*pi*t)"}).solve(t=np.linspace(0.0, 1.0, 9))
    angle = 0.3 * np.sin(2.0 * np.pi * motion.time)
    expected = np.transpose([np.full(9, 0.5), 0.1 * np.cos(angle), 0.1 * np.sin(angle)])
    np.testing.assert_allclose(motion.points["P"].position, expected, atol=1e-12)


# a bar hanging on two equal ropes: at rest its midpoint is at the lowest point of every path
BAR = model_text("balls_alone_bar.toml")


def test_what_moves_a_point_at_the_bottom_of_its_path_is_undetermined(file):
    path = file(BAR)
    law = {"P.y": "0.3*sin(2*pi*t)"}
    with pytest.raises(MobilityError, match=r"P\.x and P\.z can still move"):
        ms.load(path, drive=law).solve(t=np.linspace(0.0, 1.0, 5))
    solver = ms.load(path, drive=law, lock_others=True)
    height = solver.solve(t=np.array([0.0, 0.25])).points["P"].position[1, 2]
    # rope a is locked with its ball A: x^2 + (z + 1)^2 = 0.16, and x + z + 1 = 0.5 by the sphere about D
    assert height == pytest.approx(-0.75 - np.sqrt(0.0175), abs=1e-12)


# the same bar as MJCF: its ropes are rods with small inertias about their lines
BAR_XML = model_text("balls_alone_bar.xml")


@pytest.mark.long
def test_a_twin_in_mjcf_moves_alike_and_agrees_with_mujoco(file):
    path = file(BAR_XML)
    solver = ms.load(path, drive={"P.y": "0.3*sin(2*pi*t)"}, lock_others=True)
    height = solver.solve(t=np.array([0.0, 0.25])).points["P"].position[1, 2]
    assert height == pytest.approx(-0.75 - np.sqrt(0.0175), abs=1e-12)
    validation = ms.validate(solver)
    assert validation.passed, validation
    assert len(validation.checks) == 16


def test_the_equations_of_a_driven_link_are_not_drawn(file):
    path = file(ROD_TOML)
    drawn, driven = (
        link_shapes(ms.load(path, drive=laws, still=True).mechanism)
        for laws in ({}, {"a.rx": "0.3*sin(2*pi*t)"})
    )
    assert [len(shapes) for shapes in driven.values() if shapes] == [len(shapes) for shapes in drawn.values()]
