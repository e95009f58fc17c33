"""The remedies that commands suggest for an underdetermined motion work."""

import pytest
from model_files import model_text

from mechsim import files

# a five-bar with one driven arm
ONE_DRIVER = model_text("undetermined_one_driver.toml")


def test_an_underdetermined_crank_is_stepped_from_its_start(mechsim, tmp_path):
    (tmp_path / "five.toml").write_text(ONE_DRIVER)
    answer = mechsim("simulate", "five.toml", "--method", "step", "--turns", "0.02", "-o", "run.csv")
    assert (answer.code, "PASS" in answer.out) == (0, True)
    assert files.read(str(tmp_path / "run.csv"))["angle"][0] == pytest.approx(2.0, abs=1e-12)
    assert "right can still move" in mechsim("solve", "five.toml", "--angles", "2").err
