"""Roots that are known, to the last digits, at any scale."""

import numpy as np
import pytest

from mechsim.numerics.newton import root


@pytest.mark.parametrize("wanted", [1.0 / 3.0, -np.pi, 2.0**0.5 * 1e-200])
@pytest.mark.parametrize(
    "shape",
    [lambda x: x, lambda x: x**3, np.sign, lambda x: np.arctan(1e9 * x)],
    ids=["line", "cube", "step", "steep"],
)
def test_a_root_is_found_to_the_last_digits(wanted, shape):
    def function(x):
        return float(shape((x - wanted) / wanted))

    low, high = sorted((0.1 * wanted, 2.3 * wanted))
    assert abs(root(function, low, high) - wanted) <= 1e-15 * abs(wanted)
