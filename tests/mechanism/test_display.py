import sys
from functools import cache

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import MissingToolError
from mechsim.files import read, write

LINKAGE = ms.catalog.make("rssr")


@cache
def run():
    return ms.simulate(LINKAGE, speed=60.0, turns=0.1)


@cache
def inverse():
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(LINKAGE), np.linspace(0.0, 6.0, 200), 60.0)


@pytest.mark.parametrize(
    ("record", "lines", "output"),
    [
        (lambda: LINKAGE.mechanism, 3, "links=(crank, coupler, rocker)"),
        (lambda: run(), 3, "outcome='passed'"),
        (lambda: run().motion, 5, "angle=<(9,): 0 to 0.6283>"),
        (lambda: run().motion.points["P3"], 3, "position=<(9, 3): "),
        (lambda: inverse(), 4, "forces=<ForceRecord>"),
        (lambda: inverse().forces, 6, "reactions={crank, P2, P3"),
        (lambda: inverse().forces.reactions["P2"], 3, "link='coupler', by='crank'"),
        (lambda: ms.trace(LINKAGE, starts=0), 8, "branch_points=()"),
        (lambda: ms.crosscheck(run().motion, LINKAGE), 11, "passed\n  position of P2 "),
    ],
    ids=["mechanism", "run", "motion", "point", "inverse", "forces", "reaction", "trace", "verdict"],
)
def test_results_are_printed_in_a_few_lines(record, lines, output):
    text = repr(record())
    assert output in text
    assert len(text.splitlines()) <= lines
    assert "array(" not in text


def test_to_pandas_agrees_with_the_written_file(tmp_path):
    pytest.importorskip("pandas", reason="pandas is not installed: pip install '.[tables]'")
    table = run().motion.to_pandas()
    write(tmp_path / "run.csv", run().motion)
    for name, column in read(tmp_path / "run.csv").items():
        np.testing.assert_array_equal(table[name], column)
    assert list(table.columns) == list(read(tmp_path / "run.csv"))
    units = table.attrs["units"]
    assert (units["t"], units["angle"], units["P3.x"], units["P3.vx"]) == ("s", "rad", "m", "m/s")
    assert list(units) == list(table.columns)


def test_to_xarray_returns_variables_with_units():
    pytest.importorskip("xarray", reason="xarray is not installed: pip install '.[tables]'")
    dataset = run().motion.to_xarray()
    assert set(dataset.coords) == {"t", "angle"}
    assert dataset["P3.az"].dims == ("instant",)
    assert dataset["P3.az"].attrs == {"units": "m/s2"}
    np.testing.assert_array_equal(dataset["P3.az"], run().motion.points["P3"].acceleration[:, 2])
    assert set(LINKAGE.solve([0.0, 1.0]).to_xarray().coords) == {"angle"}


@pytest.mark.parametrize(("method", "library"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_a_missing_library_is_named_with_its_extra(method, library, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingToolError, match=rf"{library} is not installed; .*\[tables\]"):
        getattr(run().motion, method)()
