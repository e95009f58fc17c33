"""Files with numbers that no model has, and loops of a second file, in `map`, `sample` and `dynamics`."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled

TREE = model_text("hostile_files_tree.urdf")
LOOPS = "closed_loop: [[end, follower_tip]]\ntype: [3d]\nname_mot: [motor]\njoint_name: []\njoint_type: []\n"
MAP = ["map", "tree.urdf", "--loops", "loops.yaml", "--from", "motor=0:0.5", "--to", "hip", "-o", "out.npz"]


@pytest.fixture
def run(mechsim, tmp_path):
    def command(arguments, axis="1", mimic=""):
        (tmp_path / "tree.urdf").write_text(TREE.format(axis=axis, mimic=mimic))
        (tmp_path / "loops.yaml").write_text(LOOPS)
        answer = mechsim(*arguments)
        return answer.code, answer

    return command


def test_a_map_of_a_urdf_file_takes_the_loops_of_a_second_file(run, tmp_path):
    code, _ = run([*MAP, "--points", "5"])
    assert code == 0
    with np.load(tmp_path / "out.npz") as table:
        motor, hip = table["input"][:, 0], table["output"][:, 0]
    # rod from the crank's pin to the follower's end
    pin = 0.3 * np.stack([-np.sin(motor), np.cos(motor)], 1)
    end = [1.0, 0.0] + 0.7 * np.stack([-np.sin(hip), np.cos(hip)], 1)
    assert np.linalg.norm(end - pin, axis=1) == pytest.approx(np.ones(5), abs=1e-9)


def test_a_key_of_many_names_is_rejected(run, tmp_path):
    """A key of 100,000 names costs minutes in Python's reader."""
    (tmp_path / "f.toml").write_text("a." * 100_000 + "a = 1")
    code, shown = run(["show", "f.toml"])
    assert code == 2
    assert "nests too deep" in shown.err
    assert len(shown.err) < 1000


@pytest.mark.long
@pytest.mark.parametrize("name", ["rocker+", "other"])
def test_two_connects_of_a_hinge_of_a_file_agree_with_mujoco(run, tmp_path, name):
    """mechsim writes a cut hinge as connects `rocker` and `rocker+`, which are joints of the file it reads.

    Both methods agree unless the second pair is counted for the first joint.
    """
    text = to_xml(assembled(ms.catalog.make("rssr").mechanism, ms.Scene(cut=("rocker",))))
    text = re.sub(' armature="[^"]*"', "", text).replace('gravity="0 0 0"', 'gravity="0 0 -9.81"')
    assert '<connect name="rocker+"' in text
    (tmp_path / "f.xml").write_text(text.replace('<connect name="rocker+"', f'<connect name="{name}"'))
    motion = ["--drive", "crank=1rad/s", "--duration", "0.2s", "--samples", "12"]
    code, shown = run(["dynamics", "inverse", "f.xml", *motion, "--json"])
    assert code == 0
    assert json.loads(shown.out)["passed"]


@pytest.mark.parametrize("arguments", [["show", "f\udcff.xml"], ["export", "four_bar", "-o", "f\udcff.xml"]])
def test_a_file_name_that_is_not_text_is_rejected(run, tmp_path, arguments):
    if arguments[0] == "show":
        (tmp_path / arguments[1]).write_text(model_text("finger.xml"))
    before = {*tmp_path.iterdir()}
    code, shown = run(arguments)
    assert code == 2
    assert "'f\\udcff.xml' is not text in UTF-8" in shown.err
    assert {*tmp_path.iterdir()} - before <= {tmp_path / "tree.urdf", tmp_path / "loops.yaml"}


@pytest.mark.long
def test_a_link_stated_far_away_does_not_close(run, tmp_path):
    """With a slide stated 1e12 mm off its guide, the damped equations are singular to rounding."""
    text = (Path(__file__).parents[2] / "models/gallery/scotch_yoke.toml").read_text()
    stated = 'yoke = { at = ["crank", 0, 0] }'
    assert stated in text
    (tmp_path / "f.toml").write_text(text.replace(stated, stated.replace(", 0,", ", 1e12,")))
    code, shown = run(["simulate", "f.toml", "--method", "pose", "--samples", "7"])
    assert code == 2
    assert "the loops do not close" in shown.err


@pytest.mark.long
@pytest.mark.parametrize(
    ("link", "changes"),
    [
        ("coupler", {" -0.009929947882008797 0": " 1e12 0", '"0.032 0 0" />': '"0.048 0 0" />'}),
        ("crank", {'"0.003 0 0"': '"0.003 1e12 0"', "0.013703586526268186": "0"}),
    ],
)
def test_a_mass_stated_far_away_is_reported_without_a_warning(tmp_path, link, changes):
    """Its weight opens gaps whose squares, or themselves, are beyond the largest number."""
    text = (Path(__file__).parents[2] / "models/looper.xml").read_text()
    for stated, mutated in changes.items():
        assert stated in text
        text = text.replace(stated, mutated)
    (tmp_path / "f.xml").write_text(text)
    command = [sys.executable, "-W", "error", "-m", "mechsim", "check", str(tmp_path / "f.xml")]
    shown = subprocess.run(command, capture_output=True, text=True)
    assert (shown.returncode, shown.stderr) == (1, "")
    assert f"body {link} has its centre of mass 1e+12 m from its origin" in shown.stdout


@pytest.mark.long
def test_loops_that_close_only_within_rounding_end_in_seconds(run, tmp_path):
    """Beyond a slide's range the residual of an inclined guide grows too slowly to be noticed at once."""
    text = (Path(__file__).parents[2] / "models/slider_crank.xml").read_text()
    for stated, mutated in (
        ('axis="1 0 0"', 'axis="1 0 0.9996872555384282"'),
        ('"0.05 0 0" />', '"0.05000005 0 0" />'),
    ):
        assert stated in text
        text = text.replace(stated, mutated)
    (tmp_path / "f.xml").write_text(text)
    start = time.process_time()
    code, _ = run(["check", "f.xml"])
    assert code == 0
    # it took more than 60 s
    assert time.process_time() - start < 20.0
