"""Masses used for torques are listed with their source."""

from model_files import FOLDER

import mechsim as ms
from mechsim.mechanism.masses import masses_of, summary, with_inertia


def test_a_massless_link_of_a_scene_is_listed_as_zero():
    # a massless link next to one with mass
    solver = ms.load(FOLDER / "masses_scene.xml", lock={"tip": 0.0})
    assert {item.link: item.source for item in masses_of(solver.mechanism)} == {"arm": "given", "tip": "zero"}
    assert summary(masses_of(solver.mechanism)) == "masses: arm given, 2 kg; tip zero in the file"


def test_rods_of_another_material_are_listed_with_their_density():
    mechanism = with_inertia(ms.catalog.make("four_bar").mechanism, 2700.0)
    assert "2700 kg/m3 rods" in summary(masses_of(mechanism))
    assert "steel" in summary(masses_of(with_inertia(ms.catalog.make("four_bar").mechanism)))
