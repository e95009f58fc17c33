"""Limits of memory, checked before work starts, budgets of time, and the progress of long work."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter, process_time

from mechsim.errors import BudgetError, InputError

# largest fraction of the free memory that one task may use
MAX_FRACTION = 0.7
# the same of the address space under `ulimit -v`, half of which allocators reserve without use
MAX_ADDRESS_FRACTION = 0.4
MEMORY_INFO = Path("/proc/meminfo")
# memory of this process in pages; the first number is its address space
PROCESS_MEMORY = Path("/proc/self/statm")
# memory of a container: files with its limit and its use
CONTAINER_MEMORY = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def available_memory() -> float:
    """Return the bytes of memory that a task may use, by machine, container or `ulimit -v`."""
    free = float("inf")
    with suppress(OSError, ValueError, IndexError):
        line = next(row for row in MEMORY_INFO.read_text().splitlines() if row.startswith("MemAvailable"))
        free = 1024.0 * float(line.split()[1])
    if free == float("inf"):
        with suppress(OSError, ValueError, AttributeError):
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, used in CONTAINER_MEMORY:
        with suppress(OSError, ValueError):
            free = min(free, float(Path(limit).read_text()) - float(Path(used).read_text()))
    return min(MAX_FRACTION * free, MAX_ADDRESS_FRACTION * _address_space())


def _address_space() -> float:
    """Return the bytes of address space left by `ulimit -v`; infinite without a limit."""
    # Windows has no such module
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = float(PROCESS_MEMORY.read_text().split()[0])
            return max(0.0, limit - pages * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def require_memory(what: str, count: float, each: float, remedy: str = "") -> None:
    """Raise InputError if a number of items does not fit into memory.

    Args:
        what: the items, for the message, such as "1,440,000 instants".
        count: number of items.
        each: bytes per item.
        remedy: what to do, with `{most}` for the number that would fit.
    """
    free = available_memory()
    if count * each > free:
        most = f"{int(free / each):,}"
        raise InputError(
            f"{what} would take {size_text(count * each)} of memory, and {size_text(free)} are available; "
            + (remedy.format(most=most) or f"use {most} at most")
        )


def size_text(bytes_: float) -> str:
    """Return a size in bytes as text."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if bytes_ >= scale:
            return f"{bytes_ / scale:.3g} {unit}"
    return f"{bytes_ / 1e3:.3g} kB"


@dataclass(frozen=True, slots=True)
class Budget:
    """Time that may be spent, by a clock.

    Attributes:
        seconds: all of it.
        start: reading of the clock at which it begins; None for now.
        now: reads the wall clock in [s]; tests pass their own.
    """

    seconds: float
    start: float | None = None
    now: Callable[[], float] = field(default_factory=lambda: perf_counter)

    def __post_init__(self) -> None:
        """Read the clock if no start is given."""
        if self.start is None:
            object.__setattr__(self, "start", self.now())

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        assert self.start is not None
        return self.now() - self.start

    @property
    def remaining(self) -> float:
        """Seconds left; negative after the end."""
        return self.seconds - self.spent

    @property
    def fraction(self) -> float:
        """The spent fraction, 0 to 1."""
        return min(1.0, self.spent / self.seconds)

    def share(self, fraction: float) -> "Budget":
        """Return a budget that starts now, with a fraction of the seconds."""
        return replace(self, seconds=fraction * self.seconds, start=None)


@dataclass(frozen=True, slots=True)
class ProcessorBudget(Budget):
    """A budget of processor time of all threads: results do not depend on other processes of the machine."""

    now: Callable[[], float] = field(default_factory=lambda: process_time)

    def affords(self, seconds: float) -> bool:
        """Whether work of some seconds would end within the budget."""
        return seconds <= self.remaining

    def require_left(self, progress: str) -> None:
        """Raise BudgetError if the budget is exhausted; `progress` is the progress of the work in words."""
        if self.remaining < 0.0:
            raise BudgetError(
                f"{self.ended}: it reached {progress}; give a larger --budget or a shorter motion"
            )

    @property
    def ended(self) -> str:
        """Start of a sentence about the exhausted budget."""
        return f"not converged within the budget of {self.seconds:g} s of processor time"


# called with a text and the finished fraction, 0 to 1
Progress = Callable[[str, float], None]


def no_progress(_: str, __: float) -> None:
    """Ignore the progress."""
