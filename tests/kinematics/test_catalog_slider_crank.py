import numpy as np
from hypothesis import given
from strategies import EPS, angles_of, longest, slider_cranks


@given(slider_cranks())
def test_branch_selects_the_side_of_the_slider(linkage):
    points = linkage.positions(angles_of(linkage))
    assert (np.sign(points["B"][:, 0] - points["A"][:, 0]) == linkage.branch).all()
    assert (linkage.assembly_sign(points) > 0.0).all()


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
