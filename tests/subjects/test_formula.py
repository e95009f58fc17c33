"""A formula of the user's own: what is taken, what is refused, and how it is judged."""

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.studies.validate import validate
from mechsim.subjects import gallery
from mechsim.subjects.formula import formula_of
from mechsim.subjects.subject import load

FIXED = """
import numpy as np
def yoke(angle):
    return {"yoke": np.column_stack([0.03 * np.cos(angle), 0 * angle, 0 * angle])}
"""


def told(tmp_path, body, name="yoke"):
    """Return the yoke with a formula written beside it."""
    text = gallery.files()["scotch_yoke"].read_text()
    (tmp_path / "own.py").write_text(body)
    (tmp_path / "own.toml").write_text(text.replace("guides.py:scotch_yoke", f"own.py:{name}"))
    return load(str(tmp_path / "own.toml"))


def test_a_function_of_the_crank_angle_alone_is_a_formula(tmp_path):
    form = told(tmp_path, FIXED)
    case = validate(form, formula=formula_of(form), quick=True)
    assert case.passed, case.reason
    assert [check.subject for check in case.checks if check.road == "formula"] == ["yoke"]


def test_a_formula_that_is_off_is_missed_and_says_where(tmp_path):
    form = told(tmp_path, FIXED.replace("0.03", "0.03003"))
    case = validate(form, formula=formula_of(form), quick=True)
    assert case.outcome == "missed"
    (check,) = [check for check in case.checks if check.road == "formula"]
    assert check.worst == pytest.approx(3e-5)
    assert np.cos(check.at_angle) == pytest.approx(1.0) or np.cos(check.at_angle) == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("yoke = 3", "is of type int; name a function"),
        ("def lever(angle): ...", "makes no 'yoke'"),
        ("def yoke(angle): return 1 / 0", "ends in ZeroDivisionError: division by zero; mend the file"),
        ("def yoke(angle): return [1]", "gives a list; give a dictionary"),
        ("def yoke(angle): return {'P': angle}", "gives point 'P'; tracked are"),
        ("def yoke(angle): return {'yoke': angle}", r"of shape \(2,\) for 2 instants; give \(2, 3\)"),
        ("def yoke(angle): return {'yoke': 'x'}", r"'yoke' of shape \(0,\)"),
        (FIXED.replace("0.03 *", "1e999 *"), "no finite place for point 'yoke' at crank angle = 0.1"),
    ],
)
def test_what_is_no_formula_is_refused_in_one_sentence(tmp_path, body, said):
    with pytest.raises(InputError, match=said) as refused:
        formula_of(told(tmp_path, body))(np.array([0.1, 0.2]))
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    form = told(tmp_path, FIXED)
    (tmp_path / "own.py").unlink()
    with pytest.raises(InputError, match=r"there is no file .*own\.py"):
        formula_of(form)


def test_a_mechanism_of_the_catalogue_has_none():
    assert formula_of(load("rssr")) is None
