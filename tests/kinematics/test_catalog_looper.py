import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.vector_method import trig_quartic

TABLE = Path(__file__).parents[2] / "validation" / "papers" / "looper_table.py"
# four roots of the quartic are real at this crank angle of the default linkage
FOURFOLD = 4.42


def test_the_other_assembly_mode_has_a_crank_range_above_one_revolution():
    assert ms.catalog.make("looper").crank_range().full
    other = ms.catalog.make("looper", side=-1)
    ((low, high),) = other.crank_range().arcs
    assert high - low > 2.0 * np.pi
    assert np.rad2deg(other.transmission_angle([low + 1e-6, high - 1e-6])).max() < 0.5
    # the further root exists only where both ends overlap
    ((start, end),) = ms.catalog.make("looper", side=-2).crank_range().arcs
    assert (start, end) == pytest.approx((low, high - 2.0 * np.pi))
    with pytest.raises(ms.AssemblyError, match="its range is"):
        ms.catalog.make("looper", side=-2).positions([end + 0.01])
    # one crank angle has two poses, which the count of revolutions distinguishes
    first, second = other.positions([FOURFOLD])["C"], other.positions([FOURFOLD - 2.0 * np.pi])["C"]
    assert np.linalg.norm(first - second) > 1e-3
    modes = {(item.branch, item.side) for item in other.assemblies(FOURFOLD)}
    assert modes == {(1, side) for side in (1, 2, -1, -2)}


def test_the_default_assembly_mode_matches_the_paper():
    c = ms.catalog.make("looper").closed_form.planar_point(np.linspace(0.0, 2.0 * np.pi, 2001))
    assert np.round(1e3 * c.min(0), 2).tolist() == [9.50, 23.68, 0.0]
    assert np.round(1e3 * c.max(0), 2).tolist() == [12.98, 37.29, 0.0]
    other = ms.catalog.make("looper", branch=-1).closed_form.planar_point(np.linspace(0.0, 2.0 * np.pi, 101))
    assert other[:, 1].max() < 0.0


def test_a_vanishing_leading_coefficient_loses_no_root():
    # the leading coefficient of the quartic in the half angle vanishes
    for opposite in (0.0, 1e-17, 1e-9):
        polynomial = np.array([[1.0 + opposite], [1.0], [0.3], [0.0], [0.0]])
        roots = np.sort(trig_quartic.real_roots(polynomial)[:, 0])
        real = roots[~np.isnan(roots)]
        assert len(real) == 2
        assert np.abs(trig_quartic.polynomial_value(polynomial, real[:, None])).max() <= 1e-14


@pytest.fixture(scope="module")
def table():
    spec = importlib.util.spec_from_file_location("looper_table", TABLE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["looper_table"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_every_number_of_the_paper_is_reproduced(table):
    rows = table.table()
    assert len(rows) == 11
    assert [row.quantity for row in rows if not row.passed] == []


def test_the_table_of_the_paper_rejects_another_axis_height(table):
    failed = {row.quantity for row in table.table(ms.catalog.make("looper", axis_z=0.0115)) if not row.passed}
    assert {"C: plane against space", "E: half the band over 33 mm"} <= failed


def test_figures_of_the_paper_are_reproduced(table):
    linkage = ms.catalog.make("looper")
    assert np.ptp(table.figure_3(linkage)["y"]) == pytest.approx(40.85, abs=0.005)
    assert np.abs(linkage.positions(np.linspace(0.0, 2.0 * np.pi, 721))["C"][:, 2]).max() < 1.31e-3
