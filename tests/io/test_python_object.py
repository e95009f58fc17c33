"""A mechanism that a Python file makes."""

import re
from pathlib import Path

import pytest

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.io.readers import load

FILE = """
import mechsim as ms
plain = ms.catalog.make("four_bar").mechanism
drive = ms.catalog.make("rssr", crank=0.014)
def made():
    return plain
def broken():
    raise ZeroDivisionError("no wonder\\nat all")
number = 3
int = int
largest = max
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "own.py").write_text(FILE)
    return str(tmp_path / "own.py")


def test_mechanisms_and_functions_of_a_python_file_are_models(path):
    exact = catalog.make("four_bar").positions([1.0])["B"]
    for name in ("plain", "made"):
        assert load(f"{path}:{name}").positions([1.0])["B"] == pytest.approx(exact, abs=1e-15)
    assert load(f"{path}:drive") == catalog.make("rssr", crank=0.014)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("broken", "ends in ZeroDivisionError: no wonder; repair the file"),
        ("number", "is of type int"),
        ("int", "is of type int"),
        ("largest", "ends in TypeError: max expected"),
        ("plane", "did you mean 'plain'"),
        ("", "names no object"),
    ],
)
def test_other_objects_are_rejected_in_one_line(path, name, words):
    with pytest.raises(InputError, match=re.escape(words)) as error:
        load(f"{path}:{name}")
    assert "\n" not in str(error.value)


def test_a_path_object_is_a_model():
    path = Path(__file__).parents[2] / "models" / "gallery" / "scotch_yoke.toml"
    assert load(path).mechanism == load(str(path)).mechanism
    with pytest.raises(InputError, match="a model is of type int; give a name or a file"):
        load(7)
