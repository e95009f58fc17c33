"""Numbers of function calls: a cost that does not depend on the machine."""

import cProfile
import pstats
from collections.abc import Callable


def calls(function: Callable[[], object]) -> int:
    """Return the number of calls of Python and C functions by a function."""
    profile = cProfile.Profile()
    profile.runcall(function)
    return pstats.Stats(profile).total_calls
