"""Reuse of memory by arrays."""

import platform
import resource

import numpy as np
import pytest

from mechsim.numerics.arrays import Array


def repeated_roots(count: int) -> Array:
    """Calculate in several steps, each with an array of its own."""
    result = np.zeros(count)
    for k in range(8):
        result = np.sqrt(result + k)
    return result


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc returns memory differently")
def test_a_repeated_calculation_reuses_its_memory():
    repeated_roots(100_000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        repeated_roots(100_000)
    # 3 arrays of 195 pages at a time; without the first large array 9,000 pages and more are allocated anew
    assert resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before < 1000
