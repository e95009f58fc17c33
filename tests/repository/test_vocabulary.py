"""Identifiers, strings, comments and pages use the terms of the field; none is a private word."""

from collections import Counter
from pathlib import Path

import pytest
from readability.private_words import page_uses, private_name, python_uses, uses

ROOT = Path(__file__).parents[2]
CHECKED = (
    "mechsim",
    "docs",
    "README.md",
    "CONTRIBUTING.md",
    "tests",
    "validation",
    "reference",
    "examples",
    "models",
)


@pytest.mark.parametrize("path", CHECKED)
def test_no_private_words_are_used(path):
    assert [(use.path.relative_to(ROOT), use.line, use.word) for use in uses([ROOT / path])] == []


def test_private_words_are_detected_in_code_and_pages(tmp_path):
    source = tmp_path / "told.py"
    source.write_text(
        'def slope(one):\n    """Return what is told."""\n    found = "hardness"  # beside it\n'
    )
    kinds = Counter(use.kind for use in python_uses(source))
    assert kinds == {"identifier": 4, "string": 2, "comment": 1}
    page = tmp_path / "page.md"
    page.write_text("The refusal names `told` and nought; a crank of one's\nown can go.")
    assert [use.word for use in page_uses(page)] == ["refusal", "nought", "of one's\nown"]


def test_terms_of_the_field_are_accepted():
    names = ("jacobian", "crank_angle", "branch_point", "configuration", "dof_count", "residual")
    for name in (*names, "degrees_of_freedom", "feed_forward"):
        assert private_name(name) is None


def test_left_is_accepted_only_with_right(tmp_path):
    source = tmp_path / "pair.py"
    source.write_text("left = 1\n")
    assert [use.word for use in python_uses(source)] == ["left"]
    source.write_text("left, right = 1, 2\n")
    assert list(python_uses(source)) == []
