"""Progress of long work, with the remaining time from the rate of its latest half."""

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import accumulate
from threading import Event, Thread
from typing import Protocol

from mechsim.cli.exit_codes import print_stderr
from mechsim.cli.output import width
from mechsim.errors import cut

# remaining time in [s] below which it is not reported
SHORT = 5.0
# finished fraction below which the rate says little about the whole
FIRST_FRACTION = 0.1
# latest fraction of the elapsed time that determines the rate, so that the estimate follows its changes
WINDOW = 0.5


class TimeLeft:
    """Estimates the remaining time of work from reports of its finished fraction.

    Args:
        now: start time of the work in [s]; None if the work starts with the first report, after other work.
    """

    def __init__(self, now: float | None = None):
        self._reports: deque[tuple[float, float]] = deque(() if now is None else ((now, 0.0),))
        self._began: float | None = now

    def update(self, fraction: float, now: float) -> float | None:
        """Return the remaining time in [s] after a report of a finished fraction, 0 to 1; None if unknown."""
        reports = self._reports
        if reports and fraction < reports[-1][1]:
            # the work restarted
            reports.clear()
        if not reports:
            self._began = now
        if reports and now == reports[-1][0] and len(reports) > 1:
            reports.pop()
        reports.append((now, fraction))
        began = self._began if self._began is not None else now
        oldest = now - WINDOW * (now - began)
        while len(reports) > 2 and reports[1][0] <= oldest:
            reports.popleft()
        (start, before) = reports[0]
        if not (fraction > before and now > start and fraction >= FIRST_FRACTION):
            return None
        return (1.0 - fraction) * (now - start) / (fraction - before)


def in_words(rest: float | None) -> str:
    """Return a remaining time in [s] in words; empty if it is short or unknown."""
    if rest is None or rest < SHORT:
        return ""
    for unit, seconds in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if rest >= 2.0 * seconds:
            return f"about {rest / seconds:.0f} {unit} left"
    return f"about {rest:.0f} s left"


# delay in [s] of the first line without a terminal, and interval between lines
FIRST, INTERVAL = 3.0, 10.0

# columns reserved for the bar, the elapsed time and "about 59 min left"; longer text is truncated
RESERVED = 34

# silence in [s] after which a command reports that it runs
SILENCE = 20.0
# start of the line, and erase it (ECMA-48, EL)
CLEARED = "\r\x1b[K"

# count, message, finished fraction, remaining time in [s]
Show = Callable[[int, str, float | None, float | None], None]


class Progress(Protocol):
    """Callback after each piece of work."""

    def __call__(self, message: str = "", fraction: float | None = None, /) -> None:
        """Report a message and the finished fraction, 0 to 1; without a fraction, one more finished piece."""
        ...


class _Shown:
    """Time in [s] of the latest sign of progress; infinite while a bar is shown."""

    latest = 0.0


@contextmanager
def reported(command: str) -> Generator[None]:
    """Report the elapsed time of a command while it shows no other progress.

    A terminal has a line that changes every second and vanishes at the end; else there is a line after each
    `SILENCE`.
    """
    start, ended, terminal = time.monotonic(), Event(), sys.stderr.isatty()
    _Shown.latest = start

    def report() -> None:
        while not ended.wait(1.0 if terminal else 0.25 * SILENCE):
            now = time.monotonic()
            if terminal and start + FIRST <= now and not math.isinf(_Shown.latest):
                print(f"{CLEARED}{command}: {now - start:.0f} s", end="", file=sys.stderr, flush=True)
            elif not terminal and now >= _Shown.latest + SILENCE:
                print_stderr(f"{command}: {now - start:.0f} s so far")
                _Shown.latest = now

    thread = Thread(target=report, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        if terminal and time.monotonic() >= start + FIRST:
            thread.join()
            print(CLEARED, end="", file=sys.stderr, flush=True)


@contextmanager
def progress(task: str, total: int | None, *, at_least: bool = False) -> Generator[Progress]:
    """Show the progress of long work on stderr: a bar, or regular lines without a terminal.

    Args:
        task: name of the work.
        total: number of pieces; None if it is unknown.
        at_least: whether reported fractions are lower bounds, from which no time left follows.
    """
    count, by_pieces, by_fraction = 0, TimeLeft(time.monotonic()), TimeLeft()
    with (_bar if sys.stderr.isatty() else _lines)(task, total, at_least) as show:

        def report(message: str = "", fraction: float | None = None) -> None:
            nonlocal count
            count += 1
            now, rest = time.monotonic(), None
            if fraction is not None:
                rest = by_fraction.update(fraction, now)
            elif total:
                rest = by_pieces.update(count / total, now)
            show(count, message, fraction, rest)

        yield report


def sections(report: Progress, shares: Mapping[str, float]) -> list[Callable[[str, float], None]]:
    """Return a progress callback for each part of a command, which together fill one bar.

    Args:
        report: callback of the command.
        shares: name of a part -> its share of the processor time, in any unit.
    """
    whole = sum(shares.values())

    def section(name: str, before: float, message: str, fraction: float) -> None:
        report(f"{name}, {message}" if message else name, (before + shares[name] * fraction) / whole)

    starts = accumulate(shares.values(), initial=0.0)
    return [partial(section, name, before) for name, before in zip(shares, starts, strict=False)]


@contextmanager
def _lines(task: str, total: int | None, at_least: bool) -> Generator[Show]:
    """Yield a function that prints a line at intervals of at least `INTERVAL`."""
    start = time.monotonic()
    due, silent = start + FIRST, True

    def show(count: int, message: str, fraction: float | None, rest: float | None) -> None:
        nonlocal due, silent
        now, remaining = time.monotonic(), "" if at_least else in_words(rest)
        # work that is almost finished needs no line
        if now < due or (silent and not remaining and now <= start + INTERVAL):
            return
        pieces = f"{count} of {total}" if fraction is None and total else ""
        print_stderr(f"{task}: {', '.join(filter(None, [pieces, message, remaining]))}")
        _Shown.latest = now
        due, silent = now + INTERVAL, False

    yield show


@contextmanager
def _bar(task: str, total: int | None, at_least: bool) -> Generator[Show]:
    """Yield a function that updates a bar in the terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *(() if total is None else (MofNCompleteColumn(),)),
        TimeElapsedColumn(),
        TextColumn("{task.fields[rest]}"),
    )
    _Shown.latest = math.inf
    print(CLEARED, end="", file=sys.stderr, flush=True)
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        row = bar.add_task(task, total=total, rest="")

        def show(count: int, message: str, fraction: float | None, rest: float | None) -> None:
            remaining = "" if at_least else in_words(rest)
            whole, finished = (total, count) if fraction is None else (1.0, fraction)
            text = cut(message or task, width() - RESERVED)
            bar.update(row, total=whole, completed=finished, description=text, rest=remaining)

        yield show
    _Shown.latest = time.monotonic()
