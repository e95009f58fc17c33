"""Invalid parameters and angles of the catalogue are rejected; no result contains NaN."""

import numpy as np
import pytest

from mechsim import catalog
from mechsim.analytic.formulas.closed_form import CHUNK
from mechsim.errors import AssemblyError, InputError


@pytest.mark.parametrize(
    ("parameter", "value", "remedy"),
    [
        ("crank", 0.0, "above 0"),
        ("crank", -0.01, "above 0"),
        ("crank", np.nan, "finite"),
        ("crank", np.inf, "finite"),
        ("crank", 1e300, "below 1e"),
        ("crank", 1e-320, "above 0"),
        ("crank", "long", "a finite number"),
        ("crank", (0.01, 0.02), "a finite number"),
        ("crank", 1 + 2j, "a finite number"),
        ("pivot", (0.04, 0.01), "3 finite numbers"),
        ("pivot", 0.04, "3 finite numbers"),
        ("pivot", (0.04, 0.01, np.nan), "3 finite numbers"),
        ("gamma1", np.nan, "finite"),
        ("branch", 0, "1 or -1"),
        ("branch", [1], "1 or -1"),
        ("branch", np.nan, "1 or -1"),
        ("guide", "yes", "on or off"),
    ],
)
def test_an_invalid_parameter_is_rejected_with_the_valid_values(parameter, value, remedy):
    with pytest.raises(InputError, match=rf"{parameter}.* is .*{remedy}"):
        catalog.make("rssr", **{parameter: value})


@pytest.mark.parametrize("pivot", [[0.043, -0.01, -0.024], np.array([0.043, -0.01, -0.024])])
def test_lists_and_arrays_are_valid_vectors(pivot):
    linkage = catalog.make("rssr", pivot=pivot)
    assert linkage == catalog.make("rssr")


@pytest.mark.parametrize("name", ["krank", "name", "discriminant_degree"])
def test_an_unknown_parameter_is_rejected_with_the_known_ones(name):
    with pytest.raises(InputError, match=r"has no parameter .* choose from crank, coupler, rocker, pivot"):
        catalog.make("rssr", **{name: 0.01})


def test_an_unknown_mechanism_is_rejected_with_the_closest_name():
    with pytest.raises(InputError, match="there is no mechanism 'rsr'; did you mean 'rssr'"):
        catalog.make("rsr")


@pytest.mark.parametrize("angles", [[np.nan], [np.inf], [], [[0.1, 0.2]], ["a"], None])
def test_invalid_crank_angles_are_rejected(angles):
    with pytest.raises(InputError, match=r"crank angles (must be a list of finite numbers|in rad)"):
        catalog.make("rssr").solve(angles)


@pytest.mark.parametrize("rate", [np.nan, np.inf, 1e200, [1.0, 2.0], "fast"])
@pytest.mark.parametrize("which", ["speed", "acceleration"])
def test_invalid_crank_rates_are_rejected(which, rate):
    with pytest.raises(InputError, match=rf"the crank's {which} .*(must be finite|a finite number)"):
        catalog.make("rssr").solve([0.1, 0.2, 0.3], **{which: rate})


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr"])
def test_every_coupler_length_gives_finite_numbers_or_an_error(name):
    link = {"slider_crank": "rod"}.get(name, "coupler")
    angles = np.linspace(-np.pi, np.pi, 41)
    outcomes = set()
    for length in np.geomspace(1e-9, 10.0, 40):
        linkage = catalog.make(name, **{link: float(length)})
        try:
            motion = linkage.solve(angles)
        except AssemblyError as error:
            outcomes.add("rejected")
            assert "crank angle" in str(error)
            assert "nan" not in str(error)
        else:
            outcomes.add("solved")
            for point in motion.points.values():
                assert np.isfinite(point.position).all()
                assert np.isfinite(point.acceleration).all()
    assert outcomes == {"rejected", "solved"}


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr"])
def test_many_angles_give_the_same_motion_as_single_angles(name):
    linkage = catalog.make(name)
    count = 2 * CHUNK + 1000
    angles = np.linspace(0.0, 40.0, count)
    whole = linkage.solve(angles, speed=np.linspace(1.0, 2.0, count))
    assert len(whole) == count
    for i in (0, CHUNK - 1, CHUNK, count - 1):
        alone = linkage.solve(angles[i : i + 1], speed=float(whole.speed[i]))
        for point, motion in alone.points.items():
            assert np.abs(whole.points[point].acceleration[i] - motion.acceleration[0]).max() <= 1e-13
