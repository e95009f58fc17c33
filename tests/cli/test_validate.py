"""`mechsim validate` and the gallery: checked methods, executed code and printed results."""

import json
import re

import pytest
from model_files import model_text

from mechsim.io import gallery

YOKE = gallery.files()["scotch_yoke"]
SHORT_ROD = """
import numpy as np
def short(angle):
    height = 0.05 * np.sin(angle) - 0.01
    x = 0.05 * np.cos(angle) + np.sqrt(0.199**2 - height**2)
    return {"B": np.stack([x, np.full_like(x, 0.01), 0.0 * x], -1)}
"""


def test_gallery_names_are_listed_and_accepted_as_models(mechsim):
    code, out, _ = mechsim("list", "--json")
    assert not code
    assert set(json.loads(out)["gallery"]) == set(gallery.files())
    code, out, _ = mechsim("show", "scotch_yoke", "--json")
    assert not code
    assert json.loads(out)["name"] == "scotch_yoke"


@pytest.mark.long
def test_a_user_formula_is_run_with_a_notice_and_checked(mechsim, tmp_path):
    (tmp_path / "guides.py").write_text(
        YOKE.with_name("guides.py").read_text().replace("np.cos", "1.001 * np.cos")
    )
    (tmp_path / "own.toml").write_text(YOKE.read_text())
    code, out, err = mechsim("validate", "own.toml")
    assert code == 1
    assert "runs guides.py (a formula is Python code)" in err
    lines = out.splitlines()
    assert lines[0].startswith("scotch_yoke  planar, ")
    assert lines[0].split("  ")[-2].endswith("FAIL")
    assert lines[1].startswith("  position of ")
    assert "off by 30 µm at" in lines[1]
    assert re.search("^  possible cause +crank is 0.0300", out, re.MULTILINE)
    assert "run against pin" not in out
    code, out, _ = mechsim("validate", "own.toml", "-v")
    assert "run against pin: 3e-05 m = formula 3e-05" in out


def test_two_files_with_the_same_name_are_both_checked(mechsim, tmp_path):
    for name, crank in (("a", "30"), ("b", "31")):
        (tmp_path / name).mkdir()
        source = YOKE.read_text().replace("crank = 30", f"crank = {crank}").partition("[formula]")[0]
        (tmp_path / name / "yoke.toml").write_text(source)
    code, out, err = mechsim("validate", "a/yoke.toml", "b/yoke.toml", "--json")
    assert not code, err
    assert list(json.loads(out)["mechanisms"]) == ["a/yoke.toml", "b/yoke.toml"]


CATALOGUE_OF_TWO = ("four_bar", "slider_crank")


def test_one_mechanism_has_a_line_per_method_with_its_error_ratio(mechsim):
    code, out, _ = mechsim("validate", "four_bar")
    lines = out.splitlines()
    assert not code
    assert len(lines) == 5
    assert lines[0].startswith("four_bar  planar, 4 links, 1 DOF, full rotation")
    assert re.search(r"  PASS  [0-9.]+ s$", lines[0])
    assert lines[1].startswith("  formula vs loop equations         14 checks ")
    assert lines[2].startswith("  MuJoCo, solved poses              17 checks ")
    assert lines[3].startswith("  MuJoCo, 600 rpm, RK4, 1000 steps  17 checks ")
    assert all(re.search(r" <?[0-9.]+ %  [a-zA-Z ]+[0-9.]+e-[0-9]+ (m|rad)", line) for line in lines[1:4])
    assert lines[4].startswith("48 checks passed (% = error/tolerance; -v lists all")


def test_mechanisms_without_stepping_are_reported(mechsim, monkeypatch):
    monkeypatch.setattr(gallery, "files", lambda: {"scotch_yoke": YOKE})
    monkeypatch.setattr("mechsim.io.catalog.MECHANISMS", {})
    code, out, _ = mechsim("validate")
    assert not code
    assert "1 gallery mechanism: solved poses only; --gallery also steps it" in out
    # a mechanism that is named and in the gallery is checked once
    code, out, _ = mechsim("validate", "scotch_yoke", "--gallery", "--json")
    assert not code
    assert list(json.loads(out)["mechanisms"]) == ["scotch_yoke"]


def test_a_failure_reports_the_error_and_the_likely_cause(mechsim, tmp_path):
    (tmp_path / "rod.py").write_text(SHORT_ROD)
    code, out, _ = mechsim("validate", "slider_crank", "--against", "rod.py:short")
    assert code == 1
    head, *rest = out.splitlines()
    assert re.fullmatch(r"slider_crank vs rod.py:short +FAIL", head)
    assert rest == [
        "  position of B  off by 1.05 mm at 270°   (tolerance 2.5 nm)",
        "  likely cause   rod is 0.199 m instead of 0.2 m, explains 100 % of the error",
    ]


@pytest.mark.long
@pytest.mark.parametrize("options", [("looper",), ("looper", "-v"), ("four_bar", "-v"), CATALOGUE_OF_TWO])
def test_output_fits_eighty_columns_of_plain_text(mechsim, monkeypatch, options):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = mechsim("validate", *options)
    lines = out.splitlines()
    assert max(map(len, lines)) <= 80
    assert not set("│┃─━┏\x1b") & set(out)
    if "-v" in options:
        assert all(word in out for word in ("quantity", "worst", "acceleration"))
        assert len(lines) > 40
    else:
        assert len(lines) <= 14


DERIVED = """
import numpy as np
def derived(angle):
    a = 0.032 * np.stack([np.cos(angle), np.sin(angle)])
    to_pivot = np.array([[0.1], [0.0]]) - a
    distance = np.hypot(*to_pivot)
    cosine = (distance**2 + 0.091**2 - 0.074**2) / (2 * distance * 0.091)
    at_a = np.arctan2(*to_pivot[::-1]) + np.arccos(cosine)
    return {
        "distance:A,B": np.full_like(angle, 0.091),
        "angle:ground,coupler": at_a,
        "expr:A.x*2": 2.0 * a[0] + ERROR,
    }
"""


@pytest.mark.long
@pytest.mark.parametrize(("error", "wrong"), [("0.0", []), ("1e-6", ["expr:A.x*2"])])
def test_distances_angles_and_expressions_are_compared(mechsim, tmp_path, error, wrong):
    file = tmp_path / "derived.py"
    file.write_text(DERIVED.replace("ERROR", error))
    code, out, _ = mechsim("validate", "four_bar", "--against", f"{file}:derived", "--json")
    checks = json.loads(out)["mechanisms"]["four_bar"]["checks"]
    assert code == int(bool(wrong))
    assert [check["quantity"] for check in checks] == ["distance:A,B", "angle:ground,coupler", "expr:A.x*2"]
    assert [check["quantity"] for check in checks if not check["passed"]] == wrong


@pytest.mark.long
def test_the_report_of_a_mechanism_with_a_point_of_the_frame_is_written(mechsim, tmp_path):
    (tmp_path / "f.toml").write_text(model_text("frame_point.toml"))
    answer = mechsim("validate", "f.toml", "--report", "out")
    assert answer.code == 0, answer.err
    assert "position of lug" in (tmp_path / "out" / "index.html").read_text()
