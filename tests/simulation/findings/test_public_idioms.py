"""Intended idioms of public models give no finding; the corresponding fault does."""

from pathlib import Path

import mujoco
import pytest
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model

# a four-bar whose crank lies in line with its coupler, and a rocker with a motor
IN_LINE = model_text("public_idioms_in_line.xml")
SLIDES = model_text("public_idioms_slides.xml")


def violations_of(text, rule):
    return [violation for violation in ms.check(mujoco.MjSpec.from_string(text)) if violation.rule == rule]


@pytest.mark.long
def test_a_motor_at_a_dead_centre_start_is_no_redundant_actuator():
    assert not violations_of(IN_LINE, "MS201")
    other = '<motor name="second" joint="crank"/></actuator>'
    assert len(violations_of(IN_LINE.replace("</actuator>", other), "MS201")) == 1


def test_a_motor_on_a_locked_joint_is_redundant():
    locked = SLIDES.format(gravity="0 0 0").replace(' joint2="left"', "").replace("0 -1", "0 0")
    motors = '</equality><actuator><motor joint="right"/><motor joint="left"/></actuator>'
    assert [
        violation.object for violation in violations_of(locked.replace("</equality>", motors), "MS201")
    ] == ["actuator1"]


@pytest.mark.long
def test_the_first_keyframe_defines_the_start():
    qpos = ms.closed_qpos(mujoco.MjSpec.from_string(IN_LINE).compile(), {"crank": -1.0})[0]
    low, high = sorted((0.5 * qpos[2], 1.5 * qpos[2]))
    limited = IN_LINE.replace('name="rocker"', f'name="rocker" range="{low} {high}"')
    assert violations_of(limited, "MS105")
    key = f'<keyframe><key qpos="{" ".join(map(str, qpos))}"/></keyframe></mujoco>'
    assert not violations_of(limited.replace("</mujoco>", key), "MS105")
    opened = f'<keyframe><key qpos="{" ".join(map(str, qpos + 0.1))}"/></keyframe></mujoco>'
    assert violations_of(IN_LINE.replace("</mujoco>", opened), "MS102")


@pytest.mark.long
def test_a_ball_joint_locked_by_its_range_is_a_fault_only_in_a_loop():
    ball = '<joint name="ball" type="ball" range="0 0" limited="true"/>'
    outside = f'<body pos="0 0 1">{ball}<geom size=".1"/></body></worldbody>'
    assert not violations_of(IN_LINE.replace("</worldbody>", outside), "MS105")
    inside = IN_LINE.replace('<joint name="coupler" axis="0 0 1"/>', ball)
    assert [violation.object for violation in violations_of(inside, "MS105")] == ["ball"]


WELDED = model_text("public_idioms_welded.xml")


def test_constraints_without_effect_are_not_redundant():
    assert not violations_of(WELDED.format('<weld body1="a" body2="b" torquescale="0"/>'), "MS107")
    locked_pair = '<weld body1="b" body2="c"/>'
    assert not violations_of(WELDED.format(locked_pair + locked_pair), "MS107")
    twice = '<weld body1="a" body2="b"/>'
    assert violations_of(WELDED.format(twice + twice), "MS107")


@pytest.mark.long
@pytest.mark.parametrize("tilt", ["", ' euler="30 40 0"'])
def test_a_planar_loop_in_any_orientation_gives_only_a_note(tilt):
    text = IN_LINE.replace("<worldbody>", f"<worldbody><body{tilt}>").replace(
        "</worldbody>", "</body></worldbody>"
    )
    (redundant,) = violations_of(text.replace(' angle="radian"', ""), "MS107")
    assert redundant.severity == "note"


@pytest.mark.long
def test_an_unsupported_equality_gives_a_note():
    tendons = (
        '<tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>'
        '<equality><tendon name="taut" tendon1="t"/></equality></mujoco>'
    )
    (unchecked,) = violations_of(IN_LINE.replace("</mujoco>", tendons), "MS112")
    assert (unchecked.object, unchecked.severity) == ("taut", "note")
    assert not violations_of(IN_LINE, "MS112")


MESHED = model_text("public_idioms_meshed.xml")


def test_meshes_are_checked_for_collisions():
    assert not violations_of(MESHED.format(0.5), "MS106")
    assert violations_of(MESHED.format(0.05), "MS106")


def test_the_initial_force_of_a_servo_does_not_count_as_loop_compliance():
    servo = '</equality><actuator><position joint="left" kp="1000" ctrlrange="0 1"/></actuator>'
    offset = SLIDES.replace('name="left" type="slide"', 'name="left" type="slide" ref="0.1" damping="40"')
    # with an undetermined joint there is no test motion, so the forces at the start are checked
    undetermined_link = (
        '<body pos="3 0 0"><joint axis="0 0 1"/><geom size=".1" pos=".3 0 0"/></body></worldbody>'
    )
    offset = offset.replace("</worldbody>", undetermined_link)
    assert not violations_of(offset.format(gravity="0 0 -9.81").replace("</equality>", servo), "MS110")
    assert violations_of(offset.format(gravity="0 -9.81 0").replace("</equality>", servo), "MS110")


def test_an_object_with_included_files_is_checked(tmp_path):
    (tmp_path / "loops.xml").write_text(
        '<mujocoinclude><connect name="loop" site1="a" site2="b"/></mujocoinclude>'
    )
    main = IN_LINE.replace('<connect name="loop" site1="a" site2="b"/>', '<include file="loops.xml"/>')
    (tmp_path / "main.xml").write_text(
        main.replace('site name="b" pos="0 .08 0"', 'site name="b" pos="0 .09 0"')
    )
    spec = mujoco.MjSpec.from_file(str(tmp_path / "main.xml"))
    assert "MS102" in {violation.rule for violation in ms.check(spec)}


def test_the_actuator_of_a_soft_stop_drives_nothing():
    path = FOLDER / "soft_stop_is_no_motor_arm.toml"
    (finding,) = (each for each in ms.check(str(path)) if each.rule == "MS111")
    assert finding.message.startswith(
        "5 degrees of freedom, 3 of them undetermined with shoulder, elbow locked: wrist can still move"
    )


MODELS = Path(__file__).parents[3] / "models"


@pytest.mark.long
@pytest.mark.parametrize("name", ["bennett", "four_bar", "looper", "rrsrr", "rssr", "slider_crank"])
def test_catalogue_models_have_only_redundant_constraint_findings(name):
    result = findings(read_model(str(MODELS / f"{name}.xml")))
    # a planar linkage has a redundant constraint normal to its plane; Bennett's linkage is overconstrained
    repeats = [(item.object, item.value) for item in result if item.kind == "redundant"]
    assert len(result) == len(repeats)
    assert repeats == {
        "bennett": [("B, B+", 4)],
        "four_bar": [("loops", 1)],
        "slider_crank": [("loops", 1)],
    }.get(name, [])
