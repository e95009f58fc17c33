"""Files with numbers that no model has, and loops of a second file, in `map`, `sample` and `dynamics`."""

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from model_files import model_text, replaced
from processes import python

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled

TREE = model_text("hostile_files_tree.urdf")
LOOPS = "closed_loop: [[end, follower_tip]]\ntype: [3d]\nname_mot: [motor]\njoint_name: []\njoint_type: []\n"
MAP = ["map", "tree.urdf", "--loops", "loops.yaml", "--from", "motor=0:0.5", "--to", "hip", "-o", "out.npz"]


def changed(folder, name, *changes):
    """Return the path of a copy of a model in `models/` with replaced texts."""
    path = folder / f"f{Path(name).suffix}"
    path.write_text(replaced((Path(__file__).parents[2] / "models" / name).read_text(), changes))
    return str(path)


def test_a_map_of_a_urdf_file_takes_the_loops_of_a_second_file(mechsim, tmp_path):
    (tmp_path / "tree.urdf").write_text(TREE.format(axis="1", mimic=""))
    (tmp_path / "loops.yaml").write_text(LOOPS)
    assert mechsim(*MAP, "--points", "5").code == 0
    with np.load(tmp_path / "out.npz") as table:
        motor, hip = table["input"][:, 0], table["output"][:, 0]
    # rod from the crank's pin to the follower's end
    pin = 0.3 * np.stack([-np.sin(motor), np.cos(motor)], 1)
    end = [1.0, 0.0] + 0.7 * np.stack([-np.sin(hip), np.cos(hip)], 1)
    assert np.linalg.norm(end - pin, axis=1) == pytest.approx(np.ones(5), abs=1e-9)


def test_a_key_of_many_names_is_rejected(mechsim, tmp_path):
    """A key of 100,000 names costs minutes in Python's reader."""
    (tmp_path / "f.toml").write_text("a." * 100_000 + "a = 1")
    shown = mechsim("show", "f.toml")
    assert shown.code == 2
    assert "nests too deep" in shown.err
    assert len(shown.err) < 1000


@pytest.mark.long
@pytest.mark.parametrize("name", ["rocker+", "other"])
def test_two_connects_of_a_hinge_of_a_file_agree_with_mujoco(mechsim, tmp_path, name):
    """mechsim writes a cut hinge as connects `rocker` and `rocker+`, which are joints of the file it reads.

    Both methods agree unless the second pair is counted for the first joint.
    """
    text = to_xml(assembled(ms.catalog.make("rssr").mechanism, ms.Scene(cut=("rocker",))))
    text = re.sub(' armature="[^"]*"', "", text).replace('gravity="0 0 0"', 'gravity="0 0 -9.81"')
    assert '<connect name="rocker+"' in text
    (tmp_path / "f.xml").write_text(text.replace('<connect name="rocker+"', f'<connect name="{name}"'))
    motion = ["--drive", "crank=1rad/s", "--duration", "0.2s", "--samples", "12"]
    shown = mechsim("dynamics", "inverse", "f.xml", *motion, "--json")
    assert shown.code == 0
    assert json.loads(shown.out)["passed"]


@pytest.mark.parametrize("arguments", [["show", "f\udcff.xml"], ["export", "four_bar", "-o", "f\udcff.xml"]])
def test_a_file_name_that_is_not_text_is_rejected(mechsim, tmp_path, arguments):
    if arguments[0] == "show":
        (tmp_path / arguments[1]).write_text(model_text("finger.xml"))
    before = {*tmp_path.iterdir()}
    shown = mechsim(*arguments)
    assert shown.code == 2
    assert "'f\\udcff.xml' is not text in UTF-8" in shown.err
    assert {*tmp_path.iterdir()} == before


@pytest.mark.long
def test_a_link_stated_far_away_does_not_close(mechsim, tmp_path):
    """With a slide stated 1e12 mm off its guide, the damped equations are singular to rounding."""
    stated = 'yoke = { at = ["crank", 0'
    path = changed(tmp_path, "gallery/scotch_yoke.toml", (stated, stated[:-1] + "1e12"))
    shown = mechsim("simulate", path, "--method", "pose", "--samples", "7")
    assert shown.code == 2
    assert "the loops do not close" in shown.err


@pytest.mark.long
@pytest.mark.parametrize(
    ("link", "changes"),
    [
        ("coupler", [(" -0.009929947882008797 0", " 1e12 0"), ('"0.032 0 0" />', '"0.048 0 0" />')]),
        ("crank", [('"0.003 0 0"', '"0.003 1e12 0"'), ("0.013703586526268186", "0")]),
    ],
)
def test_a_mass_stated_far_away_is_reported_without_a_warning(tmp_path, link, changes):
    """Its weight opens gaps whose squares, or themselves, are beyond the largest number."""
    path = changed(tmp_path, "looper.xml", *changes)
    shown = python("-W", "error", "-m", "mechsim", "check", path)
    assert (shown.returncode, shown.stderr) == (1, "")
    assert f"body {link} has its centre of mass 1e+12 m from its origin" in shown.stdout


@pytest.mark.long
def test_loops_that_close_only_within_rounding_end_in_seconds(mechsim, tmp_path):
    """Beyond a slide's range the residual of an inclined guide grows too slowly to be noticed at once."""
    inclined = ('axis="1 0 0"', 'axis="1 0 0.9996872555384282"'), ('"0.05 0 0" />', '"0.05000005 0 0" />')
    path = changed(tmp_path, "slider_crank.xml", *inclined)
    start = time.process_time()
    assert mechsim("check", path).code == 0
    # it took more than 60 s
    assert time.process_time() - start < 20.0
