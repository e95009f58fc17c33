"""Scenes that this project makes itself are sound, and are not accused."""

from pathlib import Path

import pytest

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader import read_model

MODELS = Path(__file__).parents[3] / "models"


@pytest.mark.parametrize("name", ["bennett", "four_bar", "looper", "rrsrr", "rssr", "slider_crank"])
def test_a_scene_of_the_catalogue_is_reported_of_nothing_but_rows_that_repeat(name):
    result = findings(read_model(str(MODELS / f"{name}.xml")))
    # a flat linkage has a row across its plane, and Bennett's are overconstrained
    repeats = [(item.what, item.by) for item in result if item.kind == "redundant"]
    assert len(result) == len(repeats)
    assert repeats == {
        "bennett": [("B, B+", 4)],
        "four_bar": [("loops", 1)],
        "slider_crank": [("loops", 1)],
    }.get(name, [])
