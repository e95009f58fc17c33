"""The estimate of how long work goes on, by a clock that the tests set."""

import pytest

from mechsim.cli.progress import TimeLeft


def worst_ratio(reports: list[tuple[float, float]], begun: float | None = 0.0) -> float:
    """Return by which factor estimates are wrong at the worst, after the first fifth of the work."""
    left, end, worst = TimeLeft(begun), reports[-1][0], 1.0
    for now, fraction in reports[:-1]:
        rest = left.update(fraction, now)
        if rest is not None and now > 0.2 * end:
            worst = max(worst, rest / (end - now), (end - now) / rest)
    return worst


def test_even_work_is_estimated_exactly() -> None:
    assert worst_ratio([(2.0 * i, i / 50) for i in range(1, 51)]) == pytest.approx(1.0)


def test_a_slow_start_does_not_spoil_the_estimate() -> None:
    # 10 s until the first piece is done, as where libraries are loaded and code is compiled, then 0.1 s each
    reports = [(10.0 + 0.1 * i, i / 500) for i in range(501)]
    assert worst_ratio(reports, None) < 1.01
    # the same where the first pieces themselves are slow
    slow = [(5.0 * i, i / 500) for i in range(1, 5)] + [
        (20.0 + 0.1 * i, (4 + i) / 500) for i in range(1, 497)
    ]
    left, late = TimeLeft(0.0), []
    for now, fraction in slow[:-1]:
        rest = left.update(fraction, now)
        if now > 45.0 and rest is not None:
            late.append(rest / (slow[-1][0] - now))
    assert 0.5 < min(late) <= max(late) < 2.0


def test_work_that_slows_down_or_speeds_up_evenly_is_estimated_within_a_factor_of_two() -> None:
    assert worst_ratio([(0.1 * i**1.5, i / 400) for i in range(1, 401)]) < 2.0
    assert worst_ratio([(10.0 * i**0.7, i / 400) for i in range(1, 401)]) < 2.0


def test_work_that_is_started_again_is_estimated_anew() -> None:
    left = TimeLeft()
    assert left.update(0.1, 0.0) is None
    assert left.update(0.9, 8.0) == pytest.approx(1.0)
    assert left.update(0.0, 10.0) is None
    assert left.update(0.1, 20.0) == pytest.approx(90.0)


def test_nothing_is_estimated_before_anything_is_done() -> None:
    left = TimeLeft(0.0)
    assert left.update(0.0, 5.0) is None
    assert left.update(0.5, 5.0) == pytest.approx(5.0)
