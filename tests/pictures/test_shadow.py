"""Solids cast a shadow on the wall on which a mechanism stands, and on no other."""

import numpy as np
import pytest
from drawing import draws

import mechsim as ms
from mechsim.pictures import render
from mechsim.pictures.render.drawing import Source

ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
LINKAGE = ms.catalog.make("rssr")
MOTION = LINKAGE.solve(ANGLES, 60.0)


@pytest.mark.parametrize("look", [{"camera": "shaft"}, {"overlay": 4}])
def test_other_views_have_no_wall_shadow(look):
    source = Source(LINKAGE.mechanism, MOTION)
    assert not source.drawn(ms.Look(**look)).stands_on_wall
    assert source.drawn(ms.Look()).stands_on_wall


@draws
def test_a_mechanism_on_a_wall_darkens_it(monkeypatch):
    def picture():
        plain = {"size": (320, 240), "labels": False, "notes": False, "paths": False}
        return render.still(LINKAGE.mechanism, MOTION, **plain).astype(int).sum(2) / 3.0

    shadowed = picture()
    monkeypatch.setattr("mechsim.pictures.render.drawn_model.DrawnModel.stands_on_wall", False)
    lit = picture()
    darker = lit - shadowed > 20.0
    # a half to ten percent of the picture, and nothing is brighter
    assert 0.005 < darker.mean() < 0.1
    assert (shadowed - lit > 20.0).mean() < 0.001
