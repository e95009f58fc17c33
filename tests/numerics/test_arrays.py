"""Reuse of memory by arrays."""

import platform
import resource

import numpy as np
import pytest

from mechsim.numerics.arrays import REVOLUTION, Array, other_revolutions


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


@pytest.mark.parametrize("angle", [-20.3, -0.4, 0.0, 3.9, 31.0])
@pytest.mark.parametrize(
    "targets", [(0.5,), (0.1, 2.0), (-4.0, 1.5), (-9.0, -3.2), (40.0, 46.0), (-3.0, 12.0)]
)
def test_other_revolutions_match_an_exhaustive_search(angle, targets):
    expected = [
        revolutions
        for revolutions in range(-12, 13)
        if revolutions and all(abs(angle + revolutions * REVOLUTION - item) <= REVOLUTION for item in targets)
    ]
    result = other_revolutions(angle, np.array(targets))
    assert sorted(result) == expected
    assert [abs(revolutions) for revolutions in result] == sorted(abs(revolutions) for revolutions in result)
