import pytest
from model_files import model_text

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


def test_unit_warnings_accompany_results_and_rejections(mechsim):
    output = mechsim("solve", "four_bar", "--angles", "0:1:0.5", "--set", "arm_angle=45")
    assert output.code == 0
    assert output.err.splitlines() == ["mechsim: --set arm_angle=45 is 45 rad; was arm_angle=45deg meant?"]
    rejected = mechsim(
        "solve", "four_bar", "--angles", "0:1:0.5", "--set", "crank=40", "--set", "arm_angle=45"
    )
    assert rejected.code == 2
    assert rejected.err.count("\n") == 1
    assert "was crank=40mm meant?" in rejected.err
    assert "change the dimensions" in rejected.err


IN_DEGREES = model_text("unit_warnings_in_degrees.xml")


RUN = "dynamics forward arm.xml --initial j2.q=0.1 --duration 0.01s --samples 2 --json --method none"


@pytest.mark.parametrize(
    "command",
    [
        f"{RUN} --initial j1.q=",
        f"{RUN} --start j1=",
        "solve arm.xml --drive j2=1rad/s --samples 2 --json --lock j1=",
    ],
)
def test_an_angle_above_a_turn_needs_its_unit(mechsim, tmp_path, command):
    (tmp_path / "arm.xml").write_text(IN_DEGREES)

    def answer(value):
        return mechsim(*f"{command}{value}".split())

    rejected = answer("30")
    assert rejected.code == 2
    assert "write 30deg, or 30rad" in rejected.err
    degrees, radians = answer("30deg"), answer("0.5235987755982988")
    assert (degrees.code, radians.code) == (0, 0)
    assert degrees.out == radians.out
