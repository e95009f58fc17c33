"""Catalogue models are valid and have no findings except redundant constraints."""

from pathlib import Path

import pytest

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model

MODELS = Path(__file__).parents[3] / "models"


@pytest.mark.long
@pytest.mark.parametrize("name", ["bennett", "four_bar", "looper", "rrsrr", "rssr", "slider_crank"])
def test_catalogue_models_have_only_redundant_constraint_findings(name):
    result = findings(read_model(str(MODELS / f"{name}.xml")))
    # a planar linkage has a redundant constraint normal to its plane; Bennett's linkage is overconstrained
    repeats = [(item.object, item.value) for item in result if item.kind == "redundant"]
    assert len(result) == len(repeats)
    assert repeats == {
        "bennett": [("B, B+", 4)],
        "four_bar": [("loops", 1)],
        "slider_crank": [("loops", 1)],
    }.get(name, [])
