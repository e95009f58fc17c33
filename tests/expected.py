"""Expected values as data, in tables of TOML: the path of a value, and what holds for it.

A path names keys, attributes and numbers of a list, joined by dots; `*` stands for all of a list or a
dictionary. `expr:` and a formula of paths in braces is its value, element by element. What holds is a value,
which the actual one equals, or a table of the conditions below, all of which hold.
"""

import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mechsim.mechanism.expressions import compiled

PLAIN_MARKERS = {"long": pytest.mark.long, "slow": pytest.mark.slow}


def row_parameters(
    folder: str, name: str, markers: Mapping[str, pytest.MarkDecorator] = PLAIN_MARKERS
) -> list[Any]:
    """Return the tests in the tables of a folder of `tests/`, each a list of its rows of a name.

    A row with `test` starts a test, by its sentence; rows without one continue it.
    """
    tests: list[list[dict[str, Any]]] = []
    for path in sorted((Path(__file__).parent / folder).glob("*.toml")):
        for row in tomllib.loads(path.read_text(encoding="utf-8"))[name]:
            if "test" in row:
                tests.append([])
            tests[-1].append(row)
    return [
        pytest.param(rows, id=rows[0]["test"], marks=[markers[key] for key in rows[0].get("markers", [])])
        for rows in tests
    ]


def select(value: Any, path: str) -> Any:
    """Return the value at a path."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not path:
        return [select(item, "") for item in value] if isinstance(value, list | tuple) else value
    if isinstance(value, dict):
        # a key may contain dots
        for key in sorted(map(str, value), key=len, reverse=True):
            if path == key or path.startswith(f"{key}."):
                return select(value[key], path[len(key) + 1 :])
    if path.startswith("expr:"):
        return formula(value, path.removeprefix("expr:"))
    head, _, rest = path.partition(".")
    if head == "*":
        return [select(item, rest) for item in (value.values() if isinstance(value, dict) else value)]
    if isinstance(value, list | tuple) and head.lstrip("-").isdigit():
        return select(value[int(head)], rest)
    assert not isinstance(value, dict), f"no {path} in {[*value]}"
    return select(getattr(value, head), rest)


def formula(value: Any, text: str) -> list[float]:
    """Return a formula of arrays, whose paths are in braces, at each of their elements."""
    names = {path: f"x{i}" for i, path in enumerate(re.findall(r"{(.*?)}", text))}
    function = compiled(re.sub(r"{(.*?)}", lambda path: names[path[1]], text), names.values())
    return function({name: select(value, path) for path, name in names.items()}).tolist()


def normalised(text: str) -> str:
    """Return a text without line breaks and repeated blanks."""
    return " ".join(text.split())


# condition -> whether a value satisfies its number, text or list
CONDITIONS: dict[str, Callable[[Any, Any], bool]] = {
    "above": lambda value, limit: bool(np.all(np.array(value) > limit)),
    "below": lambda value, limit: bool(np.all(np.array(value) < limit)),
    "at_least": lambda value, limit: bool(np.all(np.array(value) >= limit)),
    "at_most": lambda value, limit: bool(np.all(np.array(value) <= limit)),
    "within": lambda value, limit: bool(np.all(np.abs(value) <= limit)),
    "has": lambda value, items: all(
        (normalised(item) in normalised(value)) if isinstance(value, str) else item in value
        for item in ([items] if isinstance(items, str) else items)
    ),
    "like": lambda value, pattern: re.match(pattern, value) is not None,
    "lacks": lambda value, items: not any(item in value for item in items),
    "keys": lambda value, keys: list(value) == keys,
    "set_of": lambda value, items: sorted(set(value)) == items,
    "true": lambda value, requested: bool(value) is requested,
}
# what is taken of the values of a list before they are compared
REDUCTIONS: dict[str, Callable[[Any], Any]] = {
    "length": len,
    "largest": lambda value: max(value, key=abs),
    "sum": sum,
    "rows": lambda columns: len(columns[0]),
    "range": lambda value: float(np.ptp(value)),
    "unevenness": lambda value: float(np.ptp(np.diff(value))),
}


def holds(value: Any, requested: Any, reported: Any = None) -> bool:
    """Return whether a value is the requested one, or satisfies the requested conditions.

    The requested value `json` is the path of one of the reported ones.
    """
    if not isinstance(requested, dict):
        return bool(value == requested)
    rest = dict(requested)
    if reduction := rest.pop("of", None):
        value = REDUCTIONS[reduction](value)
    tolerance = {name: rest.pop(name) for name in ("rel", "abs") if name in rest}
    assert rest, f"{requested} states no value"
    if "json" in rest:
        rest["is"] = select(reported, rest.pop("json")) * rest.pop("times", 1)
    if "is" in rest:
        target = rest.pop("is")
        if not (value == pytest.approx(target, **tolerance) if tolerance else value == target):
            return False
    return all(CONDITIONS[name](value, limit) for name, limit in rest.items())


def deviations(value: Any, requested: dict[str, Any], reported: Any = None) -> list[str]:
    """Return what differs from a table of paths and expected values."""
    actual = {path: select(value, path) for path in requested}
    return [
        f"{path}: {actual[path]!r}, not {requested[path]}"
        for path in requested
        if not holds(actual[path], requested[path], reported)
    ]
