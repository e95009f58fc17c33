"""How long work goes on: estimated from the rate of its latest half."""

from collections import deque

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
