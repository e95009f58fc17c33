"""Only the catalogue refers to its mechanisms by name; other modules use the protocol of their classes."""

import ast

import pytest
import structure

from mechsim import catalog

FILES = structure.modules()
CATALOG = "mechsim.io.catalog"
# papers 002 to 004 treat one mechanism each, so their theories name it in signatures
PAPERS = {"WarpKnitter", "Rrsrr", "Looper"}
CLASSES = {catalog.mechanism(name).formulas.__name__ for name in catalog.MECHANISMS}
WORDS = {*catalog.MECHANISMS, *CLASSES}


def named(source):
    """Return the catalogue mechanisms that a source names as a string or as a class."""
    if not any(word in source for word in WORDS):
        return set()
    tree = ast.parse(source)
    strings = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    names |= {node.name for node in ast.walk(tree) if isinstance(node, ast.alias)}
    return {item for item in strings if isinstance(item, str)} & {*catalog.MECHANISMS} | names & CLASSES


def test_no_module_outside_the_catalogue_names_a_mechanism():
    sources = {name: path.read_text() for name, path in FILES.items() if not name.startswith(CATALOG)}
    allowed_names = {name: PAPERS if name.startswith("mechsim.papers") else set() for name in sources}
    assert {
        name: wrong for name, text in sources.items() if (wrong := named(text) - allowed_names[name])
    } == {}


@pytest.mark.parametrize(
    ("source", "result"),
    [
        ('if name == "four_bar":\n    pass', {"four_bar"}),
        ("from models.looper import Looper", {"Looper"}),
        ("isinstance(drive, looper.Looper)", {"Looper"}),
        ('"""Like rssr, but planar."""', set()),
    ],
)
def test_the_check_detects_a_mechanism_name(source, result):
    assert named(source) == result
