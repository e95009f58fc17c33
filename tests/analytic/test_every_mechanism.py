"""Laws of every closed form, run over the catalogue: a mechanism brings its row in `strategies.CASES`."""

from dataclasses import replace

import exact_solutions as exact
import numpy as np
import pytest
from catalog_faults import FAULTS
from grids import grid
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from laws import agrees_with_loop_equations
from strategies import CASES, CLOSED, angles_of, longest

from mechsim import catalog
from mechsim.errors import AssemblyError
from mechsim.studies.extremes.axes import resized

# mechanism -> the point that is known to fifty digits, and by what
DIGITS = {
    "four_bar": ("B", exact.four_bar_b),
    "slider_crank": ("B", exact.slider_crank_b),
    "rssr": ("P3", exact.rssr_p3),
}
PARTS = ("position", "velocity", "acceleration")


def held(drive, angles, **rates):
    """The motion, where every link is held: a guide or hinge in a singular pose holds none."""
    try:
        return drive.solve(angles, **rates)
    except AssemblyError as error:
        assert "is undetermined at crank angle" in str(error) or "lies on the rocker axis" in str(error)
        assume(False)


def test_every_mechanism_of_the_catalogue_has_a_test_case():
    assert CASES.keys() == catalog.DRIVES.keys()


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_motions_satisfy_the_loop_equations_and_their_derivatives(name, data):
    drive = data.draw(CASES[name].random)
    angles = angles_of(drive, count=4, lowest_transmission=0.1)
    motion = held(drive, angles, speed=7.0, acceleration=-3.0)
    agrees_with_loop_equations(drive, motion, CASES[name].slack(drive))
    places = drive.positions(angles)
    for point, motion_of in motion.points.items():
        assert (places[point] == motion_of.position).all()


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_points_of_one_link_keep_their_distances(name, data):
    drive = data.draw(CASES[name].random)
    points, described = drive.positions(angles_of(drive)), drive.mechanism.points
    bound = CASES[name].slack(drive) * CLOSED * longest(drive)
    for item, (link, local) in described.items():
        for other, (same, far) in described.items():
            if link == same:
                gap = np.linalg.norm(points[item] - points[other], axis=1)
                assert np.abs(gap - np.linalg.norm(np.subtract(local, far))).max() <= bound


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_the_assembly_sign_is_positive(name, data):
    drive = data.draw(CASES[name].random)
    away = angles_of(drive, lowest_transmission=1e-6)
    assert (drive.assembly_sign(drive.positions(away)) >= 0.0).all()


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data())
def test_the_mirrored_mechanism_has_the_mirrored_motion(name, data):
    case = CASES[name]
    if case.mirror is None:
        pytest.skip("its assemblies are numbered by angle, which a mirror turns about")
    drive = data.draw(case.random)
    mirrored, sense, image = case.mirror(drive)
    angles = angles_of(drive, 6, lowest_transmission=0.05)
    here, there = drive.positions(angles), mirrored.positions(sense * angles)
    for point, place in here.items():
        # in the plane nothing but signs differs
        bound = 0.0 if sense < 0.0 else (case.scaled or CLOSED) * longest(drive)
        assert np.abs(place * image - there[point]).max() <= bound


@pytest.mark.parametrize("name", grid(CASES))
@given(st.data(), st.sampled_from([2.0**-7, 2.0**5]))
def test_larger_dimensions_scale_the_motion(name, data, scale):
    drive = data.draw(CASES[name].random)
    larger, angles = resized(drive, scale), angles_of(drive, 6, lowest_transmission=1e-3)
    here, there = (item.solve(angles, 3.0, 2.0, links=False).points for item in (drive, larger))
    for point, motion in here.items():
        for part in PARTS:
            expected = scale * getattr(motion, part)
            bound = CASES[name].scaled * max(np.abs(expected).max(), scale * longest(drive))
            if part == "position" or not bound:
                assert np.abs(getattr(there[point], part) - expected).max() <= bound


@pytest.mark.parametrize("name", DIGITS)
@settings(max_examples=12)
@given(st.data(), st.floats(1.0, 300.0), st.floats(-500.0, 500.0))
def test_motions_agree_with_fifty_digits(name, data, speed, acceleration):
    drive = data.draw(CASES[name].random)
    point, by_digits = DIGITS[name]
    angles = angles_of(drive, count=3, lowest_transmission=0.05)
    motion = drive.solve(angles, speed, acceleration).points[point]
    for i, f in enumerate(angles):
        p, first, second = by_digits(drive, f)
        assert np.linalg.norm(motion.position[i] - p) <= 1e-13 * longest(drive) / 0.05
        v, a = speed * first, acceleration * first + speed**2 * second
        scale = speed * longest(drive)
        assert np.linalg.norm(motion.velocity[i] - v) <= 1e-10 * max(np.linalg.norm(v), scale)
        scale *= speed
        assert np.linalg.norm(motion.acceleration[i] - a) <= 1e-10 * max(np.linalg.norm(a), scale)


@pytest.mark.parametrize("name", grid(CASES))
def test_a_faulty_description_violates_the_loop_equations(name):
    drive = catalog.make(name)
    motion = drive.solve(np.linspace(0.1, 6.0, 9), 7.0, -3.0)
    agrees_with_loop_equations(drive, motion)
    for changes in FAULTS[drive.name].values():
        if not {"branch", "side", "assembly"} & changes.keys():
            with pytest.raises(AssertionError):
                agrees_with_loop_equations(replace(drive, **changes), motion)
