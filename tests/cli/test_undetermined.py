"""The remedies that commands suggest for an underdetermined motion work."""

import pytest
from model_files import model_text
from scene_texts import FINGER

from mechsim import files

# a five-bar with one driven arm
ONE_DRIVER = model_text("undetermined_one_driver.toml")
DRIVEN_FINGER = ("finger.xml", "--drive", "knuckle=0.2*sin(2*pi*t)")


@pytest.mark.parametrize(
    "arguments",
    [
        ("solve",),
        ("validate",),
        ("simulate", "--method", "pose"),
        ("render", "-o", "x.png"),
        ("plot", "-o", "x.svg"),
        ("dynamics inverse",),
        ("sensitivity", "--of", "elbow"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_an_underdetermined_motion_is_rejected_with_a_remedy(arguments, mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    answer = mechsim(*arguments[0].split(), *DRIVEN_FINGER, *arguments[1:])
    assert answer.code == 2
    assert "underdetermined" in answer.err
    assert "mechsim simulate --method step" in answer.err
    assert "swing" in answer.err


def test_an_underdetermined_crank_is_stepped_from_its_start(mechsim, tmp_path):
    (tmp_path / "five.toml").write_text(ONE_DRIVER)
    answer = mechsim("simulate", "five.toml", "--method", "step", "--turns", "0.02", "-o", "run.csv")
    assert (answer.code, "PASS" in answer.out) == (0, True)
    assert files.read(str(tmp_path / "run.csv"))["angle"][0] == pytest.approx(2.0, abs=1e-12)
    assert "right can still move" in mechsim("solve", "five.toml", "--angles", "2").err
