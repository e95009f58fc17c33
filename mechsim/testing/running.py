"""The running test: where its reports go and what it records; the plugin sets it."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class RunningTest:
    """A running test.

    Attributes:
        name: its name for pytest.
        folder: folder of its report; created when needed.
        record: records a name and a value, for JUnit files.
    """

    name: str
    folder: Path
    record: Callable[[str, object], None]


RUNNING: ContextVar[RunningTest | None] = ContextVar("RUNNING", default=None)
