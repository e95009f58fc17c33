"""Dimensions from measured motion: recovered values, true uncertainties and undetermined combinations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grids import grid

import mechsim as ms
from mechsim import files
from mechsim.studies.measured_table import single
from mechsim.studies.sensitivity.moved_family import family_at

ANGLES = np.linspace(0.0, 6.0, 13)
TRUE = {"coupler": 0.0913, "rocker": 0.0735, "arm_angle": 0.55}


def measured(noise=0.0, seed=0, points="C"):
    random = np.random.default_rng(seed)
    motion = ms.catalog.make("four_bar", **TRUE).solve(ANGLES)
    table = {"angle": ANGLES}
    for i, axis in enumerate("xy"):
        positions = motion.points[points].position[:, i]
        table[f"{points}.{axis}"] = positions + noise * random.standard_normal(len(ANGLES))
        if noise:
            table[f"{points}.{axis}±"] = np.full(len(ANGLES), noise)
    return table


@pytest.mark.long
def test_dimensions_are_recovered_to_rounding():
    result = ms.fit("four_bar", measured(), [*TRUE])
    assert result.outcome == "fitted"
    for name, value in TRUE.items():
        assert result.values[name] == pytest.approx(value, rel=1e-10)
    assert result.start["coupler"] == 0.091
    assert max(result.rms.values()) <= 1e-13


@pytest.mark.long
def test_uncertainties_match_the_scatter_of_repeated_measurements():
    fits = [ms.fit("four_bar", measured(2e-5, seed), [*TRUE]) for seed in range(3)]
    normalised_errors = [
        (fit.values[name] - true) / fit.deviations[name] for fit in fits for name, true in TRUE.items()
    ]
    # the mean of nine squares with expectation one
    assert 0.3 <= np.square(normalised_errors).mean() <= 2.5
    assert 0.7 <= np.mean([fit.spread for fit in fits]) <= 1.3


@pytest.mark.long
def test_residuals_replace_missing_deviations_with_students_t_of_their_number():
    table = {name: column[:3] for name, column in measured(2e-5).items()}
    without_deviations = {name: column for name, column in table.items() if "±" not in name}
    weighted, unweighted = (ms.fit("four_bar", item, ["coupler"]) for item in (table, without_deviations))
    deviation = weighted.deviations["coupler"]
    assert unweighted.deviations["coupler"] == pytest.approx(deviation * weighted.spread, rel=1e-6)
    assert weighted.within()["coupler"] == pytest.approx(1.959964 * deviation)
    assert unweighted.free == 5
    assert unweighted.within()["coupler"] == pytest.approx(2.570582 * unweighted.deviations["coupler"])


@pytest.mark.long
def test_undetermined_combinations_of_dimensions_are_reported():
    motion = ms.catalog.make("four_bar", rocker=0.0735).solve(ANGLES)
    table = {"angle": ANGLES, "rocker.q": motion.joints["rocker"].value + 4.0 * np.pi}
    result = ms.fit("four_bar", table, ["ground", "crank", "coupler", "rocker"])
    assert result.outcome == "underdetermined"
    # the common scale of all lengths is undetermined
    assert result.together == (("ground", "crank", "coupler", "rocker"),)
    assert not result.deviations
    shape = np.array([*result.values.values()]) / result.values["ground"]
    assert np.abs(shape - np.array([0.1, 0.032, 0.091, 0.0735]) / 0.1).max() <= 1e-8


@pytest.mark.slow
def test_a_file_of_the_gallery_is_fitted_under_its_motion_laws():
    mechanism = ms.moved("five_bar")
    motion = mechanism.designs.make({"arm": 0.061}).solve(t=mechanism.over[1][::12])
    columns = dict(motion.columns())
    (point,) = motion.points
    table = {"t": columns["t"], f"{point}.x": columns[f"{point}.x"], f"{point}.y": columns[f"{point}.y"]}
    result = ms.fit("five_bar", table, "arm")
    assert result.values["arm"] == pytest.approx(0.061, rel=1e-10)


REFERENCE = Path(__file__).parents[2] / "reference"


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "vary", "effort"),
    grid([("four_bar", ["coupler", "rocker"], "torque:crank"), ("five_bar", ["arm"], "torque:left")]),
)
def test_a_reference_table_is_fitted_with_its_own_column_names(name, vary, effort):
    table_of_reference = files.read(REFERENCE / "data" / f"{name}.csv")
    columns_used = [
        "angle" if "angle" in table_of_reference else "t",
        *(item for item in table_of_reference if "v" in item),
        effort,
    ]
    table = {item: table_of_reference[item][::9] for item in columns_used}
    mechanism = ms.moved(str(REFERENCE / "mechanisms" / f"{name}.toml"), speed=20.0)
    true = {item: mechanism.designs.dimensions[item].value for item in vary}
    initial = replace(
        mechanism, designs=family_at(mechanism.designs, {item: 0.99 * value for item, value in true.items()})
    )
    result = ms.fit(initial, table, vary)
    assert result.outcome == "fitted"
    assert all(result.values[item] == pytest.approx(value, rel=1e-10) for item, value in true.items())
    assert {*result.rms} == {*table} - {"angle", "t"}


@pytest.mark.slow
def test_the_crank_offset_is_fitted_with_the_dimensions():
    solver, ahead = ms.catalog.make("four_bar", coupler=0.0913), 0.07
    forces = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), ANGLES + ahead, 5.0).forces
    motion = solver.solve(ANGLES + ahead, 5.0)
    table = {"angle": ANGLES, "C.x": motion.points["C"].position[:, 0], "torque": forces.torque}
    table["rocker.a"] = motion.joints["rocker"].acceleration
    result = ms.fit("four_bar", table, ["coupler"], offset=True, speed=5.0)
    assert (result.outcome, result.units["crank.offset"]) == ("fitted", "rad")
    assert result.values["crank.offset"] == pytest.approx(ahead, rel=1e-9)
    assert result.values["coupler"] == pytest.approx(0.0913, rel=1e-10)
    assert result.moved.angles == pytest.approx(ANGLES + ahead)
    # without the offset the coupler is wrong
    assert abs(ms.fit("four_bar", table, ["coupler"], speed=5.0).values["coupler"] - 0.0913) > 1e-4


def test_an_offset_equivalent_to_a_phase_is_reported():
    motion = ms.catalog.make("warp_knitter").solve(ANGLES)
    table = {"angle": ANGLES, "D.x": motion.points["D"].position[:, 0]}
    result = ms.fit("warp_knitter", table, ["phase"], offset=True)
    assert result.together == (("phase", "crank.offset"),)


def test_the_force_of_a_sliding_driver_has_its_reference_name():
    mechanism = ms.moved("stewart_gough", t=[0.0])
    assert single({"force:l1": np.zeros(1)}, mechanism) == {"force:l1": "drive l1"}
    with pytest.raises(ms.InputError, match="column force:s1 is not a single quantity"):
        single({"force:s1": np.zeros(1)}, mechanism)
