"""Curves and cams are drawn where they are."""

import numpy as np
from model_files import model_text

import mechsim as ms
from mechsim.shapes.joints import link_shapes

MODEL = model_text("guides_model.toml")


def test_profiles_curves_and_rollers_are_drawn_without_the_links_of_their_equations(tmp_path):
    (tmp_path / "drawn.toml").write_text(MODEL)
    mechanism = ms.load(str(tmp_path / "drawn.toml"), still=True).mechanism
    shapes = link_shapes(mechanism)
    assert [name for name, drawn in shapes.items() if name.startswith("~") and drawn] == []
    # points of the ellipse, and the ends of the lift
    rail = np.array([shape.frm[:2] for shape in shapes["ground"] if shape.kind == "capsule"])
    assert np.abs(((rail - [0.1, 0.0]) / [0.01, 0.02]) ** 2 @ [1.0, 1.0] - 1.0).max() < 1e-12
    profile = np.array([shape.frm[:2] for shape in shapes["cam"] if shape.kind == "capsule"])
    assert len(profile) == len(rail) == 90
    # lowest and highest radius of the profile: 25 and 35 mm
    assert np.abs(profile[0] - [0.0, 0.025]).max() < 1e-12
    assert np.abs(profile[45] - [0.0, -0.035]).max() < 1e-12
    assert profile[20, 0] > 0.0
    assert [shape.sizes[0] for shape in shapes["ram"] if shape.kind == "cylinder"] == [0.006]
