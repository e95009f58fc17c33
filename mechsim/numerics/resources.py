"""What a piece of work will hold in memory: refused before it is begun where there is no room for it."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

from mechsim.errors import BudgetError, InputError

# of the memory that is free, what one piece of work may take
PART = 0.7
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


def room() -> float:
    """Return the bytes of memory that one piece of work may take: of machine, container or `ulimit -v`."""
    free = float("inf")
    with suppress(OSError, ValueError, IndexError):
        line = next(one for one in PROCESS.read_text().splitlines() if one.startswith("MemAvailable"))
        free = 1024.0 * float(line.split()[1])
    if free == float("inf"):
        with suppress(OSError, ValueError, AttributeError):
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for most, taken in GROUPS:
        with suppress(OSError, ValueError):
            free = min(free, float(Path(most).read_text()) - float(Path(taken).read_text()))
    return min(PART * free, ADDRESSABLE * _address_space())


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


def require_room(what: str, count: float, each: float, remedy: str = "") -> None:
    """Raise InputError where so many things, of so many bytes each, do not fit into memory.

    Args:
        what: they are, as the sentence says it: "1,440,000 instants".
        count: of them.
        each: bytes that one of them takes.
        remedy: what to do, with `{most}` for how many would fit.
    """
    free = room()
    if count * each > free:
        most = f"{int(free / each):,}"
        raise InputError(
            f"{what} would take {said(count * each)} of memory, and {said(free)} are to be had; "
            + (remedy.format(most=most) or f"take {most} at the most")
        )


def said(bytes_: float) -> str:
    """Return a size in words."""
    for unit, one in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if bytes_ >= one:
            return f"{bytes_ / one:.3g} {unit}"
    return f"{bytes_ / 1e3:.3g} kB"


@dataclass
class ProcessorBudget:
    """What work may take of the processor, so that a result does not depend on what else the machine does.

    Attributes:
        seconds: of processor time, of all threads.
        clock: gives processor time in [s].
        began: when the budget began to run, by the clock.
    """

    seconds: float
    clock: Callable[[], float] = process_time
    began: float = field(init=False)

    def __post_init__(self) -> None:
        """Begin to run."""
        self.began = self.clock()

    @property
    def spent(self) -> float:
        """What was taken so far, in [s]."""
        return self.clock() - self.began

    def affords(self, seconds: float) -> bool:
        """Return whether work of some seconds would end within the budget."""
        return self.spent + seconds <= self.seconds

    def require_left(self, done: str) -> None:
        """Raise BudgetError where the budget is spent; `done` is how far the work has come, in words."""
        if self.spent > self.seconds:
            raise BudgetError(f"{self.ended}: it reached {done}; give a larger --budget or a shorter motion")

    @property
    def ended(self) -> str:
        """How a sentence begins that reports the end of the budget."""
        return f"not converged within the budget of {self.seconds:g} s of processor time"
