"""`mechsim validate` and the gallery: checked methods, executed code and printed results."""

import json
import re

import pytest

from mechsim.io import gallery

YOKE = gallery.files()["scotch_yoke"]


def test_gallery_names_are_listed_and_accepted_as_models(mechsim):
    code, out, _ = mechsim("list", "--json")
    assert not code
    assert set(json.loads(out)["gallery"]) == set(gallery.files())


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
