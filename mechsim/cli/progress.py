"""How long work goes on: estimated from the rate of its latest half."""

import sys
import time
from collections import deque
from collections.abc import Generator
from contextlib import contextmanager
from typing import Protocol

from mechsim.cli.exit_codes import tell

# a shorter rest, in [s], is not reported
SHORT = 5.0
# part of the time worked so far over which the rate is taken: work that speeds up or slows down is followed
WINDOW = 0.5


class TimeLeft:
    """Estimates the rest of work whose finished fraction is reported now and then.

    Args:
        now: a time in [s] at which the work begins; None where only the first report begins it, because
            other work comes before.
    """

    def __init__(self, now: float | None = None):
        self._reports: deque[tuple[float, float]] = deque(() if now is None else ((now, 0.0),))
        self._began: float | None = now

    def update(self, fraction: float, now: float) -> float | None:
        """Return the rest in [s] after a report of the finished fraction, 0 to 1; None while unknown."""
        reports = self._reports
        if reports and fraction < reports[-1][1]:
            # begun again
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
        (start, before), done = reports[0], fraction
        if not (done > before and now > start):
            return None
        return (1.0 - done) * (now - start) / (done - before)


def in_words(rest: float | None) -> str:
    """Return a rest in [s] in words; empty where it is short or unknown."""
    if rest is None or rest < SHORT:
        return ""
    for unit, one in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if rest >= 2.0 * one:
            return f"about {rest / one:.0f} {unit} left"
    return f"about {rest:.0f} s left"


# before the first line of progress where there is no terminal, and between two
FIRST, SECONDS = 3.0, 10.0


class Tick(Protocol):
    """Called after each piece of work, with what was done and what part of the whole that makes."""

    def __call__(self, done: str = "", part: float | None = None, /) -> None:
        """Advance to a part of the whole, 0 to 1; by one of the total where none is told."""
        ...


def _nothing(done: str = "", part: float | None = None) -> None:
    pass


def _lines(what: str, total: int | None, limit: str) -> Tick:
    """Return a tick that prints a line when the last one is long past."""
    count, begun = 0, time.monotonic()
    due, quiet = begun + FIRST, True
    counted, told = TimeLeft(begun), TimeLeft()

    def tick(done: str = "", part: float | None = None) -> None:
        nonlocal count, due, quiet
        count += 1
        now = time.monotonic()
        far = [f"{count} of {total}"] if part is None and total else []
        if part is not None:
            rest = in_words(told.update(part, now))
        else:
            rest = in_words(counted.update(count / total, now)) if total else ""
        if now < due:
            return
        rest = f"{rest}{limit}" if rest else ""
        # what is over in a moment needs no line
        if rest or not quiet or now > begun + SECONDS:
            tell(f"{what}: {', '.join(filter(None, [*far, done, rest]))}")
            due, quiet = now + SECONDS, False

    return tick


@contextmanager
def progress(what: str, total: int | None, *, quiet: bool = False, at_least: bool = False) -> Generator[Tick]:
    """Show on stderr how far long work has come: a bar, or a line now and then where there is no terminal.

    `at_least`: the parts told are the least that may be done, so that what is left is so much at the most.
    """
    if quiet:
        yield _nothing
        return
    if not sys.stderr.isatty():
        yield _lines(what, total, " at the most" if at_least else "")
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    far = () if total is None else (MofNCompleteColumn(),)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *far,
        TimeElapsedColumn(),
        TextColumn("{task.fields[rest]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total, rest="")
        count, counted, told = 0, TimeLeft(time.monotonic()), TimeLeft()

        def tick(done: str = "", part: float | None = None) -> None:
            nonlocal count
            count += 1
            now = time.monotonic()
            if part is None:
                rest = counted.update(count / total, now) if total else None
                bar.update(task, advance=1, description=done or what, rest=in_words(rest))
            else:
                rest = None if at_least else told.update(part, now)
                bar.update(task, total=1.0, completed=part, description=done or what, rest=in_words(rest))

        yield tick
