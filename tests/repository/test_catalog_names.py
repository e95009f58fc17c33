"""A mechanism is asked for by name only in the catalogue; elsewhere its class says what there is to know."""

import ast

import pytest
import structure

from mechsim import catalog

FILES = structure.modules()
CATALOG = "mechsim.analytic.catalog"
# papers 002 to 004 are about one mechanism each, which the signatures of their theories name
PAPERS = {"WarpKnitter", "Rrsrr", "Looper"}
# a table of designs for the stress test, by mechanism
TABLES = {"mechsim.studies.extremes.special_designs"}
CLASSES = {drive.__name__ for drive in catalog.DRIVES.values()}
WORDS = catalog.DRIVES.keys() | CLASSES


def named(source):
    """Return the catalogue mechanisms that stand in a source as a string or as a class."""
    if not any(word in source for word in WORDS):
        return set()
    tree = ast.parse(source)
    strings = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {node.name for node in ast.walk(tree) if isinstance(node, ast.alias)}
    return {item for item in strings if isinstance(item, str)} & catalog.DRIVES.keys() | names & CLASSES


def chosen(source):
    """Return whether a source tells mechanisms apart by their class."""
    if not named(source):
        return False
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    checks = [node for node in calls if isinstance(node.func, ast.Name) and node.func.id == "isinstance"]
    return any(named(ast.unparse(node)) for node in checks)


def test_no_mechanism_is_requested_for_by_name_outside_the_catalogue():
    outside = {name: path for name, path in FILES.items() if not name.startswith(CATALOG)}
    sources = {name: path.read_text() for name, path in outside.items() if name not in TABLES}
    may = {name: PAPERS if name.startswith("mechsim.theory") else set() for name in sources}
    assert {name: wrong for name, text in sources.items() if (wrong := named(text) - may[name])} == {}
    assert [name for name, text in sources.items() if chosen(text)] == []


@pytest.mark.parametrize(
    ("source", "result"),
    [
        ('if name == "four_bar":\n    pass', {"four_bar"}),
        ('CRITICAL = {"rssr": "coupler"}', {"rssr"}),
        ("from mechsim.analytic.catalog import Looper", {"Looper"}),
        ("isinstance(drive, looper.Looper)", {"Looper"}),
        ('"""Like rssr, but planar."""', set()),
        ('help = "as in mechsim show rssr"', set()),
    ],
)
def test_the_check_sees_a_mechanism_requested_for_by_name(source, result):
    assert named(source) == result


def test_the_check_sees_a_choice_by_class():
    assert chosen("isinstance(drive, Looper)")
    assert not chosen("isinstance(drive, ClosedForm)")
