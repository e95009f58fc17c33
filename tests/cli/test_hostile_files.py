"""Files with numbers that no model has, and loops of a second file, in `map`, `sample` and `dynamics`."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path
from string import Template

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled

TREE = model_text("hostile_files_tree.urdf")
LOOPS = "closed_loop: [[end, follower_tip]]\ntype: [3d]\nname_mot: [motor]\njoint_name: []\njoint_type: []\n"
MAP = ["map", "tree.urdf", "--loops", "loops.yaml", "--from", "motor=0:0.5", "--to", "hip", "-o", "out.npz"]
SAMPLE = ["sample", "tree.urdf", "--loops", "loops.yaml", "-n", "3", "-o", "out.npz"]


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


@pytest.mark.parametrize("arguments", [MAP, SAMPLE])
def test_an_infinite_axis_is_rejected(run, tmp_path, arguments):
    code, shown = run(arguments, axis="-inf")
    assert code == 2
    assert "'knee' holds numbers that are not finite" in shown.err
    assert not (tmp_path / "out.npz").exists()


@pytest.mark.long
@pytest.mark.parametrize("arguments", [MAP, SAMPLE])
def test_parts_that_are_not_read_are_reported(run, arguments):
    code, shown = run(arguments, mimic='<mimic joint="moter" multiplier="2"/>')
    assert code == 0
    assert "did you mean 'motor'" in shown.err


@pytest.mark.parametrize(
    ("rate", "law"),
    [("0", "log(0)"), *(("1", law) for law in ("log(0)", "sqrt(-1)", "1/crank.q", "sqrt(crank.q-1)"))],
)
def test_a_controller_that_is_not_finite_is_one_line(run, recwarn, rate, law):
    with np.errstate(all="warn", under="ignore"):
        run_on = f"dynamics forward four_bar --initial crank.v={rate} --duration 0.1s"
        code, shown = run([*run_on.split(), "--motor", f"crank={law}"])
    assert code == 2
    assert "crank are not finite" in shown.err
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]


MJCF = """<mujoco>{asset}<worldbody>{more}<body name="b"><inertial pos="0 0 0" mass="{mass}"
diaginertia="1 1 1"/><joint name="j"/></body></worldbody></mujoco>"""


def mjcf(asset="", more="", mass="1"):
    return MJCF.format(asset=asset, more=more, mass=mass)


GEARS = Template(model_text("hostile_files_gears.toml"))


@pytest.mark.parametrize(
    ("name", "text", "command", "words"),
    [
        # rows and columns of 40 GB, copies of which MuJoCo makes 1e8, and 1e6 in two levels
        (
            "f.xml",
            mjcf('<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'),
            "show",
            "10,000,000,000 parts",
        ),
        (
            "f.xml",
            mjcf(more='<replicate count="100000000"><geom size="1"/></replicate>'),
            "check",
            "100,000,000 parts",
        ),
        (
            "f.xml",
            mjcf(
                more='<replicate count="999"><replicate count="999"><geom size="1"/></replicate></replicate>'
            ),
            "show",
            "998,001 parts",
        ),
        ("f.xml", mjcf(mass="-1"), "show", "line 1: MuJoCo refuses it: body 'b' has a mass of -1 kg"),
        ("f.xml", mjcf(mass="nan"), "check", "mass of nan kg"),
        (
            "f.urdf",
            TREE.format(axis="1", mimic="").replace('"hip"', '"knee"'),
            "show",
            "2 joints with the name 'knee'",
        ),
        (
            "f.urdf",
            TREE.format(axis="1", mimic="").replace('"hip"', '""'),
            "show",
            "1 joint with the name ''",
        ),
        # a key of 100,000 names costs minutes in Python's reader
        ("f.toml", "a." * 100_000 + "a = 1", "show", "nests too deep"),
        ("f.toml", "name = 'g'\njoints = {}", "check", "no body can move"),
        ("f.toml", "name = 'g'\njoints = {}", "export -o out.xml", "no body can move"),
        (
            "f.toml",
            model_text("hostile_files_gears.toml", ratio="1e11"),
            "solve",
            "the ratio 1e+11; give 1e+06 at most",
        ),
        # a long word is cut
        (
            "f.urdf",
            TREE.format(axis="1", mimic="").replace('xyz="1 0 0"', f'xyz="1 0 {"x" * 5000}"'),
            "show",
            "xxx...",
        ),
    ],
)
def test_a_hostile_file_ends_in_one_short_line(run, tmp_path, name, text, command, words):
    (tmp_path / name).write_text(text)
    verb, *options = command.split()
    code, shown = run([verb, name, *options])
    assert code == 2
    assert words in shown.err
    assert len(shown.err.splitlines()) == 1
    assert len(shown.err) < 1000
    assert not (tmp_path / "out.xml").exists()


@pytest.mark.long
def test_a_few_copies_and_the_largest_ratio_are_read(run, tmp_path):
    copies = mjcf(more='<replicate count="20"/><replicate count="9"><geom size="1"/></replicate>' * 60)
    for name, text in (("f.xml", copies), ("f.toml", GEARS.substitute(ratio="-1e6"))):
        (tmp_path / name).write_text(text)
        code, _ = run(["show", name])
        assert code == 0


def test_a_wheel_too_light_for_mujoco_is_named_with_its_limit(run, tmp_path):
    (tmp_path / "f.toml").write_text(
        'name = "rod"\njoints.a = { kind = "revolute", a = { link = "ground" }, b = { link = "rod" } }\n'
        'points.tip = { link = "rod", at = [1e-6, 0, 0] }\nmotion_laws.a = "60rpm"\n'
        "links.rod.inertia = { mass = 1e-17, centre = [0, 0, 0], moments = [1e-29, 1e-29, 1e-29] }\n"
    )
    for arguments in (
        ["dynamics", "inverse", "f.toml"],
        ["export", "f.toml", "--scene", "dynamics", "-o", "out.xml"],
    ):
        code, shown = run(arguments)
        assert code == 2
        assert "body 'rod' has a mass of 1e-17 kg and a moment of inertia of 1e-29" in shown.err
        assert "larger than mjMINVAL, 1e-15" in shown.err
    assert not (tmp_path / "out.xml").exists()


@pytest.mark.parametrize("rows", ["\n\n\n", "\r\r\r", " \n"])
def test_a_table_of_blank_lines_has_no_row(run, tmp_path, rows):
    (tmp_path / "at.csv").write_text(rows, newline="")
    code, shown = run(["solve", "slider_crank", "--at", "at.csv"])
    assert code == 2
    assert "at.csv holds no table of numbers" in shown.err
    assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize("command", ["show", "solve", "simulate --method pose", "export -o out.xml"])
@pytest.mark.parametrize("coupler", ["rod", "Rod"])
def test_a_link_of_a_planar_linkage_without_a_joint_is_rejected(run, tmp_path, coupler, command):
    """Joints of PMKS; the last is a point of a link that nothing holds, the third joint may be misspelt."""
    pins = [
        (0, 0, "ground", "crank"),
        (1, 0, "crank", "rod"),
        (2, 2, coupler, "rocker"),
        (3, 0, "rocker", "ground"),
    ]
    joints = [f'{{"X": {x}, "Y": {y}, "TypeOfJoint": "R", "Links": ["{a}", "{b}"]}}' for x, y, a, b in pins]
    joints.append('{"X": 1, "Y": 1, "TypeOfJoint": "R", "Links": ["lost"]}')
    (tmp_path / "f.json").write_text(f'{{"Joints": [{", ".join(joints)}], "DrivingIndex": 0}}')
    name, *options = command.split()
    code, shown = run([name, "f.json", *options])
    assert code == 2
    assert "no chain of joints leads from the frame to lost; add a joint" in shown.err


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
        (tmp_path / arguments[1]).write_text(mjcf())
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


@pytest.mark.filterwarnings("error")
def test_rows_of_positions_closer_than_rounding_are_one_position(run, tmp_path):
    """The crank of 32 mm lies along x in both rows; the square of their distance is 0 in floating point."""
    (tmp_path / "at.csv").write_text("crank\n0\n1e-300\n")
    code, shown = run(["solve", "four_bar", "--at", "at.csv", "--json"])
    assert code == 0
    assert json.loads(shown.out)["columns"]["A.x"] == pytest.approx([0.032, 0.032], rel=1e-12)
