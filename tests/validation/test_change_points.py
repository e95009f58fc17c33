"""The study of change points, with a few linkages."""

import importlib.util
import sys
from pathlib import Path

import pytest

PATH = Path(__file__).parents[2] / "validation" / "robustness" / "change_points.py"


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("change_points", PATH)
    module = importlib.util.module_from_spec(spec)
    sys.modules["change_points"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("near", [False, True], ids=["flat", "nearly flat"])
@pytest.mark.parametrize("road", ["closed form", "loop equations", "MuJoCo, poses"])
def test_no_linkage_is_wrong_without_a_word(study, road, near):
    found = study.tallied(road, study.random_linkages(6, near, seed=3))
    assert (found.right, found.refused, found.wrong) == (6, 0, 0)


def test_a_road_that_folds_is_found_out(study, monkeypatch):
    monkeypatch.setitem(
        study.ROADS, "folding", lambda drive: drive.positions(study.ANGLES, through="fold")["B"]
    )
    assert study.tallied("folding", study.random_linkages(3, False)).wrong == 3
