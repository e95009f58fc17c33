"""Sweeps over the arguments of a function in a Python file."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.sweep.designs import parsed_range
from mechsim.studies.sweep.sweeping import swept_designs

FILE = """
import mechsim as ms

def scaled(crank=0.03, *, ratio=1.0, branch=1, mark="none"):
    return ms.catalog.make("four_bar", crank=ratio * crank, branch=branch)

still = scaled()
"""


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE, encoding="utf-8")
    return f"{path}:scaled"


def test_arguments_with_numeric_defaults_are_parameters(model):
    parameters = swept_designs(model)[1]
    assert [*parameters] == ["crank", "ratio", "branch"]
    assert parsed_range("crank=20mm:3cm:2", model, parameters, sampled=False)[1].tolist() == [0.02, 0.03]
    assert parsed_range("ratio=1,2", model, parameters, sampled=False)[1].tolist() == [1.0, 2.0]
    # the names equal parameters of the four-bar, but the function defines their effect
    result = ms.sweep(model, {"crank": [0.02], "ratio": [1.0, 2.0]}, "range:rocker", set={"branch": -1})
    expected = ms.sweep("four_bar", {"crank": [0.02, 0.04]}, "range:rocker", set={"branch": -1})
    np.testing.assert_allclose(result["range:rocker"].values[0], expected["range:rocker"], rtol=1e-12)
    assert ms.load(model, {"crank": "25mm"}).crank == 0.025


def test_an_unknown_argument_is_rejected(model):
    for name in ("krank", "mark"):
        with pytest.raises(ms.InputError, match=f"no parameter '{name}'.* choose from crank, ratio, branch"):
            ms.load(model, {name: "1"})
    with pytest.raises(ms.InputError, match="no parameter 'krank' to vary"):
        ms.sweep(model, {"krank": [1.0]}, "range:rocker")
    with pytest.raises(ms.InputError, match="has no parameters"):
        ms.load(model.replace("scaled", "still"), {"crank": "1"})


def test_a_changed_file_is_read_again(model, tmp_path):
    ms.sweep(model, {"crank": [0.02]}, "range:rocker")
    path = tmp_path / "mine.py"
    path.write_text(FILE.replace("ratio * crank", "ratio * crank + 0.001"), encoding="utf-8")
    changed = ms.sweep(model, {"crank": [0.02]}, "range:rocker")
    expected = ms.sweep("four_bar", {"crank": [0.021]}, "range:rocker")
    assert float(changed["range:rocker"][0]) == pytest.approx(float(expected["range:rocker"][0]), rel=1e-12)
