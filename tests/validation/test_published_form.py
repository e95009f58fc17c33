"""The validation case of the published unit vector must reproduce its loss of significance."""

import mpmath
import numpy as np
import published_form as case
from hypothesis import assume, given
from strategies import EPS, lengths, turns


def test_only_the_published_form_loses_digits_near_zero():
    distances = np.array([1e-9, 1e-6, 1e-3, 1e-1])
    published, accurate = case.errors_near_zero(distances)
    # a hundredth of rounding over the distance squared, within a factor of a hundred either way
    assert (published[:3] > 1e-20 / distances[:3] ** 2).all()
    assert (published[:3] < 1e-16 / distances[:3] ** 2).all()
    assert published[3] < 1e-14
    assert accurate.max() <= 4e-16


def test_the_published_form_changes_assembly_twice_per_turn():
    angles = np.linspace(0.0, 2 * np.pi, 720, endpoint=False) + 1e-3
    published, accurate = case.assemblies_over_a_turn(angles)
    assert case.mode_changes(published) == 2
    assert (accurate == 1).all()
    # the jumps are where V3x = P4P2_y changes sign
    v3x = case.LOOPER.crank * np.cos(angles) - case.LOOPER.pivot[1]
    assert (published == np.sign(v3x)).all()


@given(lengths, lengths, turns)
def test_the_triangle_angle_agrees_with_fifty_digits(l1, l2, angle):
    l3 = abs(l1 - l2 * np.exp(1j * angle))
    assume(l3 > 1e-6)
    with mpmath.workdps(50):
        a, b, c = mpmath.mpf(l1), mpmath.mpf(l2), mpmath.mpf(float(l3))
        cosine = (a * a + b * b - c * c) / (2 * a * b)
        assume(abs(cosine) < 1)
        expected = float(mpmath.acos(cosine))
    measured = float(case.triangle_angle(l1, l2, l3))
    # Kahan's bound holds if the lengths determine the angle, so not for a flat triangle
    conditioned = min(expected, np.pi - expected) > 1e-6
    assert abs(measured - expected) <= (8 * EPS if conditioned else 1e-9) * np.pi
