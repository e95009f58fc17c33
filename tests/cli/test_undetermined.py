"""What is said of a motion that its drivers do not settle can be done, whatever command says it."""

import pytest
from scene_texts import FINGER

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
    assert "undetermined" in answer.err
    assert "mechsim simulate --method step" in answer.err
    assert "swing" in answer.err


def test_a_run_in_time_and_a_hold_both_settle_it(mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    assert mechsim("simulate", *DRIVE, "--method", "step").code in (0, 1)
    assert mechsim("solve", *DRIVE, "--hold", "swing").code == 0
