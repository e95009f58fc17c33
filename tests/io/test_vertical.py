"""The vertical of pictures: opposite to gravity, or as the file states."""

from dataclasses import replace

import pytest
from model_files import FOLDER, load_model

from mechsim.mechanism.mechanism import against
from mechsim.pictures.view.offline_page import page
from mechsim.report.views import mechanism_view
from mechsim.shapes import camera

# a crank about the vertical z axis with an arm that stays outside the plane of its tip
ARM = FOLDER / "vertical_arm.toml"


def test_a_mechanism_with_gravity_along_z_is_drawn_upright():
    mechanism = load_model(ARM.name, more="[forces]\ngravity = [0, 0, -9.81]").mechanism
    for preset in ("iso", "side"):
        _, up = camera.directions(mechanism, preset)
        assert up[2] > 0.7, preset


@pytest.mark.slow
def test_pages_and_pictures_accept_another_vertical(tmp_path, mechsim):
    view = mechanism_view(load_model(ARM.name), 1.0)
    assert page(view) != page(replace(view, up="z"))
    paths = [tmp_path / "y.png", tmp_path / "z.png"]
    for path in paths:
        words = ["render", str(ARM), "-o", str(path), "--up", path.stem, "--size", "64x48"]
        assert mechsim(*words).code == 0
    assert paths[0].read_bytes() != paths[1].read_bytes()
    for command, target in (("render", tmp_path / "no.png"), ("view", tmp_path / "no.html")):
        code, _, message = mechsim(command, "rssr", "-o", str(target), "--up", "w")
        assert code == 2
        assert "--up" in message
        assert "-z" in message
        assert not target.exists()


def test_zero_gravity_defines_no_vertical():
    assert against((0.0, 0.0, 0.0)) is None
