"""`validation/mutation.py` names files, tests and lines that exist."""

import ast

import pytest
from mutants import EQUIVALENT
from mutation import ROOT, TESTS


@pytest.mark.parametrize("file", TESTS)
def test_a_core_file_and_its_tests_exist(file):
    assert (ROOT / "mechsim" / file).is_file()
    for name in TESTS[file]:
        path, _, function = name.partition("::")
        assert (ROOT / "tests" / path).exists(), path
        assert not function or f"def {function}(" in (ROOT / "tests" / path).read_text(), name


@pytest.mark.parametrize("file", sorted({file for file, _, _ in EQUIVALENT}))
def test_lines_of_equivalent_mutants_exist(file):
    lines = ast.unparse(ast.parse((ROOT / "mechsim" / file).read_text())).splitlines()
    present = {line.strip() for line in lines}
    changes = [(before, after) for name, before, after in EQUIVALENT if name == file]
    assert {before for before, _ in changes} <= present
    assert all(before != after for before, after in changes)
