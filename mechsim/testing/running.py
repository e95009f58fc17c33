"""The running test: where its reports go and what it records; the plugin sets it."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class RunningTest:
    """A test that runs.

    Attributes:
        name: by which pytest selects it.
        folder: where a report may be written; made when it is.
        record: takes a name and a value, for JUnit files.
    """

    name: str
    folder: Path
    record: Callable[[str, object], None]


RUNNING: ContextVar[RunningTest | None] = ContextVar("RUNNING", default=None)
