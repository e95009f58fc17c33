from dataclasses import replace

import numpy as np
import pytest
from exact import slider_crank_b
from hypothesis import given, settings
from strategies import CLOSED, EPS, angles_of, slider_cranks

from mechsim import closure
from mechsim.analytic.catalog.slider_crank import SliderCrank
from mechsim.errors import AssemblyError
from mechsim.model.mechanism import Pose


def longest(drive: SliderCrank) -> float:
    return max(drive.crank, drive.rod, abs(drive.offset))


@given(slider_cranks())
def test_links_keep_their_lengths_and_the_slider_its_height(drive):
    points = drive.positions(angles_of(drive))
    for vectors, length in ((points["A"], drive.crank), (points["B"] - points["A"], drive.rod)):
        assert np.abs(np.linalg.norm(vectors, axis=1) - length).max() <= CLOSED * longest(drive)
    assert (points["B"][:, 1] == drive.offset).all()


@given(slider_cranks())
def test_branch_says_whether_the_slider_is_ahead_of_the_pin(drive):
    points = drive.positions(angles_of(drive))
    assert (np.sign(points["B"][:, 0] - points["A"][:, 0]) == drive.branch).all()
    assert (drive.assembly_sign(points) > 0.0).all()


@given(slider_cranks())
def test_mirror_images_are_the_other_offset_and_the_other_branch(drive):
    angles = angles_of(drive)
    here = drive.positions(angles)["B"]
    below = replace(drive, offset=-drive.offset).positions(-angles)["B"]
    assert (here * [1.0, -1.0, 1.0] == below).all()
    behind = replace(drive, branch=-drive.branch).positions(np.pi - angles)["B"]
    # pi - angle is rounded, which a rod nearly across the slide makes much of
    assert np.abs(here * [-1.0, 1.0, 1.0] - behind).max() <= 1e-13 * longest(drive) / 1e-3


@settings(max_examples=25)
@given(slider_cranks())
def test_position_velocity_and_acceleration_agree_with_fifty_digits(drive):
    speed, acceleration = 11.0, -70.0
    angles = angles_of(drive, count=3, lowest_transmission=0.05)
    point = drive.solve(angles, speed, acceleration).points["B"]
    for i, f in enumerate(angles):
        p, first, second = slider_crank_b(drive, f)
        assert np.linalg.norm(point.position[i] - p) <= 1e-13 * longest(drive) / 0.05
        v, a = speed * first, acceleration * first + speed**2 * second
        scale = speed * longest(drive)
        assert np.linalg.norm(point.velocity[i] - v) <= 1e-10 * max(np.linalg.norm(v), scale)
        scale *= speed
        assert np.linalg.norm(point.acceleration[i] - a) <= 1e-10 * max(np.linalg.norm(a), scale)


@settings(max_examples=20)
@given(slider_cranks())
def test_motion_of_every_link_satisfies_the_loop_equations_and_their_rates(drive):
    angles = angles_of(drive, count=4, lowest_transmission=0.1)
    motion = drive.solve(angles, 7.0, -3.0)
    mechanism = drive.mechanism
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    open_by, turned_by = closure.residual_norms(mechanism, poses, angles)
    assert open_by.max() <= CLOSED * longest(drive)
    assert turned_by.max() <= 32 * EPS
    exact = closure.rates(mechanism, poses, angles, 7.0, -3.0)
    for name, link in motion.links.items():
        for part in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"):
            measured, expected = getattr(link, part), getattr(exact.links[name], part)
            scale = max(np.abs(expected).max(), 49.0 * longest(drive))
            assert np.abs(measured - expected).max() <= 1e-10 * scale
    for name in ("A", "slide"):
        for part in ("value", "rate", "acceleration"):
            measured, expected = getattr(motion.joints[name], part), getattr(exact.joints[name], part)
            # an angle may be told a turn apart
            gap = measured - expected
            gap = gap - 2 * np.pi * np.round(gap / (2 * np.pi)) if part == "value" else gap
            assert np.abs(gap).max() <= 1e-10 * max(np.abs(expected).max(), 49.0 * longest(drive))


@given(slider_cranks())
def test_dead_centres_are_where_the_rod_stands_across_the_slide(drive):
    ends = []
    for height in (drive.offset + drive.rod, drive.offset - drive.rod):
        sine = height / drive.crank
        if abs(sine) < 1.0:
            ends += [np.arcsin(sine), np.pi - np.arcsin(sine)]
    found = drive.dead_centres()
    assert len(found) == len(ends)
    for end in ends:
        slack = 64 * EPS * (longest(drive) / drive.crank) ** 2 / abs(np.cos(end))
        assert min(abs((f - end + np.pi) % (2 * np.pi) - np.pi) for f in found) <= slack


def test_a_slide_out_of_reach_is_refused():
    drive = SliderCrank(crank=0.05, rod=0.02, offset=0.2)
    assert drive.assemblies(0.0) == []
    with pytest.raises(AssemblyError, match="can close nowhere in the turn"):
        drive.positions([0.0])
