"""Compiled solvers of reference mechanisms, in a cache of the test session."""

from functools import cache
from pathlib import Path

import pytest

import mechsim as ms

REFERENCE = Path(__file__).parents[2] / "reference" / "mechanisms"


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def compiled(cache_folder):
    """Return a function: name of a reference mechanism -> its compiled solver."""
    return cache(lambda name: ms.compile(REFERENCE / f"{name}.toml"))
