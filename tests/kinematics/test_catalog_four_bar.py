import numpy as np
from hypothesis import given
from strategies import EPS, four_bars, longest


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
