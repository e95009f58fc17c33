"""A table of 80 kg on scissors, moved by a screw of lead 5 mm after 104 revolutions."""

from pathlib import Path

import numpy as np
import pytest

import mechsim as ms

LIFT = Path(__file__).parents[1] / "models" / "scissor_lift.toml"
BAR, LEAD, GRAVITY = 0.6, 0.005, 9.81


@pytest.mark.long
def test_assemblies_keep_the_nut_where_it_is_threaded():
    # bars up or down, and the table towards either side of them
    every = ms.assemblies(str(LIFT), np.deg2rad(37440.0)).points
    listed = {tuple(points["top"][:2].round(9)) for points in every}
    height = np.sqrt(BAR**2 - (104 * LEAD) ** 2).round(9)
    assert listed == {(x, y) for x in (-0.2, 0.2) for y in (-height, height)}
