"""`mechsim validate` and the gallery: what is judged, what code is run, how results are told apart."""

import json

import pytest

from mechsim.subjects import gallery

YOKE = gallery.files()["scotch_yoke"]


def judged(text):
    return {
        name: {check["quantity"].split(":")[0] for check in case["checks"]}
        for name, case in json.loads(text)["mechanisms"].items()
    }


def test_what_is_asked_is_read_before_a_formula_is_run(mechsim):
    code, out, err = mechsim("validate", "four_bar", "--against", "none.py:law", "--tolerance", "x")
    assert (code, out) == (2, "")
    assert err.startswith("mechsim: the tolerance 'x'")
    assert err.count("\n") == 1


def test_a_folder_for_a_page_that_is_never_made_is_none(mechsim, tmp_path):
    page = str(tmp_path / "page")
    asked = ("validate", "four_bar", "--report", page)
    assert mechsim(*asked, "--against", "none.csv", "--tolerance", "x").code == 2
    assert mechsim(*asked, "--set", "crank=9").code == 2
    assert not list(tmp_path.iterdir())


def test_the_gallery_is_listed_and_its_names_are_models(mechsim):
    code, out, _ = mechsim("list", "--json")
    assert not code
    assert set(json.loads(out)["gallery"]) == set(gallery.files())
    code, out, _ = mechsim("show", "scotch_yoke", "--json")
    assert not code
    assert json.loads(out)["name"] == "scotch_yoke"


@pytest.mark.slow
def test_without_names_the_gallery_is_judged_without_steps_and_with_its_option_in_full(mechsim, monkeypatch):
    monkeypatch.setattr(gallery, "files", lambda: {"scotch_yoke": YOKE})
    code, out, err = mechsim("validate", "--json")
    assert not code, err
    roads = judged(out)
    assert roads["scotch_yoke"] == {"formula", "pose"}
    assert {"closed form", "pose", "step"} <= roads["rssr"]
    code, out, _ = mechsim("validate", "slider_crank", "--gallery", "--json")
    assert not code
    assert judged(out)["scotch_yoke"] == {"formula", "pose", "step"}
    assert len(judged(out)) == 2


def test_a_formula_of_one_s_own_is_run_and_said_to_be_and_its_error_is_found(mechsim, tmp_path):
    (tmp_path / "guides.py").write_text(
        YOKE.with_name("guides.py").read_text().replace("np.cos", "1.001 * np.cos")
    )
    (tmp_path / "own.toml").write_text(YOKE.read_text())
    code, out, err = mechsim("validate", "own.toml")
    assert code == 1
    assert "runs guides.py: a formula is code" in err
    assert "scotch_yoke: missed - formula: beyond the bound: position of" in out
    assert "perhaps: crank is 0.0300" in out
    assert "run against pin: 3e-05 m = formula 3e-05" in out
    code, out, _ = mechsim("validate", "own.toml", "--json")
    case = json.loads(out)["mechanisms"]["scotch_yoke"]
    assert case["findings"][0]["kind"] == "dimension"
    assert case["attribution"]["formula"] == pytest.approx(3e-5, rel=1e-3)


def test_the_gallery_s_own_laws_need_no_word(mechsim):
    code, _, err = mechsim("validate", "scotch_yoke")
    assert not code
    assert not err


def test_two_files_of_one_name_are_both_judged(mechsim, tmp_path):
    for name, crank in (("a", "30"), ("b", "31")):
        (tmp_path / name).mkdir()
        own = YOKE.read_text().replace("crank = 30", f"crank = {crank}").partition("[formula]")[0]
        (tmp_path / name / "yoke.toml").write_text(own)
    code, out, err = mechsim("validate", "a/yoke.toml", "b/yoke.toml", "--json")
    assert not code, err
    assert list(json.loads(out)["mechanisms"]) == ["a/yoke.toml", "b/yoke.toml"]
