"""Estimates of the remaining time, with a clock set by the tests."""

import time
from io import StringIO

import pytest

from mechsim.cli.progress import TimeLeft, reported, sections


def ratios(reports, start, after):
    """Return estimates of the remaining time in units of the true one, after some time."""
    estimator, end = TimeLeft(start), reports[-1][0]
    estimates = [(now, estimator.update(fraction, now)) for now, fraction in reports[:-1]]
    return [estimate / (end - now) for now, estimate in estimates if estimate is not None and now > after]


def test_a_slow_start_does_not_spoil_the_estimate():
    # 10 s for the first piece, as with library loading and compilation, then 0.1 s each
    late = ratios([(10.0 + 0.1 * i, i / 500) for i in range(501)], None, 12.0)
    assert late == pytest.approx([1.0] * len(late), rel=0.01)
    # the same with several slow first pieces
    slow = [(5.0 * i if i < 5 else 19.6 + 0.1 * i, i / 500) for i in range(1, 501)]
    assert 0.5 < min(ratios(slow, 0.0, 45.0)) <= max(ratios(slow, 0.0, 45.0)) < 2.0


def test_parts_of_a_command_fill_one_bar_in_order():
    reported = []

    def report(message: str = "", fraction: float | None = None, /):
        reported.append((message, fraction))

    check, draw = sections(report, {"check": 1.0, "draw": 9.0})
    for section, message, fraction in (
        (check, "", 0.5),
        (check, "", 1.0),
        (draw, "rssr", 0.5),
        (draw, "", 1.0),
    ):
        section(message, fraction)
    assert [text for text, _ in reported] == ["check", "check", "draw, rssr", "draw"]
    assert [fraction for _, fraction in reported] == pytest.approx([0.05, 0.1, 0.55, 1.0])


def test_a_terminal_shows_the_elapsed_time_in_one_line_that_vanishes(monkeypatch):
    terminal = StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("mechsim.cli.progress.FIRST", 0.0)
    with reported("show"):
        time.sleep(1.2)
    erased = "\r\x1b[K"
    assert terminal.getvalue() == f"{erased}show: 1 s{erased}"
