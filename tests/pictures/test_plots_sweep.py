"""Plots of sweeps: what none betters, and what cannot be drawn."""

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.pictures.plots.studies import SweepTable, front_of, sweep_plot


def test_a_front_is_of_designs_that_none_betters_in_both():
    rng = np.random.default_rng(3)
    x, y = rng.random((2, 200))
    front = front_of(x, y)
    for i in range(200):
        better = ((x <= x[i]) & (y <= y[i]) & ((x < x[i]) | (y < y[i]))).any()
        assert (i in front) != better


def test_nothing_is_drawn_of_what_is_not_there():
    empty = SweepTable("none", {"a": np.arange(3.0)}, {"m": np.full(3, np.nan)}, {}, (3,))
    with pytest.raises(InputError, match="nothing to draw"):
        sweep_plot(empty, kind="parallel")
    with pytest.raises(InputError, match="two measures"):
        sweep_plot(empty, kind="pareto")
    three = SweepTable("three", dict.fromkeys("abc", np.arange(8.0)), {"m": np.arange(8.0)}, {}, (2, 2, 2))
    with pytest.raises(InputError, match="--kind parallel"):
        sweep_plot(three, kind="map")
