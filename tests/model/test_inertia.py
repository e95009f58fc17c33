import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mechsim.errors import InputError
from mechsim.model.links import Inertia, combine

CUBE = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0))


@pytest.mark.parametrize("mass", [-1.0, 1e-70, np.nan, np.inf])
def test_an_invalid_mass_is_rejected(mass):
    with pytest.raises(InputError, match=r"mass of a link is .* kg; give"):
        Inertia(mass, (0.0, 0.0, 0.0), CUBE)


@pytest.mark.parametrize(
    ("moments", "output"),
    [
        ((1.0, 1.0, 2.1), "no body has one above the sum of the others, 2 kg m2"),
        ((1.0, 0.5, 0.0), "no body has one above the sum of the others, 0.5 kg m2"),
        ((1.0, -1.0, 1.0), "none can be below 0"),
        (((2.0, 0.1, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0)), "differs from its transpose by 0.1"),
        (((2.0, 0.0), (0.0, 2.0)), "not 3 x 3 finite numbers"),
        ((np.nan, 1.0, 1.0), "not 3 x 3 finite numbers"),
        # a product of inertia hides principal moments 0.5, 1.5 and 2.5
        (((1.0, 0.5, 0.0), (0.5, 1.0, 0.0), (0.0, 0.0, 2.5)), "no body has one above the sum"),
    ],
)
def test_an_impossible_inertia_is_rejected(moments, output):
    with pytest.raises(InputError, match=output):
        Inertia(1.0, (0.0, 0.0, 0.0), moments)


def test_a_centre_must_be_three_finite_numbers():
    with pytest.raises(InputError, match="centre of mass"):
        Inertia(1.0, (0.0, np.nan, 0.0), CUBE)


centres = st.tuples(*[st.integers(-999, 999).map(lambda value: (value + 0.37) * 1e-3)] * 3)


@given(st.lists(st.tuples(st.floats(0.1, 5.0), centres), min_size=1, max_size=4))
def test_combined_bodies_have_the_sum_of_moments(masses_and_centres):
    bodies = [Inertia(mass, centre, (0.4, 0.5, 0.6)) for mass, centre in masses_and_centres]
    whole = combine(bodies)
    about = np.sum([body.about((0.3, -0.2, 0.7)) for body in bodies], axis=0)
    assert np.allclose(whole.about((0.3, -0.2, 0.7)), about, rtol=1e-12, atol=1e-12)
    assert whole.mass == pytest.approx(sum(mass for mass, _ in masses_and_centres), rel=1e-14)
