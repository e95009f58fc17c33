"""Extremes: equal dimensionless problems give equal results, and every run reports its true outcome."""

from dataclasses import replace

import numpy as np
import pytest
from grids import grid

import mechsim as ms
from mechsim.simulation import simulate
from mechsim.simulation.source import assembled
from mechsim.studies.extremes import stability_map
from mechsim.studies.extremes.stability_map import speed, steps
from mechsim.studies.extremes.trial import StabilityMap, Trial, borders_along


@pytest.mark.parametrize("name", grid(("four_bar", "rssr", "warp_knitter", "bennett"), ("rssr",)))
def test_the_error_is_independent_of_size(name):
    linkage = ms.catalog.make(name)
    trials = [stability_map.characteristic_length(linkage, value) for value in (1e-5, 1e-1, 1e3)]
    assert all(trial.passed for trial in trials)
    errors = np.array([trial.error for trial in trials])
    assert errors.max() <= 1.1 * errors.min()


@pytest.mark.parametrize("name", ["slider_crank", "rrsrr"])
def test_the_error_is_independent_of_speed(name):
    trials = [stability_map.speed(ms.catalog.make(name), value) for value in (1.0, 1e5)]
    assert all(trial.passed for trial in trials)
    errors = np.array([trial.error for trial in trials])
    assert errors.max() <= 1.05 * errors.min()


@pytest.mark.parametrize("ratio", [1e-6, 1e6])
def test_extreme_mass_ratios_do_not_change_the_motion(ratio):
    trial = stability_map.mass_ratio(ms.catalog.make("rssr"), ratio)
    assert trial.passed
    assert trial.error < 1e-7


def test_a_reversed_hinge_is_found_from_the_link_poses():
    trial = stability_map.far_start(ms.catalog.make("rrsrr"), 1.32, seed=2)
    assert trial.error < 1e-9
    assert trial.outcome == trial.right == "failed"


def test_a_massless_rod_gets_a_mass_that_the_note_states():
    spec = assembled(ms.catalog.make("rssr").mechanism, ms.Scene())
    body = spec.body("coupler")
    body.mass, body.inertia = 0.0, np.zeros(3)
    run = simulate(spec, speed=10.0)
    assert run.outcome == "passed"
    assert 'boundmass="1e-06"' in run.note


@pytest.mark.long
@pytest.mark.parametrize("value", [1e-2, 0.3, 3.0])
def test_a_distant_start_reports_its_true_outcome(value):
    assert all(stability_map.far_start(ms.catalog.make("four_bar"), value, seed).passed for seed in range(4))


def test_a_false_outcome_fails_the_study():
    honest = Trial(axis="steps", mechanism="rssr", value=9.0, outcome="failed", right="failed")
    assert StabilityMap([honest]).passed
    assert not StabilityMap([replace(honest, outcome="passed")]).passed
    assert not StabilityMap([replace(honest, expected="passed")]).passed


def test_bisection_finds_a_known_border():
    def attempted(value: float) -> Trial:
        outcome = "passed" if value < 300.0 else "failed"
        return Trial(axis="steps", mechanism="rssr", value=value, outcome=outcome, right=outcome)

    _, borders = borders_along(attempted, [1.0, 1e3, 1e6], 20)
    assert len(borders) == 1
    assert borders[0].inside < 300.0 <= borders[0].outside
    assert borders[0].outside / borders[0].inside < 1.0001


@pytest.mark.long
@pytest.mark.parametrize(("axis", "value"), [(steps, 20.0), (steps, 1e3), (speed, 1e8)])
def test_a_model_file_ends_as_the_formulas_of_the_same_mechanism_state(axis, value, tmp_path):
    path = tmp_path / "linkage.xml"
    ms.export("rssr", path)
    observed, exact = axis(ms.load(path), value), axis(ms.catalog.make("rssr"), value)
    assert observed.passed
    assert observed.outcome == exact.outcome == {20.0: "failed", 1e3: "passed", 1e8: "diverged"}[value]


def test_any_model_has_the_axes_that_apply_to_it():
    laws = {name for name, *_ in stability_map.axes_of(ms.load("planar_3rrr"), quick=True)}
    assert laws == {"steps", "mass ratio", "far start"}
    crank = {name for name, *_ in stability_map.axes_of(ms.load("jansen"), quick=True)}
    assert crank == laws | {"speed"}
    assert "size" in {name for name, *_ in stability_map.axes_of(ms.catalog.make("rssr"), True)}


@pytest.mark.long
def test_platforms_and_gallery_mechanisms_report_their_true_outcomes():
    assert stability_map.steps(ms.load("planar_3rrr"), 1e3).outcome == "passed"
    assert stability_map.far_start(ms.load("jansen"), 1.0, seed=0).passed
    assert stability_map.mass_ratio(ms.load("jansen"), 1e-3).passed


@pytest.mark.parametrize("name", ["cam_follower", "geneva_drive", "window_regulator"])
def test_masses_vary_only_where_mjcf_holds_the_whole_mechanism(name):
    # a file has no functions: their polynomials would stay those at the start
    assert "mass ratio" not in {axis for axis, *_ in stability_map.axes_of(ms.load(name), quick=True)}
    assert "mass ratio" in {axis for axis, *_ in stability_map.axes_of(ms.load("four_bar"), quick=True)}
