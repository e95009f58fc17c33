"""What all tests share: floating-point trouble is an error, random mechanisms are the same every time."""

import os

# as the command line has it, and read when numpy is loaded: threads of linear algebra that wait for work spin
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "mechsim",
    derandomize=True,
    deadline=None,
    max_examples=10,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile("mechsim")


@pytest.fixture(scope="session", autouse=True)
def floating_point_trouble_raises() -> Iterator[None]:
    # underflow to zero is no fault: what vanishes next to the rest is zero
    before = np.seterr(over="raise", divide="raise", invalid="raise")
    yield
    np.seterr(**before)


@pytest.fixture
def fast_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the clocks of a budget advance by 5 ms at each reading, however long the work takes."""
    from mechsim.studies import budget

    readings = itertools.count()

    def clock() -> float:
        return 5e-3 * next(readings)

    monkeypatch.setattr("time.perf_counter", clock)
    monkeypatch.setattr(budget, "perf_counter", clock)
    monkeypatch.setattr(budget, "process_time", clock)


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], str]:
    """Return a function that writes the text of a model, MJCF or TOML, and says where."""

    def written(text: str) -> str:
        path = tmp_path / ("model.xml" if text.lstrip().startswith("<") else "model.toml")
        path.write_text(text)
        return str(path)

    return written
