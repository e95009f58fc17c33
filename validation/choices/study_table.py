"""A table of the results of a study."""

from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]


def show(rows: Sequence[Row]) -> None:
    """Print rows as a table, floats with two digits."""
    columns = list(rows[0])
    entries = [[_text(row[column]) for column in columns] for row in rows]
    widths = [max(len(column), *(len(line[i]) for line in entries)) for i, column in enumerate(columns)]
    for line in [columns, *entries]:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())


def _text(value: Any) -> str:
    return f"{value:.1e}" if isinstance(value, float) else str(value)
