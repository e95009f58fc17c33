"""Estimates of the remaining time, with a clock set by the tests."""

import time
from io import StringIO

import pytest

from mechsim.cli.progress import TimeLeft, reported, sections


def worst_ratio(reports: list[tuple[float, float]], start: float | None = 0.0) -> float:
    """Return the largest error factor of the estimates after the first fifth of the work."""
    estimator, end, worst = TimeLeft(start), reports[-1][0], 1.0
    for now, fraction in reports[:-1]:
        remaining = estimator.update(fraction, now)
        if remaining is not None and now > 0.2 * end:
            worst = max(worst, remaining / (end - now), (end - now) / remaining)
    return worst


def test_uniform_work_is_estimated_exactly() -> None:
    assert worst_ratio([(2.0 * i, i / 50) for i in range(1, 51)]) == pytest.approx(1.0)


def test_a_slow_start_does_not_spoil_the_estimate() -> None:
    # 10 s for the first piece, as with library loading and compilation, then 0.1 s each
    reports = [(10.0 + 0.1 * i, i / 500) for i in range(501)]
    assert worst_ratio(reports, None) < 1.01
    # the same with several slow first pieces
    slow = [(5.0 * i, i / 500) for i in range(1, 5)] + [
        (20.0 + 0.1 * i, (4 + i) / 500) for i in range(1, 497)
    ]
    estimator, late_ratios = TimeLeft(0.0), []
    for now, fraction in slow[:-1]:
        remaining = estimator.update(fraction, now)
        if now > 45.0 and remaining is not None:
            late_ratios.append(remaining / (slow[-1][0] - now))
    assert 0.5 < min(late_ratios) <= max(late_ratios) < 2.0


def test_parts_of_a_command_fill_one_bar_in_order() -> None:
    reported: list[tuple[str, float | None]] = []

    def report(message: str = "", fraction: float | None = None, /) -> None:
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


def test_a_terminal_shows_the_elapsed_time_in_one_line_that_vanishes(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("mechsim.cli.progress.FIRST", 0.0)
    with reported("show"):
        time.sleep(1.2)
    erased = "\r\x1b[K"
    assert terminal.getvalue() == f"{erased}show: 1 s{erased}"
