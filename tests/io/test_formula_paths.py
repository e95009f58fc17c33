"""Formulas in files are code: they are run from the folder of the file or below, or not at all."""

from pathlib import Path

import pytest
from model_files import model_text

import mechsim as ms

PENDULUM = model_text("formula_paths_pendulum.toml")
# right: the point turns about the origin at distance 1
CODE = """
import numpy as np
from pathlib import Path
Path(__file__).with_name("was_run").touch()
def position(crank):
    return {"P": np.stack([np.cos(crank), np.sin(crank), 0.0 * crank], -1)}
"""


@pytest.fixture
def written(tmp_path):
    for folder in ("models", "models/below", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "code.py").write_text(CODE, encoding="utf-8")
    (tmp_path / "models" / "link.py").symlink_to(tmp_path / "other" / "code.py")

    def write(formula):
        path = tmp_path / "models" / "arm.toml"
        path.write_text(PENDULUM.replace("FORMULA", formula), encoding="utf-8")
        return str(path)

    return write


@pytest.mark.parametrize(
    "formula", ["code.py:position", "below/code.py:position", "below/../code.py:position"]
)
def test_a_formula_in_the_folder_or_below_is_read(written, formula):
    assert ms.load(written(formula)).formula.endswith("code.py:position")


@pytest.mark.parametrize(
    "formula", ["../other/code.py:position", "link.py:position", "{tmp}/other/code.py:position"]
)
def test_a_formula_elsewhere_is_rejected_with_its_line(written, formula, tmp_path):
    path = written(formula.format(tmp=tmp_path))
    with pytest.raises(ms.InputError, match=r"line 12: .*outside the folder of the mechanism"):
        ms.load(path)
    assert not (tmp_path / "other" / "was_run").exists()


@pytest.mark.parametrize("copy", ["models/copy.toml", "copy.toml", "models/below/copy.toml"])
def test_an_exported_copy_names_the_formula_from_its_own_folder_or_states_that_it_does_not(
    written, copy, tmp_path
):
    result = ms.export(written("below/code.py:position"), tmp_path / copy, format="toml")
    file = ms.load(str(tmp_path / copy)).formula.rpartition(":")[0]
    assert (Path(file).resolve() if file else None) == tmp_path / "models" / "below" / "code.py"
    assert not result.left_out
    result = ms.export(written("below/code.py:position"), tmp_path / "other" / "copy.toml", format="toml")
    assert ms.load(str(tmp_path / "other" / "copy.toml")).formula == ""
    assert "below/code.py:position is left out" in result.left_out


def test_no_formula_runs_no_code(written, tmp_path, mechsim):
    path, was_run = written("code.py:position"), tmp_path / "models" / "was_run"
    for option, runs in (("--no-formula", False), ("--formula", True)):
        answer = mechsim("validate", path, option)
        assert answer.code == 0
        assert was_run.exists() is runs
