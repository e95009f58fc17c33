"""An option that has no effect in a mode of a command is an error; nothing is computed or written."""

from pathlib import Path

import numpy as np
import pytest
from typed_call import Call

from mechsim.cli.command import Stated
from mechsim.errors import InputError


def test_only_stated_options_are_excluded():
    stated = Stated({"speed": "--speed"})
    stated.exclude(["samples"], "in a run")
    with pytest.raises(InputError, match="--speed has no effect in a run"):
        stated.exclude(["samples", "speed"], "in a run")


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        ("return {'x': 1.0}", "returns dict"),
        ("return motion.nosuch", "ends in AttributeError"),
        ("return '3'", "returns str"),
    ],
)
def test_a_wrong_measure_ends_a_sweep(mechsim: Call, tmp_path: Path, function: str, reason: str):
    (tmp_path / "m.py").write_text(f"def f(motion):\n    {function}\n")
    sweep = "sweep four_bar --vary crank=3cm:3.1cm:2 --measure m.py:f -o s.csv --samples 9"
    code, _, err = mechsim(*sweep.split())
    assert code == 2
    assert reason in err
    assert not (tmp_path / "s.csv").exists()


def test_a_measure_without_value_at_one_design_does_not_end_a_sweep(mechsim: Call, tmp_path: Path):
    value = "math.sqrt(abs(motion.points['A'].position[0, 0]) - 0.0305)"
    (tmp_path / "m.py").write_text(f"import math\ndef f(motion):\n    return {value}\n")
    # the crank of 30 mm gives sqrt(-0.0005), that of 31 mm sqrt(0.0005)
    sweep = "sweep four_bar --vary crank=3cm:3.1cm:2 --measure m.py:f -o s.csv --samples 9"
    assert mechsim(*sweep.split())[0] == 0
    values = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True, dtype=None, encoding=None)
    assert np.isnan(values["mpyf"][0])
    assert values["mpyf"][1] == pytest.approx(np.sqrt(0.0005), rel=1e-9)
    assert list(values["outcome"]) == ["not measured", "passed"]


def test_a_sweep_whose_designs_all_fail_fails(mechsim: Call):
    sweep = "sweep four_bar --vary crank=30cm:31cm:2 --measure range:rocker -o s.csv --samples 9"
    code, out, _ = mechsim(*sweep.split())
    assert code == 1
    assert "no design can be measured" in out
