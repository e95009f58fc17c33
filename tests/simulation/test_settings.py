"""Each setting declares its description, default, valid values, option and table row."""

from dataclasses import fields

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.simulation import Settings, settings

FIELDS = fields(Settings)
VALUES = {
    "integrator=Euler": "Euler",
    "steps_per_turn=50": 50,
    "solref=0.01,1": (0.01, 1.0),
    "solimp=0.9,0.99": (0.9, 0.99, 0.001, 0.5, 2.0),
    "refsafe=true": True,
    "iterations=7": 7,
}


@pytest.mark.parametrize(
    "item", [item for item in FIELDS if not isinstance(item.default, bool)], ids=lambda item: item.name
)
def test_every_setting_rejects_invalid_values_in_one_line(item) -> None:
    for wrong in ("none of them", np.nan, -1.0, (np.nan, 1.0)):
        with pytest.raises(InputError) as reported:
            Settings(**{item.name: wrong})
        assert "\n" not in str(reported.value)
        assert str(wrong) in str(reported.value)


@pytest.mark.parametrize("text", VALUES)
def test_a_setting_is_read_from_text(text) -> None:
    name, value = settings.setting_of(text)
    assert (name, value) == (text.partition("=")[0], VALUES[text])
    assert getattr(Settings(**{name: value}), name) != getattr(Settings(), name)
