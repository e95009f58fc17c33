"""Output of `mechsim validate --report` with and without OpenGL."""

import base64
import io
import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from PIL import Image

from mechsim.cli import main
from mechsim.pictures import render
from mechsim.pictures.render import gl_backend
from mechsim.report import validation


def validated(monkeypatch, tmp_path, capsys, *arguments):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mechsim", "validate", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, capsys.readouterr()


@pytest.mark.long
def test_the_report_contains_page_numbers_plots_picture_and_video(monkeypatch, tmp_path, capsys):
    code, output = validated(monkeypatch, tmp_path, capsys, "slider_crank", "--report", "out/", "--json")
    assert not code, output.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "index.html",
        "validate.json",
        "three.min.js",
        "slider_crank.mp4",
        "slider_crank.view.html",
    }
    numbers = json.loads((tmp_path / "out" / "validate.json").read_text())
    printed = json.loads(output.out)
    assert numbers["mechanisms"]["slider_crank"]["checks"] == printed["mechanisms"]["slider_crank"]["checks"]
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'src="slider_crank.mp4"' in page
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


PUSHED = model_text("validation_pushed.xml")


@pytest.mark.slow
def test_a_user_defined_scene_is_drawn_in_its_own_colours(monkeypatch, tmp_path, capsys):
    (tmp_path / "pushed.xml").write_text(PUSHED)
    monkeypatch.setattr(render, "write_video", lambda path, *_, **__: path.touch())
    monkeypatch.setattr(validation, "PLOTS", {})
    arguments = ("pushed.xml", "--drive", "crank=0.5+0.1*sin(2*pi*t)", "--report", "out")
    code, output = validated(monkeypatch, tmp_path, capsys, *arguments)
    assert not code, output.err
    page = (tmp_path / "out" / "index.html").read_text()
    picture = base64.b64decode(re.search(r"url\(data:image/webp;base64,([^)]*)\)", page)[1])
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    red, green, blue = pixels.reshape(-1, 3).T
    assert ((green > 90) & (red < 40) & (blue < 40)).sum() > 500
    assert "driven: crank" in page


def test_without_opengl_a_report_notes_the_missing_package(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(gl_backend, "probe", lambda name: None)
    monkeypatch.setattr(validation, "PLOTS", {})
    code, output = validated(monkeypatch, tmp_path, capsys, "four_bar", "slider_crank", "--report", "out")
    assert not code, output.err
    lines = [line for line in output.err.splitlines() if "libegl1" in line or "libosmesa6" in line]
    assert len(lines) == 1
    assert (tmp_path / "out" / "index.html").exists()
    assert not list((tmp_path / "out").glob("*.mp4"))


def test_an_invalid_report_folder_is_rejected_before_the_validation(monkeypatch, tmp_path, capsys):
    code, output = validated(monkeypatch, tmp_path, capsys, "four_bar", "--report", "no/such/folder")
    assert code == 2
    assert len(output.err.strip().splitlines()) == 1
    assert "no/such" in output.err


@pytest.mark.slow
def test_a_case_without_steps_is_reported_with_a_still_picture(tmp_path):
    from mechsim.report.validation import write_validation_report
    from mechsim.studies.validate import case_of
    from mechsim.subjects.readers import load

    law = "def law(angle, of):\n    x = 1.001e-3 * of['crank'] * np.cos(angle)\n"
    (tmp_path / "own.py").write_text(
        f"import numpy as np\n{law}    return {{'yoke': np.column_stack([x, 0 * x, 0 * x])}}\n"
    )
    case = case_of(replace(load("scotch_yoke"), formula=f"{tmp_path}/own.py:law"), quick=True)
    # the mechanism is named by the path of its file
    results = {"passed": False, "mechanisms": {"a/yoke": case.as_dict()}}
    (tmp_path / "out").mkdir()
    assert write_validation_report(tmp_path / "out", {"a/yoke": case}, results) == []
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "index.html",
        "validate.json",
        "three.min.js",
        "a_yoke.view.html",
    }
    assert results["mechanisms"]["a/yoke"]["steps"] == 0
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'id="a/yoke"' in page
    assert "what explains the difference" in page


@pytest.mark.slow
def test_the_page_reports_checks_of_several_drivers(monkeypatch, tmp_path):
    monkeypatch.setattr(render, "write_video", lambda path, *_, **__: path.touch())
    from mechsim.report.validation import write_validation_report
    from mechsim.studies.validate import case_of
    from mechsim.subjects.readers import load

    case = case_of(load("five_bar"))
    results = {"passed": True, "mechanisms": {"five_bar": case.as_dict()}}
    write_validation_report(tmp_path, {"five_bar": case}, results)
    page = (tmp_path / "index.html").read_text()
    assert "left, right" in page
    assert "step: drive: left" in page


@pytest.mark.slow
def test_a_mechanism_with_a_rack_has_no_assur_groups():
    from mechsim.report.facts import facts
    from mechsim.subjects.readers import load

    assert facts(load("rack_steering"))["assur_explained"] == []
    assert facts(load("klann"))["assur_explained"]
