"""Motion on any revolution of the crank, of locked joints and of links with a passive spin."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import five_bar
from mechanisms import end_at, rsup
from model_files import stated_mechanism

import mechsim as ms
from mechsim.kinematics.loops.motion import driven_path, motion_along
from mechsim.kinematics.loops.record import with_all_joints
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion import select_instants

REVOLUTION = 2.0 * np.pi
# the crank swings about its start by less than half a radian in either direction
LENGTHS = {"ground": 0.1, "crank": 0.06, "coupler": 0.03, "rocker": 0.05}


def swinging(**coupling) -> ms.Mechanism:
    """Return a four-bar with a swinging crank and a wheel coupled to it."""
    mechanism = ms.catalog.make("four_bar", **LENGTHS).mechanism
    if not coupling:
        return mechanism
    coupled = ms.Joint("coupled", "revolute", end_at(GROUND, (0.2, 0.0, 0.0)), end_at("wheel"))
    start = mechanism.start
    coordinate = coupling["coefficients"][0] + coupling["coefficients"][1] * start
    guess = dict(mechanism.guess)
    c, s = np.cos(coordinate), np.sin(coordinate)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    guess["wheel"] = ms.Pose(np.array([0.2, 0.0, 0.0]), rotation)
    whole = replace(
        mechanism,
        links=(*mechanism.links, ms.Link("wheel")),
        joints=(*mechanism.joints, coupled),
        couplings=(ms.Coupling("law", "coupled", "crank", turns=True, **coupling),),
    )
    return whole.with_guess(guess, start)


@pytest.mark.long
@pytest.mark.parametrize("revolutions", [pytest.param(1, marks=pytest.mark.slow), -2])
@pytest.mark.parametrize("wheel", [{}, {"coefficients": (0.3, 2.0)}, {"coefficients": (0.3, -1.0)}])
def test_a_swing_counted_on_another_revolution_has_the_same_motion(wheel, revolutions):
    mechanism = swinging(**wheel)
    angles = mechanism.start + np.array([0.5, -0.3, 0.1])
    first, second = (
        ms.loops.solve(mechanism, angles + rotation, 2.0, -3.0)
        for rotation in (0.0, revolutions * REVOLUTION)
    )
    for name, joint in first.joints.items():
        counted = revolutions * REVOLUTION if name == "crank" else 0.0
        for quantity in ("value", "rate", "acceleration"):
            offset = counted if quantity == "value" else 0.0
            expected = getattr(joint, quantity) + offset
            np.testing.assert_allclose(getattr(second.joints[name], quantity), expected, atol=1e-12)
    for name, link in first.links.items():
        np.testing.assert_allclose(second.links[name].position, link.position, atol=1e-14)
        np.testing.assert_allclose(second.links[name].rotation, link.rotation, atol=1e-13)


@pytest.mark.long
@pytest.mark.parametrize(
    ("ratio", "revolutions", "same"), [(1.5, 1, False), (1.5, -2, True), (1.0 + 1e-9, 1, False)]
)
def test_geared_links_must_repeat_on_another_revolution(ratio, revolutions, same):
    mechanism = swinging(coefficients=(0.003, ratio))
    angles = mechanism.start + revolutions * REVOLUTION + np.array([0.2])
    if same:
        wheel = ms.loops.solve(mechanism, angles).links["wheel"].rotation[0]
        np.testing.assert_allclose(wheel[:2, 0], [np.cos(0.303), np.sin(0.303)], atol=1e-14)
    else:
        with pytest.raises(ms.AssemblyError, match="the crank cannot pass"):
            ms.loops.solve(mechanism, angles)


def test_a_path_can_start_on_another_revolution():
    mechanism = swinging()
    path, _ = motion_along(driven_path(mechanism), *np.array([[mechanism.start + REVOLUTION], [1.0], [0.0]]))
    assert path.initial == mechanism.start + REVOLUTION
    assert path.start.values[path.loops.driven[0]] == path.initial
    assert ms.loops.solve(mechanism, [0.1, 0.2]).speed.tolist() == [1.0, 1.0]
    assert ms.loops.solve(mechanism, [0.1, 0.2]).acceleration.tolist() == [0.0, 0.0]


def test_a_locked_joint_keeps_its_value_at_any_crank_speed():
    mechanism = replace(five_bar(), driver="left", locked={"right": 1.2}, start=2.0, guess_coordinates={})
    motion = ms.loops.solve(mechanism, [1.9, 2.1], 5.0, -7.0)
    for quantity, expected in (("value", 1.2), ("rate", 0.0), ("acceleration", 0.0)):
        np.testing.assert_allclose(getattr(motion.joints["right"], quantity), expected, atol=1e-15)
    assert motion.joints["left"].rate.tolist() == [5.0, 5.0]
    assert motion.joints["left"].acceleration.tolist() == [-7.0, -7.0]


@pytest.mark.parametrize(
    ("name", "idle"), [("rssr", {"coupler"}), ("rrsrr", set()), ("four_bar", set()), ("bennett", set())]
)
def test_links_with_a_passive_spin_are_reported(name, idle):
    linkage = ms.catalog.make(name)
    assert ms.loops.solve(linkage.mechanism, [linkage.mechanism.start + 0.3]).spinning == idle


def test_a_rod_that_spins_about_a_frame_axis_is_reported():
    assert ms.loops.solve(stated_mechanism("crank_motion_line.toml"), [0.0]).spinning == {"rod"}


def test_crank_rates_are_scalars_or_one_per_angle():
    mechanism, angles = rsup(), np.array([0.7, 0.8, 0.9])
    even = ms.loops.solve(mechanism, angles, 1.3)
    for speed in ([1.3], [1.3] * 3):
        for acceleration in (0.0, [0.0], [0.0] * 3):
            same = ms.loops.solve(mechanism, angles, speed, acceleration)
            assert np.array_equal(same.acceleration, np.zeros(3))
            for name, point in even.points.items():
                assert np.array_equal(point.acceleration, same.points[name].acceleration)
    for wrong in ([1.0, 2.0], np.nan, [1.0, np.inf, 1.0], [[1.0]]):
        with pytest.raises(ms.InputError, match="the crank's speed must be finite; give one number, or 3"):
            ms.loops.solve(mechanism, angles, wrong)


# joints on moving links: a slide on a lever, universal joints of a shaft, a sleeve of a rod
@pytest.mark.parametrize("name", ["quick_return", "double_cardan", "rsur"])
def test_joint_motion_from_links_agrees_with_the_loop_equations(name):
    solver = ms.load(name)
    start = solver.mechanism.start
    exact = solver.solve(np.linspace(start, start + 2.0, 41), 3.0, -2.0)
    result = with_all_joints(solver.mechanism, replace(exact, joints={})).joints
    assert result.keys() == exact.joints.keys()
    for joint, expected in exact.joints.items():
        turns = np.round((result[joint].value - expected.value)[0] / (2.0 * np.pi)) * 2.0 * np.pi
        shift = turns if expected.unit == "rad" else 0.0
        np.testing.assert_allclose(result[joint].value - shift, expected.value, atol=1e-12)
        scale = max(1.0, np.abs(expected.rate).max()), max(1.0, np.abs(expected.acceleration).max())
        np.testing.assert_allclose(result[joint].rate, expected.rate, atol=1e-12 * scale[0])
        np.testing.assert_allclose(result[joint].acceleration, expected.acceleration, atol=1e-11 * scale[1])
        assert (result[joint].unit, result[joint].index) == (expected.unit, expected.index)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_revolutions_between_samples_are_counted_from_the_speed(direction):
    solver = ms.load("slider_crank")
    time = 0.02 * np.arange(246)
    angles = direction * 2.0 * np.pi * (time + 0.03 * time**2)
    exact = solver.solve(angles, direction * 2.0 * np.pi * (1.0 + 0.06 * time), direction * 0.12 * np.pi)
    # samples are 0.7 revolutions apart at first, and more as the speed grows
    sparse = select_instants(replace(exact, joints={}, time=time), slice(None, None, 35))
    reported = with_all_joints(solver.mechanism, sparse).joints
    assert np.ptp(reported["crank"].value) > 8.0 * np.pi
    for name, item in reported.items():
        dense = exact.joints[name].value
        expected = (np.unwrap(dense) if item.unit == "rad" else dense)[::35]
        # measured 3e-14
        np.testing.assert_allclose(item.value, expected, rtol=0, atol=1e-13)


def test_reported_joints_are_kept_and_unknown_ones_omitted():
    solver = ms.load("slider_crank")
    exact = solver.solve([0.3, 0.4])
    own = replace(exact.joints["crank"], value=np.array([7.0, 8.0]))
    links = {name: item for name, item in exact.links.items() if name != "rod"}
    motion = replace(exact, links=links, joints={"crank": own, "extra": own})
    result = with_all_joints(solver.mechanism, motion).joints
    of_rod = {j.name for j in solver.mechanism.joints if "rod" in (j.a.link, j.b.link)}
    assert of_rod
    assert result.keys() == {*exact.joints, "extra"} - of_rod
    assert result["crank"] is result["extra"] is own
