"""What the trade-off scripts share: an output folder, a table on the screen, the same as CSV."""

import argparse
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]


def folder(purpose: str) -> Path | None:
    """Return the folder given by --out, made if need be; None if none was given."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--out", type=Path, help="folder for the table as CSV")
    out: Path | None = parser.parse_args().out
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    return out


def show(rows: Sequence[Row], out: Path | None, name: str) -> None:
    """Print rows as a table, floats with two digits; write them to a CSV file where a folder is given."""
    columns = list(rows[0])
    entries = [[_text(row[column]) for column in columns] for row in rows]
    widths = [max(len(column), *(len(line[i]) for line in entries)) for i, column in enumerate(columns)]
    for line in [columns, *entries]:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())
    if out is not None:
        with (out / f"{name}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)


def _text(value: Any) -> str:
    return f"{value:.1e}" if isinstance(value, float) else str(value)
