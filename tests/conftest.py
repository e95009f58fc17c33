"""Shared settings: floating-point errors raise, and random mechanisms are reproducible."""

import os

# as on the command line, and before numpy is loaded: idle threads of linear algebra consume time
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gc
import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, settings


class Answer(NamedTuple):
    """Exit code and output of a command."""

    code: int
    out: str
    err: str


# a wheel holds the tests, but not the scripts and examples that these read
OF_THE_REPOSITORY = [
    "kinematics/test_catalog_looper.py",
    "kinetics/test_forward_dynamics.py",
    "kinetics/test_joint_stops.py",
    "cli/test_json_outputs.py",
    "package/test_python_and_commands.py",
    "report/test_notebook.py",
    "simulation/test_matrices.py",
    "studies/test_link_equilibrium.py",
    "studies/test_released_motion.py",
    "testing/test_plugin.py",
]
collect_ignore = [] if Path(__file__).parents[1].joinpath("validation").is_dir() else OF_THE_REPOSITORY

settings.register_profile(
    "mechsim",
    derandomize=True,
    deadline=None,
    max_examples=10,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile("mechsim")


@pytest.fixture(scope="session", autouse=True)
def floating_point_errors_raise():
    # underflow to zero is not an error
    before = np.seterr(over="raise", divide="raise", invalid="raise")
    yield
    np.seterr(**before)


def pytest_collection_finish():
    """Exempt all that is loaded by now from garbage collection, which would walk over it again and again."""
    gc.freeze()


@pytest.fixture
def fast_timers(monkeypatch):
    """Let the clocks of a budget advance by 5 ms at each reading, however long the work takes."""
    from mechsim.numerics import resources

    readings = itertools.count()

    def reading():
        return 5e-3 * next(readings)

    monkeypatch.setattr("time.perf_counter", reading)
    monkeypatch.setattr(resources, "perf_counter", reading)


@pytest.fixture
def file(tmp_path):
    """Return a function that writes the text of a model, MJCF or TOML, and returns its path."""

    def written(text):
        path = tmp_path / ("model.xml" if text.lstrip().startswith("<") else "model.toml")
        path.write_text(text)
        return str(path)

    return written


@pytest.fixture
def mechsim(monkeypatch, capsys, tmp_path):
    """Return a function that runs a command in an empty folder, in this process."""
    from mechsim.cli import main

    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr("sys.argv", ["mechsim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return Answer(int(ended.value.code or 0), output.out, output.err)

    return call
