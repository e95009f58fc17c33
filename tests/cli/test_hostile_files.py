"""Files with numbers that no model has, and loops of a second file, in `map`, `sample` and `dynamics`."""

import numpy as np
import pytest

from mechsim import cli

TREE = """<robot name="four_bar">
  <link name="base"/><link name="crank"/><link name="rod"/><link name="follower"/><link name="end"/>
  <joint name="motor" type="continuous">
    <parent link="base"/><child link="crank"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="knee" type="continuous">
    <parent link="crank"/><child link="rod"/><origin xyz="0 0.3 0"/><axis xyz="0 0 {axis}"/>
  </joint>
  <joint name="hip" type="continuous">
    <parent link="base"/><child link="follower"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>{mimic}
  </joint>
  <joint name="tip" type="fixed"><parent link="rod"/><child link="end"/><origin xyz="1 0 0"/></joint>
  <link name="follower_end"/><joint name="follower_tip" type="fixed"><parent link="follower"/>
    <child link="follower_end"/><origin xyz="0 0.7 0"/></joint>
</robot>"""
LOOPS = "closed_loop: [[end, follower_tip]]\ntype: [3d]\nname_mot: [motor]\njoint_name: []\njoint_type: []\n"
MAP = ["map", "tree.urdf", "--loops", "loops.yaml", "--from", "motor=0:0.5", "--to", "hip", "-o", "out.npz"]
SAMPLE = ["sample", "tree.urdf", "--loops", "loops.yaml", "-n", "3", "-o", "out.npz"]


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    def command(arguments, axis="1", mimic=""):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "tree.urdf").write_text(TREE.format(axis=axis, mimic=mimic))
        (tmp_path / "loops.yaml").write_text(LOOPS)
        monkeypatch.setattr("sys.argv", ["mechsim", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, capsys.readouterr()

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


@pytest.mark.parametrize("arguments", [MAP, SAMPLE])
def test_parts_that_are_not_read_are_reported(run, arguments):
    code, shown = run(arguments, mimic='<mimic joint="moter" multiplier="2"/>')
    assert code == 0
    assert "did you mean 'motor'" in shown.err


def test_a_controller_that_is_not_finite_is_one_line(run, recwarn):
    with np.errstate(all="warn"):
        code, shown = run(
            [
                "dynamics",
                "forward",
                "four_bar",
                "--initial",
                "crank.v=1",
                "--duration",
                "0.1s",
                "--controller",
                "crank=log(0)",
            ]
        )
    assert code == 2
    assert "controllers of crank" in shown.err
    assert not [warning for warning in recwarn if warning.category is RuntimeWarning]
