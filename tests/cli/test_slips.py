import pytest

from mechsim import catalog
from mechsim.cli.slips import asked_angle, asked_angles, asked_parameters


def told(capsys):
    return capsys.readouterr().err.splitlines()


@pytest.mark.parametrize(
    ("text", "asks"), [("90", True), ("-45", True), ("1.57", False), ("90deg", False), ("", False)]
)
def test_an_angle_that_is_probably_in_degrees_is_asked_back(text, asks, capsys):
    asked_angle("--angle", text)
    said = told(capsys)
    assert len(said) == asks
    assert not asks or f"was {text}deg meant?" in said[0]


@pytest.mark.parametrize(("text", "asks"), [("0:360:5", True), ("0:6.28:0.1", False), ("0:360:5deg", False)])
def test_a_range_of_angles_likewise(text, asks, capsys):
    asked_angles("--angles", text)
    assert len(told(capsys)) == asks


def test_parameters_far_from_what_is_usual_are_asked_back(capsys):
    drive = catalog.make("four_bar")
    asked_parameters(
        drive, {"arm_angle": "45", "crank": "40", "rocker": "60mm", "ground": "0.2", "branch": "-1"}
    )
    first, second = told(capsys)
    assert "arm_angle=45deg" in first
    assert "crank=40mm" in second
