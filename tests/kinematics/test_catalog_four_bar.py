import numpy as np
import pytest
from hypothesis import given
from strategies import EPS, four_bars, longest

import mechsim as ms


@given(four_bars())
def test_coupler_and_rocker_are_collinear_at_dead_centres(linkage):
    ends = []
    for reach in (linkage.coupler + linkage.rocker, abs(linkage.coupler - linkage.rocker)):
        cosine = (linkage.ground**2 + linkage.crank**2 - reach**2) / (2 * linkage.ground * linkage.crank)
        if abs(cosine) < 1.0:
            ends += [np.arccos(cosine), -np.arccos(cosine)]
    result = [(f + np.pi) % (2 * np.pi) - np.pi for f in linkage.dead_centres()]
    assert len(result) == len(ends)
    for end in ends:
        # the cosine has an error of a few ulp of the squares, the angle that divided by its sine
        slack = 64 * EPS * (longest(linkage) ** 2 / (linkage.ground * linkage.crank)) / abs(np.sin(end))
        assert min(abs((f - end + np.pi) % (2 * np.pi) - np.pi) for f in result) <= slack


def test_a_loop_that_cannot_close_reports_the_crank_range():
    linkage = ms.catalog.make("four_bar").with_parameters(crank=0.08)
    (low, high), *_ = linkage.crank_range().arcs
    with pytest.raises(
        ms.AssemblyError, match=r"does not close at crank angle .* its range is from .* to .* rad"
    ):
        linkage.positions([high + 0.1])
    assert np.isfinite(linkage.positions([low + 1e-9, high - 1e-9])["B"]).all()
