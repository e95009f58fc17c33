import numpy as np
import pytest
from hypothesis import given
from strategies import CLOSED, EPS, angles_of, longest, slider_cranks

from mechsim import catalog
from mechsim.errors import AssemblyError


@given(slider_cranks())
def test_links_keep_their_lengths_and_the_slider_its_height(linkage):
    points = linkage.positions(angles_of(linkage))
    for vectors, length in ((points["A"], linkage.crank), (points["B"] - points["A"], linkage.rod)):
        assert np.abs(np.linalg.norm(vectors, axis=1) - length).max() <= CLOSED * longest(linkage)
    assert (points["B"][:, 1] == linkage.offset).all()


@given(slider_cranks())
def test_branch_selects_the_side_of_the_slider(linkage):
    points = linkage.positions(angles_of(linkage))
    assert (np.sign(points["B"][:, 0] - points["A"][:, 0]) == linkage.branch).all()
    assert (linkage.assembly_sign(points) > 0.0).all()


@given(slider_cranks())
def test_mirror_images_have_the_opposite_offset_and_branch(linkage):
    angles = angles_of(linkage)
    original = linkage.positions(angles)["B"]
    mirrored = linkage.with_parameters(offset=-linkage.offset).positions(-angles)["B"]
    assert (original * [1.0, -1.0, 1.0] == mirrored).all()
    opposite = linkage.with_parameters(branch=-linkage.branch).positions(np.pi - angles)["B"]
    # a rod almost perpendicular to the slide amplifies the rounding of pi - angle
    assert np.abs(original * [-1.0, 1.0, 1.0] - opposite).max() <= 1e-13 * longest(linkage) / 1e-3


@given(slider_cranks())
def test_the_rod_is_perpendicular_to_the_slide_at_dead_centres(linkage):
    ends = []
    for height in (linkage.offset + linkage.rod, linkage.offset - linkage.rod):
        sine = height / linkage.crank
        if abs(sine) < 1.0:
            ends += [np.arcsin(sine), np.pi - np.arcsin(sine)]
    result = linkage.dead_centres()
    assert len(result) == len(ends)
    for end in ends:
        slack = 64 * EPS * (longest(linkage) / linkage.crank) ** 2 / abs(np.cos(end))
        assert min(abs((f - end + np.pi) % (2 * np.pi) - np.pi) for f in result) <= slack


def test_a_slide_out_of_reach_is_rejected():
    linkage = catalog.make("slider_crank", crank=0.05, rod=0.02, offset=0.2)
    assert linkage.assemblies(0.0) == []
    with pytest.raises(AssemblyError, match="cannot close at any crank angle"):
        linkage.positions([0.0])
