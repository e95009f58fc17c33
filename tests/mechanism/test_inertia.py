import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mechsim.mechanism.links import Inertia, combine

centres = st.tuples(*[st.integers(-999, 999).map(lambda value: (value + 0.37) * 1e-3)] * 3)


@given(st.lists(st.tuples(st.floats(0.1, 5.0), centres), min_size=1, max_size=4))
def test_combined_bodies_have_the_sum_of_moments(masses_and_centres):
    bodies = [Inertia(mass, centre, (0.4, 0.5, 0.6)) for mass, centre in masses_and_centres]
    whole = combine(bodies)
    about = np.sum([body.about((0.3, -0.2, 0.7)) for body in bodies], axis=0)
    assert np.allclose(whole.about((0.3, -0.2, 0.7)), about, rtol=1e-12, atol=1e-12)
    assert whole.mass == pytest.approx(sum(mass for mass, _ in masses_and_centres), rel=1e-14)
