"""Limits of memory and processor time, checked before work starts."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

from mechsim.errors import BudgetError, InputError

# of the memory that is free, what one piece of work may take
MAX_FRACTION = 0.7
# and of the address space under `ulimit -v`: about half of that is reserved by allocators and never used
ADDRESSABLE = 0.4
PROCESS = Path("/proc/meminfo")
# of this process, in pages; the first number is the address space it takes
OWN = Path("/proc/self/statm")
# of a container: what it may take, and what it has taken
GROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


def available_memory() -> float:
    """Return the bytes of memory that one piece of work may take: of machine, container or `ulimit -v`."""
    free = float("inf")
    with suppress(OSError, ValueError, IndexError):
        line = next(row for row in PROCESS.read_text().splitlines() if row.startswith("MemAvailable"))
        free = 1024.0 * float(line.split()[1])
    if free == float("inf"):
        with suppress(OSError, ValueError, AttributeError):
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit, used in GROUPS:
        with suppress(OSError, ValueError):
            free = min(free, float(Path(limit).read_text()) - float(Path(used).read_text()))
    return min(MAX_FRACTION * free, ADDRESSABLE * _address_space())


def _address_space() -> float:
    """Return the bytes of address space that `ulimit -v` leaves this process; infinite without a limit."""
    # no such module on Windows
    with suppress(ImportError, OSError, ValueError, IndexError):
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = float(OWN.read_text().split()[0])
            return max(0.0, limit - pages * os.sysconf("SC_PAGE_SIZE"))
    return float("inf")


def require_memory(what: str, count: float, each: float, remedy: str = "") -> None:
    """Raise InputError where so many things, of so many bytes each, do not fit into memory.

    Args:
        what: they are, as the sentence says it: "1,440,000 instants".
        count: of them.
        each: bytes that one of them takes.
        remedy: what to do, with `{most}` for how many would fit.
    """
    free = available_memory()
    if count * each > free:
        most = f"{int(free / each):,}"
        raise InputError(
            f"{what} would take {size_text(count * each)} of memory, and {size_text(free)} are available; "
            + (remedy.format(most=most) or f"take {most} at the most")
        )


def size_text(bytes_: float) -> str:
    """Return a size in words."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if bytes_ >= scale:
            return f"{bytes_ / scale:.3g} {unit}"
    return f"{bytes_ / 1e3:.3g} kB"


@dataclass
class ProcessorBudget:
    """What work may take of the processor, so that a result does not depend on what else the machine does.

    Attributes:
        seconds: of processor time, of all threads.
        processor_time: gives processor time in [s].
        began: processor time at which the budget started.
    """

    seconds: float
    processor_time: Callable[[], float] = process_time
    began: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin to run."""
        self.began = self.processor_time()

    @property
    def spent(self) -> float:
        """What was taken so far, in [s]."""
        return self.processor_time() - self.began

    def affords(self, seconds: float) -> bool:
        """Return whether work of some seconds would end within the budget."""
        return self.spent + seconds <= self.seconds

    def require_left(self, progress: str) -> None:
        """Raise BudgetError where the budget is spent; `progress` says how far the work has come."""
        if self.spent > self.seconds:
            raise BudgetError(
                f"{self.ended}: it reached {progress}; give a larger --budget or a shorter motion"
            )

    @property
    def ended(self) -> str:
        """How a sentence begins that reports the end of the budget."""
        return f"not converged within the budget of {self.seconds:g} s of processor time"
