"""Tests use only public names."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]


def is_private(name: str) -> bool:
    """Return whether a component of a dotted name is private: `_repr_html_` and `__all__` are protocols."""
    return any(component.startswith("_") and not component.endswith("_") for component in name.split("."))


def private_names(source: str) -> list[str]:
    """Return the private names of other modules that a source imports, reads or replaces."""
    result = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom | ast.Import):
            module = getattr(node, "module", None) or ""
            result += [name for name in (module, *(item.name for item in node.names)) if is_private(name)]
        elif isinstance(node, ast.Attribute) and is_private(node.attr):
            if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                result.append(node.attr)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            if called in ("setattr", "delattr", "getattr", "hasattr"):
                words = [item.value for item in node.args if isinstance(item, ast.Constant)]
                result += [word for word in words if isinstance(word, str) and is_private(word)]
    return result


def test_no_test_uses_private_names():
    result = {
        path.relative_to(TESTS).as_posix(): private_names(path.read_text()) for path in TESTS.rglob("*.py")
    }
    assert {path: names for path, names in result.items() if names} == {}


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("from mechsim.errors import _told", ["_told"]),
        ("path._closed(1)", ["_closed"]),
        ("monkeypatch.setattr(loops, '_look', None)", ["_look"]),
        ("monkeypatch.setattr('mechsim.cli.export._text', None)", ["mechsim.cli.export._text"]),
        ("class A:\n    def f(self):\n        return self._kept", []),
        ("hasattr(value, '_repr_html_'), value.__dict__, '_private text'", []),
    ],
)
def test_the_check_detects_private_names(source, names):
    assert private_names(source) == names
