"""Identifiers, strings, comments and pages use the terms of the field; none is a private word."""

import ast
from collections import Counter
from pathlib import Path

from readability.private_words import WORDS, page_uses, private_name, python_uses, uses

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "mechsim", ROOT / "docs", ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted((ROOT / "validation").glob("*.md"))


def test_package_and_documentation_use_no_private_words():
    assert [(use.path.relative_to(ROOT), use.line, use.word) for use in uses(PAGES)] == []


def names_of_tests():
    for path in sorted((ROOT / "tests").rglob("*.py")):
        yield path.stem
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield node.name


def test_names_of_tests_and_scripts_have_no_private_words():
    names = [*names_of_tests(), *(path.stem for path in (ROOT / "validation").rglob("*.py"))]
    assert [name for name in names if {*name.split("_")} & WORDS.keys()] == []


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
    for name in ("jacobian", "crank_angle", "branch_point", "configuration", "dof_count", "residual"):
        assert private_name(name) is None
