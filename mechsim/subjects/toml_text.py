"""Names, numbers and lists as TOML has them."""

import json
import re
from collections.abc import Iterable

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def listed(values: Iterable[float]) -> str:
    """Return numbers as a list."""
    return f"[{', '.join(number(value) for value in values)}]"


def number(value: float) -> str:
    """Return a number that reads back to the last bit."""
    text = f"{float(value):.17g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def quoted(value: str) -> str:
    """Return text in quotes."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("\x7f", "\\u007f")


def key(name: str) -> str:
    """Return a name as a key."""
    return name if _BARE.fullmatch(name) else quoted(name)
