"""Which rows of a grid over mechanisms run every time, and which in `make test-all` only."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest

# planar, spatial, overconstrained
ALWAYS = ("four_bar", "rssr", "bennett")


def grid(rows: Iterable[Any], always: Sequence[str] = ALWAYS) -> list[Any]:
    """Return rows to parametrise a test by: those whose first word is not in `always` are slow.

    Args:
        rows: names, or tuples that begin with a name; a name may have more words, as "four_bar swinging".
        always: the names whose rows run every time.
    """
    result = []
    for row in rows:
        values = row if isinstance(row, tuple) else (row,)
        result.append(
            row if str(values[0]).split()[0] in always else pytest.param(*values, marks=pytest.mark.slow)
        )
    return result
