"""What is said of a motion that its drivers do not settle can be done, whatever command says it."""

import pytest
from scene_texts import FINGER

from mechsim import files

# a five-bar of which one arm is driven
ONE_DRIVER = """
name = "five"
drivers = ["left"]
start = 2.0
[joints]
left = { kind = "revolute", a = { link = "ground", at = [-0.03, 0, 0] }, b = { link = "arm_l" } }
right = { kind = "revolute", a = { link = "ground", at = [0.03, 0, 0] }, b = { link = "arm_r" } }
elbow_l = { kind = "revolute", a = { link = "arm_l", at = [0.06, 0, 0] }, b = { link = "fore_l" } }
elbow_r = { kind = "revolute", a = { link = "arm_r", at = [0.06, 0, 0] }, b = { link = "fore_r" } }
[joints.tool]
kind = "revolute"
a = { link = "fore_l", at = [0.08, 0, 0] }
b = { link = "fore_r", at = [0.08, 0, 0] }
[points]
P = { link = "fore_l", at = [0.08, 0, 0] }
[guess]
arm_r = { at = [0.03, 0, 0], turn = { axis = [0, 0, 1], angle = 1.0 } }
"""
DRIVE = ("finger.xml", "--drive", "knuckle=0.2*sin(2*pi*t)")


@pytest.mark.parametrize(
    "words",
    [
        ("solve",),
        ("validate",),
        ("simulate", "--method", "pose"),
        ("render", "-o", "x.png"),
        ("plot", "-o", "x.svg"),
        ("dynamics",),
        ("sensitivity", "--of", "elbow"),
    ],
    ids=lambda words: words[0],
)
def test_the_remedy_named_is_one_that_the_command_has(words, mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    answer = mechsim(words[0], *DRIVE, *words[1:])
    assert answer.code == 2
    assert "underdetermined" in answer.err
    assert "mechsim simulate --method step" in answer.err
    assert "swing" in answer.err


def test_a_run_in_time_and_a_hold_both_settle_it(mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    assert mechsim("simulate", *DRIVE, "--method", "step").code in (0, 1)
    assert mechsim("solve", *DRIVE, "--lock", "swing").code == 0


def test_a_crank_that_leaves_something_open_runs_in_time_from_where_it_starts(mechsim, tmp_path):
    (tmp_path / "five.toml").write_text(ONE_DRIVER)
    answer = mechsim("simulate", "five.toml", "--method", "step", "--turns", "0.02", "-o", "run.csv")
    assert (answer.code, "PASS" in answer.out) == (0, True)
    assert files.read(str(tmp_path / "run.csv"))["angle"][0] == pytest.approx(2.0, abs=1e-12)
    assert "right can still move" in mechsim("solve", "five.toml", "--angles", "2").err
