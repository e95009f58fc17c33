"""Mechanisms in TOML files: contents are read in their units, and invalid ones are rejected."""

import numpy as np
from model_files import model_text

import mechsim as ms

FOUR_BAR = model_text("toml_reader_four_bar.toml")


def test_a_four_bar_file_agrees_with_the_closed_form(file):
    read = ms.load(file(FOUR_BAR))
    exact = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.09)
    angles = np.linspace(-3.0, 7.0, 41)
    result, expected = read.solve(angles, 3.0, -2.0), exact.solve(angles, 3.0, -2.0)
    for name in ("A", "B"):
        np.testing.assert_allclose(result.points[name].position, expected.points[name].position, atol=1e-14)
        np.testing.assert_allclose(
            result.points[name].acceleration, expected.points[name].acceleration, atol=1e-11
        )
    assert read.crank_range().full
    coupler = next(link for link in read.mechanism.links if link.name == "coupler")
    assert coupler.outline[1] == (0.06, 0.03, 0.0)
    assert coupler.inertia is not None
    assert (coupler.inertia.mass, coupler.inertia.centre) == (0.4, (0.06, 0.0, 0.0))
    assert np.diag(coupler.inertia.matrix).tolist() == [1e-6, 3e-6, 3e-6]


def test_a_file_called_like_a_catalogue_mechanism_does_not_shadow_it(tmp_path, monkeypatch):
    (tmp_path / "rssr").write_text(FOUR_BAR)
    monkeypatch.chdir(tmp_path)
    assert ms.load("rssr") == ms.catalog.make("rssr")
