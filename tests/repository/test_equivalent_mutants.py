"""Lines listed for equivalent mutants still exist."""

import ast
from functools import cache

import structure
from equivalent_mutants import EQUIVALENT


@cache
def lines(file):
    tree = ast.parse((structure.PACKAGE / file).read_text())
    return {line.strip() for line in ast.unparse(tree).splitlines()}


def test_every_equivalent_mutant_changes_an_existing_line():
    assert [(file, line) for file, line, _ in EQUIVALENT if line not in lines(file)] == []
    assert all(before != after for _, before, after in EQUIVALENT)
