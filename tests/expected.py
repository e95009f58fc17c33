"""Expected values as data, in tables of TOML: the path of a value, and what holds for it.

A path names keys, attributes, methods without arguments, numbers of a list and `STEPS`, joined by dots or
as tables in tables; `*` stands for all of a list or a dictionary. `expr:` and a formula of paths in braces is
its value, element by element. What holds is a value, which the actual one equals, or a table:

- `is`: the value, with `rel` and `abs`, the larger of which is the tolerance; exactly without them;
- `reported`: in place of `is` the path of a number that the command printed, with `times`, a factor;
- `CONDITIONS`;
- `of`: a step that is taken before, of all that `*` stands for.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
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


def require_keys(row: Mapping[str, Any], keys: set[str]) -> None:
    """Reject keys of a row that its runner does not read."""
    assert row.keys() <= keys, row.keys() - keys


# steps of a path besides keys, attributes and numbers
STEPS: dict[str, Callable[[Any], Any]] = {
    "len": len,
    "abs": np.abs,
    "ptp": np.ptp,
    "cos": np.cos,
    "text": str,
    "sum": sum,
    "largest": lambda value: max(value, key=abs),
    "unevenness": lambda value: np.ptp(np.diff(value)),
    "rows": lambda columns: len(columns[0]),
}


def select(value: Any, path: str) -> Any:
    """Return the value at a path."""
    if not path:
        return value
    if isinstance(value, Mapping):
        # a key may contain dots
        for key in sorted(map(str, value), key=len, reverse=True):
            if path == key or path.startswith(f"{key}."):
                return select(value[key], path[len(key) + 1 :])
    if path.startswith("expr:"):
        return formula(value, path.removeprefix("expr:"))
    head, _, rest = path.partition(".")
    if head == "*":
        return [select(item, rest) for item in (value.values() if isinstance(value, Mapping) else value)]
    if head in STEPS:
        return select(STEPS[head](value), rest)
    if isinstance(value, Sequence | np.ndarray) and head.lstrip("-").isdigit():
        return select(value[int(head)], rest)
    reached = getattr(value, head)
    return select(reached() if callable(reached) else reached, rest)


def formula(value: Any, text: str) -> Any:
    """Return a formula of arrays, whose paths are in braces, at each of their elements."""
    names = {path: f"x{i}" for i, path in enumerate(re.findall(r"{(.*?)}", text))}
    function = compiled(re.sub(r"{(.*?)}", lambda path: names[path[1]], text), names.values())
    return function({name: select(value, path) for path, name in names.items()})


def normalised(text: str) -> str:
    """Return a text without line breaks and repeated blanks."""
    return " ".join(text.split())


def listed(items: Any) -> list[Any]:
    """Return a list of items, or of a single one."""
    return items if isinstance(items, list) else [items]


def everywhere(compared: Callable[[Any, Any], Any]) -> Callable[[Any, Any], bool]:
    """Return a condition that each of one or more numbers satisfies."""
    return lambda value, limit: np.size(value) > 0 and bool(np.all(compared(np.asarray(value), limit)))


# condition -> whether a value satisfies its number, text or list
CONDITIONS: dict[str, Callable[[Any, Any], bool]] = {
    "above": everywhere(np.greater),
    "below": everywhere(np.less),
    "at_least": everywhere(np.greater_equal),
    "at_most": everywhere(np.less_equal),
    "within": everywhere(lambda value, limit: np.abs(value) <= limit),
    "has": lambda value, items: all(
        (normalised(item) in normalised(value)) if isinstance(value, str) else item in value
        for item in listed(items)
    ),
    "like": lambda value, pattern: re.match(pattern, value) is not None,
    "lacks": lambda value, items: not any(item in value for item in listed(items)),
    "keys": lambda value, keys: list(value) == keys,
    "set_of": lambda value, items: sorted(set(value)) == items,
    "true": lambda value, requested: bool(value) is requested,
}


def plain(value: Any) -> Any:
    """Return arrays and tuples as lists."""
    value = value.tolist() if isinstance(value, np.ndarray) else value
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def equal(value: Any, exact: Any, rel: float = 0.0, absolute: float = 0.0) -> bool:
    """Return whether numbers agree within a tolerance, or values exactly without one."""
    if not rel and not absolute:
        return bool(plain(value) == exact)
    own, right = np.asarray(value, dtype=float), np.asarray(exact, dtype=float)
    limits = np.maximum(absolute, rel * np.abs(right))
    return own.shape == right.shape and bool(np.all(np.abs(own - right) <= limits))


def holds(value: Any, requested: Any, reported: Any = None) -> bool:
    """Return whether a value is the requested one, or satisfies the requested conditions."""
    rest = dict(requested) if isinstance(requested, dict) else {"is": requested}
    value = STEPS[rest.pop("of")](value) if "of" in rest else value
    tolerance = rest.pop("rel", 0.0), rest.pop("abs", 0.0)
    if "reported" in rest:
        rest["is"] = plain(np.multiply(select(reported, rest.pop("reported")), rest.pop("times", 1)))
    right = "is" not in rest or equal(value, rest.pop("is"), *tolerance)
    require_keys(rest, {*CONDITIONS})
    return right and all(CONDITIONS[name](value, limit) for name, limit in rest.items())


def leaves(requested: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the paths of tables in tables, and what holds at each."""
    for key, item in requested.items():
        path = f"{start}.{key}" if start else key
        if isinstance(item, dict) and not item.keys() & {"is", "reported", *CONDITIONS}:
            assert item or not path, f"{path} states no value"
            yield from leaves(item, path)
        else:
            yield path, item


def deviations(value: Any, requested: Any, reported: Any = None) -> list[str]:
    """Return what differs from the expected values at their paths."""
    actual = [(path, select(value, path), item) for path, item in leaves({"": requested})]
    return [f"{path}: {own!r}, not {item}" for path, own, item in actual if not holds(own, item, reported)]
