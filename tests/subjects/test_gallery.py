"""The gallery: each mechanism obeys its law, closed by its loop equations and met by MuJoCo."""

from pathlib import Path

import numpy as np
import pytest

from mechsim.studies.validate import validate
from mechsim.subjects.subject import load

GALLERY = Path(__file__).parents[2] / "models" / "gallery"
FILES = sorted(GALLERY.glob("*.toml"))


def moved(name, count=61):
    """Return the mechanism's motion over nine tenths of its range, and its parameters."""
    form = load(str(GALLERY / f"{name}.toml"))
    low, high = form.crank_range().arcs[0]
    middle, reach = (low + high) / 2.0, 0.45 * (high - low)
    return form.solve(middle + np.linspace(-reach, reach, count)), form.parameters


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_mechanism_of_the_gallery_meets_every_bound_and_bears_its_file_s_name(path):
    form = load(str(path))
    assert form.name == path.stem
    assert path.read_text().startswith("# ")
    assert "# Source: " in path.read_text()
    case = validate(form)
    assert case.passed, case.reason


def test_the_yoke_follows_the_cosine_of_the_crank():
    motion, given = moved("scotch_yoke")
    x = given["crank"] / 1000 * np.cos(motion.angle)
    np.testing.assert_allclose(motion.points["yoke"].position[:, 0], x, atol=1e-15)
    np.testing.assert_allclose(motion.points["yoke"].acceleration[:, 0], -x, atol=1e-13)


def test_the_trammel_s_pen_draws_an_ellipse():
    motion, given = moved("elliptic_trammel")
    x, y, _ = motion.points["pen"].position.T
    bar, arm = given["bar"] / 1000, given["arm"] / 1000
    ellipse = (x / arm) ** 2 + (y / (bar + arm)) ** 2
    np.testing.assert_allclose(ellipse, 1.0, atol=1e-12)


def test_peaucellier_s_tracer_is_straight_to_rounding():
    motion, given = moved("peaucellier_lipkin")
    x, y, _ = motion.points["P"].position.T
    np.testing.assert_allclose(x, given["line"] / 1000, rtol=1e-12)
    assert np.ptp(y) > 0.05


def test_the_quick_return_s_strokes_take_the_time_that_the_law_says():
    form = load(str(GALLERY / "quick_return.toml"))
    half = np.arcsin(form.parameters["crank"] / form.parameters["ground"])
    # the lever stands still where the crank is across it
    motion = form.solve([-half, np.pi + half])
    assert np.abs(motion.joints["lever"].rate).max() < 1e-13
    np.testing.assert_allclose(np.abs(motion.joints["lever"].value), half, atol=1e-13)


def test_the_cardan_joint_turns_out_as_the_tangents_say():
    form = load(str(GALLERY / "cardan_joint.toml"))
    bend = np.deg2rad(form.parameters["bend"])
    angle = np.linspace(-1.5, 1.5, 41)
    out = form.solve(angle).joints["out"].value
    quarter = form.solve([np.pi / 2]).joints["out"].value
    np.testing.assert_allclose(quarter, np.pi / 2, atol=1e-13)
    np.testing.assert_allclose(np.tan(out), np.tan(angle) * np.cos(bend), rtol=1e-11, atol=1e-13)


def test_both_shafts_of_the_oldham_coupling_turn_alike_and_its_disc_runs_on_a_circle():
    motion, given = moved("oldham_coupling")
    np.testing.assert_allclose(motion.joints["out"].rate, 1.0, atol=1e-12)
    radius = given["offset"] / 2000
    x, y, _ = motion.points["disc"].position.T
    np.testing.assert_allclose(np.hypot(x - radius, y), radius, atol=1e-15)


def test_the_spherical_four_bar_keeps_its_arc_and_its_radius():
    motion, given = moved("spherical_four_bar")
    a, b = (motion.points[name].position * 1000 / given["radius"] for name in "AB")
    np.testing.assert_allclose((a * b).sum(1), np.cos(np.deg2rad(given["coupler"])), atol=1e-13)
    np.testing.assert_allclose((b**2).sum(1), 1.0, atol=1e-13)


def test_the_lambda_linkage_is_straight_over_half_a_turn():
    form = load(str(GALLERY / "chebyshev_lambda.toml"))
    place = form.positions(np.linspace(np.pi / 2, 3 * np.pi / 2, 91))["P"]
    assert np.ptp(place[:, 1]) < 0.01 * np.ptp(place[:, 0])
    assert not np.ptp(place[:, 1]) < 1e-3 * np.ptp(place[:, 0])


@pytest.mark.parametrize("name", ["watt_six_bar", "stephenson_six_bar"])
def test_the_dyad_of_a_six_bar_keeps_its_lengths(name):
    motion, given = moved(name)
    c, d = (motion.points[point].position for point in "CD")
    np.testing.assert_allclose(np.linalg.norm(c - d, axis=1), given["rod"] / 1000, rtol=1e-13)
    pivot = np.array([(given["ground"] + given["second"]) / 1000, 0.0, 0.0])
    np.testing.assert_allclose(np.linalg.norm(d - pivot, axis=1), given["output"] / 1000, rtol=1e-13)
