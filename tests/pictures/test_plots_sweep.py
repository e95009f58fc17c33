"""Plots of sweeps: Pareto fronts and rejected input."""

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.pictures.plots.sweeps import SweepTable, front_of, sweep_plot


def test_a_pareto_front_contains_exactly_the_nondominated_designs():
    rng = np.random.default_rng(3)
    x, y = rng.random((2, 200))
    front = front_of(x, y)
    for i in range(200):
        dominated = ((x <= x[i]) & (y <= y[i]) & ((x < x[i]) | (y < y[i]))).any()
        assert (i in front) != dominated


def test_plots_without_data_are_rejected():
    empty = SweepTable("none", {"a": np.arange(3.0)}, {"m": np.full(3, np.nan)}, {}, (3,))
    with pytest.raises(InputError, match="nothing to draw"):
        sweep_plot(empty, kind="parallel")
    with pytest.raises(InputError, match="two measures"):
        sweep_plot(empty, kind="pareto")
    three = SweepTable("three", dict.fromkeys("abc", np.arange(8.0)), {"m": np.arange(8.0)}, {}, (2, 2, 2))
    with pytest.raises(InputError, match="--kind parallel"):
        sweep_plot(three, kind="map")
