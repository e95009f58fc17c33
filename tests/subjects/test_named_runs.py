"""A name does in Python what it does on the command line."""

import numpy as np
import pytest

import mechsim as ms
from mechsim import catalog
from mechsim.subjects import gallery


@pytest.mark.parametrize("name", ["four_bar", "klann"])
def test_a_name_is_simulated_as_its_mechanism(name):
    named = ms.simulate(name, speed="60rpm", turns=0.1)
    loaded = ms.simulate(ms.load(name), speed="60rpm", turns=0.1)
    for point, track in loaded.motion.points.items():
        np.testing.assert_array_equal(named.motion.points[point].position, track.position)


def test_a_toml_file_is_simulated_with_its_own_motion_laws(tmp_path):
    text = gallery.files()["five_bar"].read_text().partition("[formula]")[0]
    (tmp_path / "robot.toml").write_text(text)
    run = ms.simulate(tmp_path / "robot.toml", samples=5)
    assert set(run.motion.drivers) == set(ms.load("five_bar").mechanism.drivers)


def test_an_mjcf_text_is_simulated_unchanged():
    text = """<mujoco><worldbody><body><joint name="crank"/><geom size="0.1"/><site name="P" pos="1 0 0"/>
    </body></worldbody></mujoco>"""
    assert ms.simulate(text, speed=1.0, turns=0.1).motion.points.keys() == {"P"}


@pytest.mark.parametrize("of", [ms.load, lambda name: ms.simulate(name, speed=1.0)])
def test_an_unknown_name_lists_catalogue_and_gallery(of):
    with pytest.raises(ms.InputError, match="there is no mechanism 'nope'") as error:
        of("nope")
    listed = str(error.value).partition("known are ")[2].split(", ")
    assert set(listed) == {*catalog.DRIVES, *gallery.files()}


def test_of_two_equally_similar_names_that_of_the_catalogue_is_suggested():
    with pytest.raises(ms.InputError, match="did you mean 'rssr'"):
        ms.load("rsr")


def test_forces_with_a_name_are_rejected_in_one_sentence():
    with pytest.raises(
        ms.InputError, match=r"is of type str; give what mechsim.load or catalog.make returns"
    ):
        ms.dynamics.dynamic_model("four_bar")
