import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import turns

from mechsim.kinematics.vector_method.trig_polynomial import reachable_arcs, sampled_polynomial
from mechsim.mechanism.motion_laws import Arcs
from mechsim.numerics.arrays import REVOLUTION


def with_roots(roots, scale=1.0):
    """Return a trigonometric polynomial of degree len(roots) / 2 with these roots and no others."""
    return lambda f: scale * np.prod([2.0 * np.sin((np.asarray(f) - root) / 2.0) for root in roots], axis=0)


def smallest_distance(roots):
    ordered = np.sort(roots)
    return np.diff(np.append(ordered, ordered[0] + REVOLUTION)).min()


@given(
    st.lists(turns, min_size=2, max_size=4).filter(lambda roots: len(roots) != 3),
    st.sampled_from([1e-9, -1e6]),
)
def test_arcs_end_at_the_roots_and_contain_positive_values(roots, scale):
    assume(smallest_distance(roots) > 0.05)
    polynomial = with_roots(roots, scale)
    arcs = reachable_arcs(sampled_polynomial(polynomial, 2 if len(roots) == 4 else 1))
    assert not arcs.full
    assert len(arcs.arcs) == len(roots) // 2
    ends = [end for arc in arcs.arcs for end in arc]
    for root in roots:
        assert min(abs((end - root + np.pi) % REVOLUTION - np.pi) for end in ends) <= 1e-12
    for low, high in arcs.arcs:
        assert -np.pi <= low < np.pi
        inside = np.linspace(low, high, 9)[1:-1]
        assert (polynomial(inside) > 0.0).all()


@given(turns)
def test_a_double_root_does_not_end_an_arc(double):
    arcs = reachable_arcs(sampled_polynomial(with_roots([double, double]), 1))
    assert arcs.full
    assert arcs.arcs == ((-np.pi, np.pi),)
    assert reachable_arcs(sampled_polynomial(with_roots([double, double], -1.0), 1)).arcs == ()


@given(turns, turns, turns)
def test_a_double_root_between_simple_roots_does_not_end_an_arc(double, low, high):
    assume(smallest_distance([double, low, high]) > 0.1)
    arcs = reachable_arcs(sampled_polynomial(with_roots([double, double, low, high]), 2))
    assert len(arcs.arcs) == 1
    for root in (low, high):
        assert min(abs((end - root + np.pi) % REVOLUTION - np.pi) for end in arcs.arcs[0]) <= 1e-9


@pytest.mark.parametrize("degree", [1, 2, 4])
@pytest.mark.parametrize("level", [3.0, 1e-12, 1e12])
def test_a_constant_has_a_full_arc_or_none(degree, level):
    assert reachable_arcs(sampled_polynomial(lambda f: np.full_like(f, level), degree)).full
    assert reachable_arcs(sampled_polynomial(lambda f: np.full_like(f, -level), degree)).arcs == ()


def test_a_degree_above_that_of_the_polynomial_gives_the_same_arcs():
    arcs = reachable_arcs(sampled_polynomial(with_roots([-0.5, 1.25]), 4))
    assert len(arcs.arcs) == 1
    assert sorted(end % REVOLUTION for end in arcs.arcs[0]) == pytest.approx(
        sorted([1.25, REVOLUTION - 0.5]), abs=1e-12
    )


def test_the_start_is_zero_or_the_middle_of_the_longest_arc():
    assert Arcs(True, ((-np.pi, np.pi),)).start() == 0.0
    assert Arcs(False, ((-0.2, 0.1),)).start() == 0.0
    assert Arcs(False, ((3.0, 7.0),)).start() == 0.0  # wraps past a whole turn
    assert Arcs(False, ((0.5, 0.6), (1.0, 2.0))).start() == 1.5
    assert Arcs(False, ()).start() == 0.0
