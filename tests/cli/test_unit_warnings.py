import pytest

from mechsim.cli import exit_codes
from mechsim.cli.options import warn_about_angle, warn_about_angles, warn_about_parameters


@pytest.fixture(autouse=True)
def questions():
    exit_codes.questions.clear()
    yield exit_codes.questions
    exit_codes.questions.clear()


@pytest.mark.parametrize(
    ("text", "warns"), [("90", True), ("-45", True), ("1.57", False), ("90deg", False), ("", False)]
)
def test_an_angle_probably_in_degrees_gives_a_warning(text, warns, questions):
    warn_about_angle("--angle", text)
    assert len(questions) == warns
    assert not warns or f"was {text}deg meant?" in questions[0]


@pytest.mark.parametrize(("text", "warns"), [("0:360:5", True), ("0:6.28:0.1", False), ("0:360:5deg", False)])
def test_a_range_probably_in_degrees_gives_a_warning(text, warns, questions):
    warn_about_angles("--angles", text)
    assert len(questions) == warns


def test_unusual_parameter_values_give_a_warning(questions):
    warn_about_parameters(
        "four_bar", {"arm_angle": "45", "crank": "40", "rocker": "60mm", "ground": "0.2", "branch": "-1"}
    )
    first, second = questions
    assert "arm_angle=45deg" in first
    assert "crank=40mm" in second
