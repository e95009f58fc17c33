"""Names of mechanisms mean the same in Python as on the command line."""

import pytest
from motions import largest_difference

import mechsim as ms


@pytest.mark.parametrize("name", ["four_bar", "klann"])
def test_a_name_gives_the_run_of_its_mechanism(name):
    named = ms.simulate(name, speed="60rpm", turns=0.1)
    loaded = ms.simulate(ms.load(name), speed="60rpm", turns=0.1)
    assert largest_difference(named.motion, loaded.motion) == 0.0
