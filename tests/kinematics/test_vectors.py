import exact_solutions as exact
import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from strategies import EPS, branches, lengths, offsets, turns

import mechsim as ms

triples = st.tuples(offsets, offsets, offsets).map(lambda v: 100.0 * np.array(v))


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rotations_about_coordinate_axes_agree_with_scipy(axis):
    expected = Rotation.from_rotvec(0.83 * np.eye(3)["xyz".index(axis)]).as_matrix()
    assert np.abs(ms.vectors.rotation(axis, 0.83) - expected).max() <= 4 * EPS


@given(triples, triples, turns, turns, branches)
def test_a_unit_vector_has_both_angles_and_its_side(v1, v2, first, second, sign):
    angle1, angle2 = abs(first), abs(second)
    between = np.linalg.norm(np.cross(v1, v2)) / (np.linalg.norm(v1) * np.linalg.norm(v2))
    assume(between > 1e-3)
    p = ms.vectors.unit_at_angles(v1, v2, angle1, angle2, sign)
    assume(np.isfinite(p).all())
    limit = 32 * EPS / between
    assert abs(np.linalg.norm(p) - 1.0) <= limit / between
    for v, angle in ((v1, angle1), (v2, angle2)):
        # Cramer's rule for two equations whose determinant is the square of the sine between the axes
        assert abs(p @ v / np.linalg.norm(v) - np.cos(angle)) <= limit / between
    assert sign * (p @ np.cross(v1, v2)) >= -limit * np.linalg.norm(v1) * np.linalg.norm(v2)


@pytest.mark.parametrize("difference", [0.0, 1e-9, -1e-9, 1e-5])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_unit_vector_is_exact_where_the_published_form_is_singular(difference, sign):
    v1, v2 = np.array([1.3, 0.4, 0.0]), np.array([-0.2, 0.9, difference])  # v1 x v2 along Z but for the gap
    p = ms.vectors.unit_at_angles(v1, v2, 0.9, 0.7, sign)
    assert np.abs(p - exact.unit_at_angles(v1, v2, 0.9, 0.7, sign)).max() <= 4 * EPS


@given(st.integers(1, 10**9), st.integers(1, 10**9), st.integers(1, 10**12 - 1))
def test_a_triangle_angle_agrees_with_many_digits(first, second, fraction):
    a, b = float(first), float(second)
    # the opposite side lies between the difference of the others and their sum, often close to one of them
    c = abs(a - b) + 2.0 * min(a, b) * (fraction * 1e-12) ** 2
    assume(abs(a - b) < c < a + b)
    with mp.workdps(150):
        right = mp.acos((mp.mpf(a) ** 2 + mp.mpf(b) ** 2 - mp.mpf(c) ** 2) / (2 * mp.mpf(a) * mp.mpf(b)))
        assert abs(mp.mpf(float(ms.vectors.triangle_angle(a, b, c))) / right - 1) <= 16 * EPS


def test_a_triangle_that_does_not_close_has_no_angle():
    assert np.isnan(ms.vectors.triangle_angle([1.0, 3.0], 1.0, [2.5, 1.0])).all()


def formula_of_the_spatial_four_bar(sign):
    """Return a user's formula of the mechanism `rssr` with its default dimensions, from `mechsim.vectors`."""

    def formula(angle):
        ex, ey = ms.vectors.column((1.0, 0.0, 0.0)), ms.vectors.column((0.0, 1.0, 0.0))
        pivot = ms.vectors.column((0.043, -0.010, -0.024))
        frame = ms.vectors.rotation("y", np.deg2rad(20.0)) @ ms.vectors.rotation("x", np.deg2rad(30.0))
        to_crank = 0.013 * ms.vectors.rotate(ey, ex, angle) - pivot
        between = ms.vectors.triangle_angle(ms.vectors.norm(to_crank), 0.027, 0.046)
        p3 = pivot + 0.027 * ms.vectors.unit_at_angles(to_crank, frame[:, 2:], between, np.pi / 2, sign)
        return {"P3": p3.T}

    return formula


@pytest.mark.parametrize(("sign", "outcome"), [(-1, "passed"), (1, "failed")])
def test_a_users_formula_is_built_from_the_operations(sign, outcome):
    result = ms.validate("rssr", formula_of_the_spatial_four_bar(sign), tolerance=1e-15, stepped=False)
    assert result.outcome == outcome


def test_impossible_angles_give_nan():
    x, y = np.array([1.0, 0.1, 0.0]), np.array([0.2, 1.0, 0.0])
    with np.errstate(invalid="ignore"):
        assert np.isnan(ms.vectors.unit_at_angles(x, y, 0.1, 0.1, 1)).all()


@given(triples, turns, turns, lengths, lengths, triples, branches)
def test_a_circle_and_a_sphere_intersect_on_both(centre, first, second, radius, reach, away, sign):
    radius, reach = 100 * radius, 100 * reach
    frame = ms.vectors.rotation("y", first) @ ms.vectors.rotation("x", second)
    column, axis = ms.vectors.column, ms.vectors.column(frame[:, 2])
    other = column(centre + away)
    with np.errstate(invalid="ignore"):
        p = ms.vectors.circle_sphere(column(centre), axis, radius, other, reach, sign)
    assume(np.isfinite(p).all())
    length = max(radius, reach, np.linalg.norm(centre), np.linalg.norm(away))
    assert abs(np.linalg.norm(p) - 1.0) <= 8 * EPS * length / radius
    difference = other - column(centre)
    offset = ms.vectors.norm(difference - ms.vectors.dot(difference, axis) * axis)[0]
    assume(offset > 1e-3 * length)
    assert abs(ms.vectors.dot(p, axis)[0]) <= 8 * EPS * max(1.0, length / offset)
    position = column(centre) + radius * p
    assert abs(ms.vectors.norm(position - other)[0] - reach) <= 16 * EPS * length * max(1.0, length / reach)
    side = ms.vectors.dot(p, ms.vectors.cross(difference, axis))[0]
    assert sign * side >= -16 * EPS * length
