"""Columns of measured tables: one marked with ± holds the standard deviations of another."""

# before or after the name of a quantity
MARKS = ("±", "+-")


def deviation_of(name: str) -> str | None:
    """Return the quantity whose standard deviation a column holds; None for other columns."""
    for mark in MARKS:
        if name.startswith(mark) or name.endswith(mark):
            return name.removeprefix(mark).removesuffix(mark).strip()
    return None
