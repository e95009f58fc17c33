"""Output of `mechsim validate --report` with and without OpenGL."""

import json
from pathlib import Path

import numpy as np
import pytest

from mechsim import validate
from mechsim.io.readers import parametric_model
from mechsim.pictures.render import gl_backend
from mechsim.report import validation

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.long
def test_the_report_contains_page_numbers_plots_and_picture(mechsim, tmp_path):
    output = mechsim("validate", "slider_crank", "--report", "out/", "--json")
    assert not output.code, output.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "index.html",
        "validate.json",
        "three.min.js",
        "slider_crank.view.html",
    }
    numbers = json.loads((tmp_path / "out" / "validate.json").read_text())
    printed = json.loads(output.out)
    assert numbers["mechanisms"]["slider_crank"]["checks"] == printed["mechanisms"]["slider_crank"]["checks"]
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count("data:image/webp") == 6
    assert 'href="slider_crank.view.html"' in page
    view = (tmp_path / "out" / "slider_crank.view.html").read_text()
    assert 'src="three.min.js"' in view
    assert (tmp_path / "out" / "three.min.js").is_file()
    assert len(view) < 400_000
    # the page lists every printed quantity
    checks = printed["mechanisms"]["slider_crank"]["checks"]
    assert f"{len(checks)} of {len(checks)}" in page
    for check in checks:
        assert check["quantity"] in page


@pytest.mark.long
@pytest.mark.parametrize("shared_from", [2, 3])
def test_without_opengl_a_report_notes_the_missing_package(mechsim, monkeypatch, tmp_path, shared_from):
    monkeypatch.setattr(validation, "MIN_SHARED", shared_from)
    monkeypatch.setattr(gl_backend, "probe", lambda name: None)
    monkeypatch.setattr(validation, "PLOTS", {})
    output = mechsim("validate", "four_bar", "slider_crank", "--report", "out")
    assert not output.code, output.err
    lines = [line for line in output.err.splitlines() if "libegl1" in line or "libosmesa6" in line]
    assert len(lines) == 1
    page = (tmp_path / "out" / "index.html").read_text()
    assert 0 < page.index(' href="four_bar.view.html"') < page.index(' href="slider_crank.view.html"')
    assert not list((tmp_path / "out").glob("*.mp4"))


def test_the_ghost_of_a_failed_page_is_the_motion_of_the_wrong_formula(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    import gripper_kinematics

    designs = parametric_model("parallel_gripper")
    wrong = validate("parallel_gripper", against=gripper_kinematics.short_arm, stepped=False)
    shown = validation.ghost_of_cause(wrong, designs)
    claimed = gripper_kinematics.short_arm(shown["exact"].angle)
    for name, positions in claimed.items():
        assert np.abs(shown["exact"].points[name].position - positions).max() < 1e-9
    assert shown["caption"] == "arm is 0.056 m instead of 0.057 m"
    # the error is the largest where the gripper is closed
    assert shown["angle"] == shown["exact"].angle.max()
    right = validate("parallel_gripper", against=gripper_kinematics.pads, stepped=False)
    assert validation.ghost_of_cause(right, designs) == {}
