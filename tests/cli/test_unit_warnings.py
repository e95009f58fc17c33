import pytest

from mechsim.cli import exit_codes
from mechsim.cli.options import warn_about_angle, warn_about_angles, warn_about_parameters


@pytest.fixture(autouse=True)
def questions():
    exit_codes.questions.clear()
    yield exit_codes.questions
    exit_codes.questions.clear()


@pytest.mark.parametrize(
    ("text", "asks"), [("90", True), ("-45", True), ("1.57", False), ("90deg", False), ("", False)]
)
def test_an_angle_that_is_probably_in_degrees_is_requested_back(text, asks, questions):
    warn_about_angle("--angle", text)
    assert len(questions) == asks
    assert not asks or f"was {text}deg meant?" in questions[0]


@pytest.mark.parametrize(("text", "asks"), [("0:360:5", True), ("0:6.28:0.1", False), ("0:360:5deg", False)])
def test_a_range_of_angles_likewise(text, asks, questions):
    warn_about_angles("--angles", text)
    assert len(questions) == asks


def test_parameters_far_from_what_is_usual_are_requested_back(questions):
    warn_about_parameters(
        "four_bar", {"arm_angle": "45", "crank": "40", "rocker": "60mm", "ground": "0.2", "branch": "-1"}
    )
    first, second = questions
    assert "arm_angle=45deg" in first
    assert "crank=40mm" in second


def test_they_stand_next_to_a_result_and_in_the_one_line_of_a_rejection(mechsim):
    output = mechsim("solve", "four_bar", "--angles", "0:1:0.5", "--set", "arm_angle=45")
    assert output.code == 0
    assert output.err.splitlines() == ["mechsim: --set arm_angle=45 is 45 rad; was arm_angle=45deg meant?"]
    refused = mechsim(
        "solve", "four_bar", "--angles", "0:1:0.5", "--set", "crank=40", "--set", "arm_angle=45"
    )
    assert refused.code == 2
    assert refused.err.count("\n") == 1
    assert "was crank=40mm meant?" in refused.err
    assert "change the dimensions" in refused.err
