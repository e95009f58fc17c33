"""Designs: grids, lists and samples from text, and rejected input."""

import numpy as np

from mechsim.studies.sweep.designs import grid_designs, parsed_range, read_designs, sampled_designs
from mechsim.studies.sweep.sweeping import swept_designs

PARAMETERS = swept_designs("rssr")[1]


def ranged(text, **options):
    return parsed_range(text, "rssr", PARAMETERS, **({"sampled": False} | options))


def test_a_range_includes_both_ends_and_shares_its_last_unit():
    name, values = ranged("crank=12:15mm:4")
    assert name == "crank"
    np.testing.assert_allclose(values, [0.012, 0.013, 0.014, 0.015], rtol=1e-15)


def test_points_vary_by_component_and_choices_by_value():
    assert ranged("pivot.x=40mm:44mm:2")[1].tolist() == [0.04, 0.044]
    assert ranged("branch=1,-1")[1].tolist() == [1.0, -1.0]


def test_a_grid_has_all_combinations_in_any_row_range():
    designs = grid_designs({"crank": [1.0, 2.0], "rocker": [3.0, 4.0, 5.0]}, "rssr", PARAMETERS)
    assert designs.shape == (2, 3)
    all_rows = designs.rows(0, 6)
    assert all_rows["crank"].tolist() == [1.0] * 3 + [2.0] * 3
    assert designs.rows(2, 5)["rocker"].tolist() == all_rows["rocker"][2:5].tolist()


def test_samples_fill_their_spans_reproducibly():
    spans = {"crank": (1.0, 2.0), "rocker": (5.0, 9.0)}
    first, repeated = (sampled_designs("sobol:100", spans, "rssr", PARAMETERS) for _ in range(2))
    crank, rocker = first.values.values()
    assert 1.0 <= crank.min() < 1.02 < 1.98 < crank.max() <= 2.0
    assert abs(rocker.mean() - 7.0) < 0.1
    np.testing.assert_array_equal(crank, repeated.values["crank"])


def test_a_design_file_may_have_units_in_its_cells(tmp_path):
    path = tmp_path / "designs.csv"
    path.write_text("crank,rocker\n13 mm,0.027\n0.014,28mm\n")
    result = read_designs(str(path), "rssr", PARAMETERS)
    assert result.rows(0, 2)["crank"].tolist() == [0.013, 0.014]
    assert result.dims == ("design",)
