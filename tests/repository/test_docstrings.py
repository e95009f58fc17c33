"""Docstrings name only existing attributes and parameters."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

SOURCES = sorted((Path(__file__).parents[2] / "mechsim").rglob("*.py"))


def documented(node: ast.ClassDef | ast.FunctionDef, heading: str) -> list[str]:
    """Return the names that a section of a docstring describes."""
    section = re.search(
        rf"^{heading}:\n((?: .*\n|\n)+)", (ast.get_docstring(node) or "") + "\n", re.MULTILINE
    )
    rows = re.findall(r"^    (\*{0,2}\w[\w, *]*?)(?: \(.*?\))?:", section[1], re.MULTILINE) if section else []
    return [name.strip(" *") for row in rows for name in row.split(",")]


def attributes(node: ast.ClassDef) -> set[str]:
    """Return fields, properties and methods of a class, and attributes that its methods set."""
    names = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
    for item in ast.walk(node):
        if isinstance(item, ast.AnnAssign | ast.Assign):
            targets = [item.target] if isinstance(item, ast.AnnAssign) else item.targets
            names |= {
                target_node.id
                for target in targets
                for target_node in ast.walk(target)
                if isinstance(target_node, ast.Name)
            }
        elif isinstance(item, ast.Attribute) and isinstance(item.ctx, ast.Store):
            names.add(item.attr)
    return names


def parameters(node: ast.FunctionDef) -> set[str]:
    """Return the parameters of a function."""
    return {item.arg for item in ast.walk(node.args) if isinstance(item, ast.arg)}


def unknown(tree: ast.Module) -> Iterator[str]:
    """Yield each documented name of a module that its class or function does not have."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and not node.bases:
            stale = set(documented(node, "Attributes")) - attributes(node)
        elif isinstance(node, ast.FunctionDef):
            stale = set(documented(node, "Args")) - parameters(node)
        else:
            continue
        yield from (f"{node.name}: {name}" for name in sorted(stale))


def test_every_documented_name_exists():
    assert [f"{path.name}: {name}" for path in SOURCES for name in unknown(ast.parse(path.read_text()))] == []


def test_a_documented_unknown_name_is_detected():
    source = '''
class Gear:
    """A gear.
    Attributes:
        teeth: their number.
        module: of the teeth in [m].
    """
    teeth: int
def mesh(a, *others):
    """Return the ratio.
    Args:
        a: first gear.
        others, b: gears that follow.
    """
'''
    assert list(unknown(ast.parse(source))) == ["Gear: module", "mesh: b"]
