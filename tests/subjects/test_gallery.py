"""The gallery: each mechanism obeys its law, closed by its loop equations and met by MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import values_of_function
from mechsim.studies.agreement.evaluation_points import evaluation_points
from mechsim.studies.agreement.misfit import candidate_check, formula_tolerance, scales_of
from mechsim.studies.validate import case_of
from mechsim.subjects import gallery
from mechsim.subjects.python_object import run_object
from mechsim.subjects.readers import load
from mechsim.verdict.quantities import reach_of
from mechsim.verdict.tolerances import EPS

FILES = gallery.files()


@pytest.fixture(params=FILES, scope="module")
def shown(request):
    return load(request.param)


def moved(form, count=61):
    """Return the mechanism's motion over nine tenths of its range."""
    low, high = form.crank_range().arcs[0]
    middle, reach = (low + high) / 2.0, 0.45 * (high - low)
    return form.solve(middle + np.linspace(-reach, reach, count))


def test_gallery_files_state_their_source_and_law(shown):
    text = FILES[shown.name].read_text()
    assert len(text.splitlines()) <= 60
    assert text.startswith("# ")
    assert "\n# Source: " in text
    assert "\n# Law" in text
    assert len(gallery.description(FILES[shown.name])) > 20


def test_gallery_mechanisms_pass_validation_and_satisfy_their_law(shown):
    case = case_of(shown, quick=True)
    assert case.passed, case.verdict.reason
    reported = [check for check in case.verdict.checks if check.method == "formula"]
    assert reported
    # far below the bound on a formula of anybody's: two ways to the same place, measured 8 eps apart
    assert all(check.worst <= 512 * EPS * reach_of(case.exact) for check in reported)


@pytest.mark.slow
def test_stepped_gallery_mechanisms_pass_validation(shown):
    case = case_of(shown)
    assert case.passed, case.verdict.reason


def test_the_law_rejects_a_dimension_off_by_a_thousandth(shown):
    name = next(iter(shown.parameters))
    wrong = load(shown.name, {name: f"1.001*{shown.parameters[name]!r}"})
    evaluation = evaluation_points(wrong, speed=1.0)
    law = values_of_function(run_object(shown.formula), evaluation, "law", shown.parameters)
    scales = scales_of(evaluation, law)
    assert not all(
        candidate_check(
            item, evaluation.exact(item.quantity), evaluation, formula_tolerance(item, scales, None), None
        ).passed
        for item in law
    )


def test_a_formula_of_a_file_is_accepted_only_to_rounding(shown):
    form = load(shown.name)
    evaluation = evaluation_points(form, speed=1.0)
    law = values_of_function(run_object(shown.formula), evaluation, "law", form.parameters)
    error = 1e-11 * evaluation.solver.mechanism.characteristic_length
    wrong = [replace(item, values=item.values + error) for item in law]
    for values, accepted in ((law, True), (wrong, False)):
        checks = agreement(evaluation, values, "law", diagnose=False, exact_formula=True).checks
        assert [check.passed for check in checks] == [accepted] * len(checks)


def test_a_law_uses_changed_parameters():
    wide = load("scotch_yoke", {"crank": "4 cm"})
    assert case_of(wide, quick=True).passed


def test_the_quick_return_has_its_time_ratio():
    form = load("quick_return")
    half = np.arcsin(form.parameters["crank"] / form.parameters["ground"])
    # the lever stands still where the crank is across it
    motion = form.solve([-half, np.pi + half])
    assert np.abs(motion.joints["lever"].rate).max() < 1e-13
    np.testing.assert_allclose(np.abs(motion.joints["lever"].value), half, atol=1e-13)


def test_the_peaucellier_linkage_traces_a_straight_line():
    form = load("peaucellier_lipkin")
    x, y, _ = moved(form).points["P"].position.T
    np.testing.assert_allclose(x, form.parameters["line"] / 1000, rtol=1e-12)
    assert np.ptp(y) > 0.05


def test_the_lambda_linkage_is_nearly_straight_over_half_a_turn():
    place = load("chebyshev_lambda").positions(np.linspace(np.pi / 2, 3 * np.pi / 2, 91))["P"]
    assert np.ptp(place[:, 1]) < 0.01 * np.ptp(place[:, 0])
    assert not np.ptp(place[:, 1]) < 1e-3 * np.ptp(place[:, 0])


@pytest.mark.parametrize(("name", "foot"), [("jansen", "foot"), ("klann", "G")])
def test_the_foot_of_a_leg_mechanism_stays_near_the_ground(name, foot):
    height = load(name).positions(np.linspace(0.0, 2.0 * np.pi, 181))[foot][:, 1]
    near = height < height.min() + 0.1 * np.ptp(height)
    assert near.mean() > 0.4
    assert np.ptp(height) > 0.02


def test_wheels_of_the_planetary_gear_roll_without_slip():
    form = load("planetary_gear")
    motion = form.solve(np.linspace(0.0, 7.0, 40))
    sun, planet = (motion.links[name].angular_velocity[:, 2] for name in ("sun", "planet"))
    at_pitch = sun * form.parameters["sun"]
    along = form.parameters["arm"] - planet * form.parameters["planet"]
    np.testing.assert_allclose(at_pitch, along, rtol=1e-12)
    np.testing.assert_allclose(along + 2.0 * planet * form.parameters["planet"], 0.0, atol=1e-9)


def test_the_fingers_of_the_gripper_do_not_rotate():
    motion = load("parallel_gripper").solve(np.deg2rad([30.0, 60.0, 80.0]))
    apart = motion.points["right"].position - motion.points["left"].position
    np.testing.assert_allclose(apart[0], [0.085, 0.0, 0.0], atol=1e-15)
    for side in "rl":
        np.testing.assert_allclose(motion.links[f"finger_{side}"].rotation - np.eye(3), 0.0, atol=1e-14)


def test_the_gallery_is_read_from_package_or_source_tree(monkeypatch, tmp_path):
    package = tmp_path / "mechsim"
    (package / "gallery").mkdir(parents=True)
    (tmp_path / "models" / "gallery").mkdir(parents=True)
    (package / "gallery" / "inside.toml").touch()
    (tmp_path / "models" / "gallery" / "beside.toml").touch()
    monkeypatch.setattr(gallery, "PACKAGE", package)
    assert list(gallery.files()) == ["inside"]
    (package / "gallery" / "inside.toml").unlink()
    (package / "gallery").rmdir()
    assert list(gallery.files()) == ["beside"]


def test_an_unknown_gallery_name_is_rejected_with_the_closest_name():
    with pytest.raises(InputError, match="there is no mechanism 'klan'; did you mean 'klann'"):
        load("klan")
