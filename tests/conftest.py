"""What all tests share: floating-point trouble is an error, random mechanisms are the same every time."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "mechsim",
    derandomize=True,
    deadline=None,
    max_examples=15,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
settings.load_profile("mechsim")


@pytest.fixture(scope="session", autouse=True)
def floating_point_trouble_raises() -> Iterator[None]:
    # underflow to nought is no fault: what vanishes beside the rest is nought
    before = np.seterr(over="raise", divide="raise", invalid="raise")
    yield
    np.seterr(**before)
