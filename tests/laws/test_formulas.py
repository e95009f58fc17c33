"""Laws of every formula of the catalogue, for random dimensions; `strategies.CASES` has a row for each."""

import exact_solutions as exact
import numpy as np
import pytest
from catalog_faults import FAULTS
from grids import grid
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from loop_laws import agrees_with_loop_equations
from strategies import CASES, CLOSED, angles_of, longest

import mechsim as ms
from mechsim.studies.extremes.stability_map import resized

# mechanism -> point and its function in fifty digits
EXACT_POINTS = {
    "four_bar": ("B", exact.four_bar_b),
    "slider_crank": ("B", exact.slider_crank_b),
    "rssr": ("P3", exact.rssr_p3),
}
# mechanism -> a number with the sign of its branch
SIDES = {
    "four_bar": lambda d, p: np.cross([d.ground, 0.0, 0.0] - p["A"], p["B"] - p["A"])[:, 2],
    "slider_crank": lambda _, p: p["B"][:, 0] - p["A"][:, 0],
}
TWO_BRANCHES = ("four_bar", "slider_crank", "rssr", "rrsrr")
QUANTITIES = ("position", "velocity", "acceleration")
# roots found numerically take time
COSTLY = ("looper", "warp_knitter")
EVERY = [pytest.param(name, marks=pytest.mark.long) if name in COSTLY else name for name in CASES]


def determined_motion(linkage, angles, **rates):
    """Return the motion if every link is determined, which a guide or hinge in a singular pose is not."""
    try:
        return linkage.solve(angles, **rates)
    except ms.AssemblyError as error:
        assert "is undetermined at crank angle" in str(error) or "lies on the rocker axis" in str(error)
        assume(False)


def test_every_mechanism_of_the_catalogue_has_a_test_case():
    assert CASES.keys() == {*ms.catalog.MECHANISMS}


@pytest.mark.long
@pytest.mark.parametrize("name", EVERY)
@given(st.data())
def test_motions_satisfy_the_loop_equations_and_their_derivatives(name, data):
    linkage = data.draw(CASES[name].random)
    angles = angles_of(linkage, count=4, lowest_transmission=0.1)
    motion = determined_motion(linkage, angles, speed=7.0, acceleration=-3.0)
    agrees_with_loop_equations(linkage, motion, CASES[name].slack(linkage))
    positions = linkage.positions(angles)
    for point, motion_of in motion.points.items():
        assert (positions[point] == motion_of.position).all()


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_points_of_one_link_keep_their_distances(name, data):
    linkage = data.draw(CASES[name].random)
    points, described = linkage.positions(angles_of(linkage)), linkage.mechanism.points
    limit = CASES[name].slack(linkage) * CLOSED * longest(linkage)
    for item, (link, local) in described.items():
        for other, (same, other_local) in described.items():
            if link == same:
                distance = np.linalg.norm(points[item] - points[other], axis=1)
                assert np.abs(distance - np.linalg.norm(np.subtract(local, other_local))).max() <= limit


@pytest.mark.parametrize("name", EVERY)
@given(st.data())
def test_the_assembly_sign_is_positive_and_negative_for_the_other_branch(name, data):
    linkage = data.draw(CASES[name].random)
    away = angles_of(linkage, lowest_transmission=1e-6)
    points = linkage.positions(away)
    assert (linkage.assembly_sign(points) >= 0.0).all()
    if name in SIDES:
        assert (np.sign(SIDES[name](linkage, points)) == linkage.branch).all()
    if name in TWO_BRANCHES:
        other = linkage.with_parameters(branch=-linkage.branch)
        assert (linkage.assembly_sign(other.positions(away)) <= 0.0).all()
        assert [twin.branch for twin in linkage.assemblies(away[0])] == [1, -1]


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_the_mirrored_mechanism_has_the_mirrored_motion(name, data):
    case = CASES[name]
    if case.mirror is None:
        pytest.skip("its assembly modes are numbered by angle, which a mirror reverses")
    linkage = data.draw(case.random)
    mirrored, direction, image = case.mirror(linkage)
    angles = angles_of(linkage, 6, lowest_transmission=0.05)
    original, reflected = linkage.positions(angles), mirrored.positions(direction * angles)
    for point, position in original.items():
        # in the plane only signs differ
        limit = 0.0 if direction < 0.0 else (case.scaled or CLOSED) * longest(linkage)
        assert np.abs(position * image - reflected[point]).max() <= limit


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data(), st.sampled_from([2.0**-7, 2.0**5]))
def test_larger_dimensions_scale_the_motion(name, data, scale):
    linkage = data.draw(CASES[name].random)
    larger, angles = resized(linkage, scale), angles_of(linkage, 6, lowest_transmission=1e-3)
    original, scaled = (item.solve(angles, 3.0, 2.0).points for item in (linkage, larger))
    for point, motion in original.items():
        for quantity in QUANTITIES:
            expected = scale * getattr(motion, quantity)
            limit = CASES[name].scaled * max(np.abs(expected).max(), scale * longest(linkage))
            if quantity == "position" or not limit:
                assert np.abs(getattr(scaled[point], quantity) - expected).max() <= limit


@pytest.mark.long
@pytest.mark.parametrize("name", EXACT_POINTS)
@settings(max_examples=12)
@given(st.data(), st.floats(1.0, 300.0), st.floats(-500.0, 500.0))
def test_motions_agree_with_fifty_digits(name, data, speed, acceleration):
    linkage = data.draw(CASES[name].random)
    point, by_digits = EXACT_POINTS[name]
    angles = angles_of(linkage, count=3, lowest_transmission=0.05)
    motion = linkage.solve(angles, speed, acceleration).points[point]
    for i, f in enumerate(angles):
        p, first, second = by_digits(linkage, f)
        assert np.linalg.norm(motion.position[i] - p) <= 1e-13 * longest(linkage) / 0.05
        v, a = speed * first, acceleration * first + speed**2 * second
        scale = speed * longest(linkage)
        assert np.linalg.norm(motion.velocity[i] - v) <= 1e-10 * max(np.linalg.norm(v), scale)
        scale *= speed
        assert np.linalg.norm(motion.acceleration[i] - a) <= 1e-10 * max(np.linalg.norm(a), scale)


@pytest.mark.parametrize("name", EVERY)
def test_a_faulty_description_violates_the_loop_equations(name):
    linkage = ms.catalog.make(name)
    motion = linkage.solve(np.linspace(0.1, 6.0, 9), 7.0, -3.0)
    agrees_with_loop_equations(linkage, motion)
    for changes in FAULTS[linkage.name].values():
        if not {"branch", "side", "assembly"} & changes.keys():
            with pytest.raises(AssertionError):
                agrees_with_loop_equations(linkage.with_parameters(**changes), motion)
