"""Names of mechanisms mean the same in Python as on the command line."""

import numpy as np
import pytest

import mechsim as ms


@pytest.mark.parametrize("name", ["four_bar", "klann"])
def test_a_name_gives_the_run_of_its_mechanism(name):
    named = ms.simulate(name, speed="60rpm", turns=0.1)
    loaded = ms.simulate(ms.load(name), speed="60rpm", turns=0.1)
    for point, track in loaded.motion.points.items():
        np.testing.assert_array_equal(named.motion.points[point].position, track.position)


def test_a_file_that_no_reader_accepts_names_its_conversion(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").touch()
    (tmp_path / "picture.gif").touch()
    macros = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="w"/></robot>'
    (tmp_path / "robot.urdf").write_text(macros)
    for name, remedy in (
        ("arm", "'arm.toml'"),
        ("robot.xacro", "xacro FILE.xacro -o FILE.urdf"),
        ("robot.urdf", "xacro"),
        ("picture.gif", r"\.toml, \.xml, \.urdf"),
        (".", "folder"),
    ):
        with pytest.raises(ms.InputError, match=remedy):
            ms.load(name)
