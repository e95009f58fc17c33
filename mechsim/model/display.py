"""How a record of many numbers shows itself: names, shapes and extents in a few lines, no arrays."""

import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

import numpy as np

WIDTH = 100
# texts longer than this are cut
LONGEST = 60


def short_repr(self: Any) -> str:
    """Return a record's fields, but those still at their default; made to be a dataclass's `__repr__`."""
    shown = [f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if not _default(f, self)]
    whole = f"{type(self).__name__}({', '.join(shown)})"
    return "\n".join(textwrap.wrap(whole, WIDTH, subsequent_indent="  ", break_long_words=False))


def _default(field: Any, record: Any) -> bool:
    value = getattr(record, field.name)
    plain = value is None or isinstance(value, str | int | float | tuple | frozenset | Mapping)
    if field.default_factory is not MISSING:
        return plain and value == field.default_factory()
    return field.default is not MISSING and plain and value == field.default


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(str(key) for key in value) + "}"
    if isinstance(value, tuple | list) and len(value) and all(is_dataclass(one) for one in value):
        return "(" + ", ".join(str(getattr(one, "name", type(one).__name__)) for one in value) + ")"
    if is_dataclass(value) or callable(value):
        return f"<{getattr(value, '__name__', type(value).__name__)}>"
    if isinstance(value, float):
        return f"{value:.6g}"
    return textwrap.shorten(repr(value), LONGEST, placeholder=" ...")


def _array(values: "np.ndarray[Any, Any]") -> str:
    if values.dtype.kind not in "fiu" or not values.size:
        return f"<array {values.shape}>"
    with np.errstate(invalid="ignore"):
        low, high = values.min(), values.max()
    return f"<{values.shape}: {low:.4g}>" if low == high else f"<{values.shape}: {low:.4g} to {high:.4g}>"
