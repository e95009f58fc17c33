from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from strategies import CLOSED, EPS, angles_of, longest, slider_cranks

from mechsim.analytic.catalog.slider_crank import SliderCrank
from mechsim.errors import AssemblyError


@given(slider_cranks())
def test_links_keep_their_lengths_and_the_slider_its_height(drive):
    points = drive.positions(angles_of(drive))
    for vectors, length in ((points["A"], drive.crank), (points["B"] - points["A"], drive.rod)):
        assert np.abs(np.linalg.norm(vectors, axis=1) - length).max() <= CLOSED * longest(drive)
    assert (points["B"][:, 1] == drive.offset).all()


@given(slider_cranks())
def test_branch_selects_the_side_of_the_slider(drive):
    points = drive.positions(angles_of(drive))
    assert (np.sign(points["B"][:, 0] - points["A"][:, 0]) == drive.branch).all()
    assert (drive.assembly_sign(points) > 0.0).all()


@given(slider_cranks())
def test_mirror_images_have_the_opposite_offset_and_branch(drive):
    angles = angles_of(drive)
    here = drive.positions(angles)["B"]
    below = replace(drive, offset=-drive.offset).positions(-angles)["B"]
    assert (here * [1.0, -1.0, 1.0] == below).all()
    behind = replace(drive, branch=-drive.branch).positions(np.pi - angles)["B"]
    # pi - angle is rounded, which a rod nearly across the slide makes much of
    assert np.abs(here * [-1.0, 1.0, 1.0] - behind).max() <= 1e-13 * longest(drive) / 1e-3


@given(slider_cranks())
def test_the_rod_is_perpendicular_to_the_slide_at_dead_centres(drive):
    ends = []
    for height in (drive.offset + drive.rod, drive.offset - drive.rod):
        sine = height / drive.crank
        if abs(sine) < 1.0:
            ends += [np.arcsin(sine), np.pi - np.arcsin(sine)]
    result = drive.dead_centres()
    assert len(result) == len(ends)
    for end in ends:
        slack = 64 * EPS * (longest(drive) / drive.crank) ** 2 / abs(np.cos(end))
        assert min(abs((f - end + np.pi) % (2 * np.pi) - np.pi) for f in result) <= slack


def test_a_slide_out_of_reach_is_rejected():
    drive = SliderCrank(crank=0.05, rod=0.02, offset=0.2)
    assert drive.assemblies(0.0) == []
    with pytest.raises(AssemblyError, match="cannot close at any crank angle"):
        drive.positions([0.0])
