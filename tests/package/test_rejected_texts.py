"""Invalid texts of quantities, motion laws, expressions, ranges and measures: one line."""

import tomllib
from functools import cache

import numpy as np
import pytest
from model_files import FOLDER

import mechsim as ms
from mechsim.io.law_text import parse_motion_law
from mechsim.mechanism.expressions import compiled
from mechsim.mechanism.quantities import quantity
from mechsim.simulation.settings import setting_of
from mechsim.studies.sensitivity.tolerances import written_tolerances
from mechsim.studies.sweep.designs import parsed_range
from mechsim.studies.sweep.measures import measure
from mechsim.studies.sweep.sweeping import swept_designs

TABLES = tomllib.loads((FOLDER.parent / "rejected" / "texts.toml").read_text(encoding="utf-8"))


def reader(kind):
    """Return the function that reads a text of a kind; a unit may follow the kind."""
    name, _, unit = kind.rpartition(" ")
    return {
        "unit": lambda text: ms.units.parse(text, unit, "the crank"),
        "motion law": lambda text: parse_motion_law(text, "arm", unit, lambda: 0.3),
        "expression": lambda text: compiled(text, ("angle", "speed", "t")),
        "quantity": lambda text: quantity(text, ms.catalog.make("four_bar").mechanism),
        "setting": setting_of,
        "range": lambda text: parsed_range(text, "rssr", swept_designs("rssr")[1], sampled=False),
        "measure": lambda text: measure(text, ms.catalog.make("rssr").mechanism),
        "tolerance": lambda text: ms.tolerance_study(four_bar_table(), written_tolerances(text)),
    }[name or kind]


@cache
def four_bar_table():
    return ms.sensitivity("four_bar", "B.x", "all", angles=np.linspace(0.1, 0.3, 2))


@pytest.mark.parametrize(("kind", "row"), [(kind, row) for kind, rows in TABLES.items() for row in rows])
def test_an_invalid_text_is_rejected_in_one_line(kind, row):
    text, *words = row
    with pytest.raises(ms.InputError) as rejected:
        reader(kind)(text)
    message = str(rejected.value)
    assert "\n" not in message
    assert [word for word in words if word not in message] == []
