"""The callback that reports the progress of long work."""

from collections.abc import Callable

# called with a text and the finished fraction, 0 to 1
Progress = Callable[[str, float], None]


def no_progress(_: str, __: float) -> None:
    """Ignore the progress."""
