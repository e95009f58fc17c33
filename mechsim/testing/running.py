"""The running test and what it records; the plugin sets it."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RunningTest:
    """A running test.

    Attributes:
        name: its name for pytest.
        record: records a name and a value, for JUnit files.
    """

    name: str
    record: Callable[[str, object], None]


RUNNING: ContextVar[RunningTest | None] = ContextVar("RUNNING", default=None)
