"""Numbers of function calls: a cost that does not depend on the machine."""

import sys
from collections.abc import Callable


def calls(function: Callable[[], object]) -> int:
    """Return the number of calls of Python and C functions by a function, returns included."""
    counted, before = 0, sys.getprofile()

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal counted
        counted += 1

    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(before)
    return counted
