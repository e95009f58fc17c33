"""Old spellings of `mechsim dynamics`, when it was one command, get the present one; its completion."""

import os
import subprocess
import sys

import pytest

OLD = {
    "four_bar": "inverse four_bar",
    "four_bar --speed 600rpm --method none": "inverse four_bar --speed 600rpm --method none",
    "four_bar --statics --initial crank.q=1rad": "statics four_bar --initial crank.q=1rad",
    "--statics four_bar": "statics four_bar",
    "four_bar --modes": "modes four_bar",
    "four_bar --response crank:B.x --json": "response four_bar crank:B.x --json",
    "four_bar --initial crank.q=1rad --duration 1s": "forward four_bar --initial crank.q=1rad --duration 1s",
    "four_bar --initial=crank.q=1rad": "forward four_bar --initial=crank.q=1rad",
    "four_bar --motor constant:1 --turns 2": "forward four_bar --motor constant:1 --turns 2",
    "bennett --free --speed 60rpm": "forward bennett --initial crank.v=60rpm",
}


@pytest.mark.parametrize("old", OLD)
def test_an_old_spelling_gets_the_present_one(mechsim, old):
    code, out, error = mechsim("dynamics", *old.split())
    assert (code, out) == (2, "")
    assert error.count("\n") == 1
    assert error.endswith(f"write: mechsim dynamics {OLD[old]}\n")


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "expected"), [("dynamics ", "forward"), ("dynamics inverse four_b", "four_bar")]
)
def test_a_shell_completes_analyses_and_their_models(words, expected):
    environment = os.environ | {
        "_MECHSIM_COMPLETE": "complete_bash",
        "COMP_WORDS": f"mechsim {words}",
        "COMP_CWORD": str(len(words.split(" "))),
    }
    line = "import sys; sys.argv = ['mechsim']; from mechsim.cli import main; main()"
    completed = subprocess.run([sys.executable, "-c", line], env=environment, capture_output=True, text=True)
    assert expected in completed.stdout.split()
