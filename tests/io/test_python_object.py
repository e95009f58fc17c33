"""A mechanism that a Python file makes."""

from pathlib import Path

import pytest

import mechsim as ms

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
    exact = ms.catalog.make("four_bar").positions([1.0])["B"]
    for name in ("plain", "made"):
        assert ms.load(f"{path}:{name}").positions([1.0])["B"] == pytest.approx(exact, abs=1e-15)
    assert ms.load(f"{path}:drive") == ms.catalog.make("rssr", crank=0.014)


def test_a_path_object_is_a_model():
    path = Path(__file__).parents[2] / "models" / "gallery" / "scotch_yoke.toml"
    assert ms.load(path).mechanism == ms.load(str(path)).mechanism
    with pytest.raises(ms.InputError, match="a model is of type int; give a name or a file"):
        ms.load(7)
