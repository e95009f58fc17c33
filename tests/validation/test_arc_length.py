from dataclasses import replace

import numpy as np
import pytest
from curve_equations import System, trace_curve, turning_points
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe
from torus_sphere import sphere, torus, torus_sphere, trace_path

from mechsim.analytic.catalog.four_bar import FourBar
from mechsim.analytic.catalog.rrsrr import Rrsrr
from mechsim.analytic.catalog.rssr import Rssr
from mechsim.analytic.catalog.slider_crank import SliderCrank
from mechsim.errors import AssemblyError, InputError

REVOLUTION = 2.0 * np.pi
FOUR_BAR = FourBar(crank=0.09)
SWINGING = {
    "four_bar": FOUR_BAR,
    "slider_crank": SliderCrank(rod=0.03),
    "rssr": Rssr(coupler=0.03),
    "rrsrr": Rrsrr(pivot=(-0.024, -0.008, 0.040)),
}


def ellipse(a: float, b: float) -> System:
    return System(
        lambda x: np.array([(x[0] / a) ** 2 + (x[1] / b) ** 2 - 1.0]),
        lambda x: np.array([[2.0 * x[0] / a**2, 2.0 * x[1] / b**2]]),
        scale=min(a, b),
    )


def crank_and_rocker(linkage: FourBar) -> System:
    """|AB| = coupler in the angles of crank and rocker, in units of the crank."""

    def residual(x):
        gap = linkage.ground + linkage.rocker * np.exp(1j * x[1]) - linkage.crank * np.exp(1j * x[0])
        return np.array([abs(gap) ** 2 - linkage.coupler**2]) / linkage.crank**2

    return System(residual, periods=(REVOLUTION, REVOLUTION), name="four-bar")


@pytest.mark.slow
@settings(max_examples=15)
@given(st.floats(0.3, 3.0), st.floats(0.05, 1.0), st.sampled_from([1.0, -1.0]))
def test_an_ellipse_closes_after_its_circumference(a, ratio, heading):
    b = a * ratio
    curve = trace_curve(ellipse(a, b), [a, 0.0], direction=[0.0, heading])
    assert curve.closed
    assert abs(curve.length - 4.0 * a * ellipe(1.0 - ratio**2)) <= 1e-8 * a
    x, y = curve.points.T
    assert np.abs((x / a) ** 2 + (y / b) ** 2 - 1.0).max() <= 1e-14
    assert np.sign(y[1]) == heading
    assert np.abs(curve.points[-1] - curve.points[0]).max() <= 1e-12 * a
    assert np.abs(np.linalg.norm(curve.tangents, axis=1) - 1.0).max() <= 1e-14
    assert curve.steps == len(curve.points) - 1 == len(curve.arc) - 1
    assert curve.newton >= curve.steps
    assert (np.diff(curve.arc) > 0.0).all()
    assert curve.arc[-1] == curve.length


def test_only_the_arc_length_error_depends_on_the_tolerance():
    errors = []
    for tolerance in (1e-4, 1e-7, 1e-10):
        curve = trace_curve(ellipse(3.0, 1.0), [3.0, 0.0], tolerance=tolerance)
        errors.append(abs(curve.length - 12.0 * ellipe(1.0 - 1.0 / 9.0)))
        assert errors[-1] <= 30.0 * tolerance
        x, y = curve.points.T
        assert np.abs((x / 3.0) ** 2 + y**2 - 1.0).max() <= 1e-14
    assert errors[0] > 100.0 * errors[2]


def test_redundant_equations_without_a_jacobian_are_traced():
    def residual(x):
        ball, height = x @ x - 1.0, x[2] - 0.3
        return np.array([ball, 2.0 * ball + height, height, ball - 3.0 * height])

    curve = trace_curve(System(residual), [np.sqrt(0.91), 0.0, 0.3])
    assert curve.closed
    assert abs(curve.length - REVOLUTION * np.sqrt(0.91)) <= 1e-9


def test_an_open_curve_is_traced_over_the_requested_length():
    parabola = System(lambda x: np.array([x[0] ** 2 - x[1]]))
    curve = trace_curve(parabola, [0.0, 0.0], direction=[1.0, 0.0], length=5.0)
    x = curve.points[-1, 0]
    assert not curve.closed
    assert curve.length == 5.0
    assert abs(0.5 * x * np.sqrt(1 + 4 * x * x) + 0.25 * np.arcsinh(2 * x) - 5.0) <= 1e-8


def test_a_spiral_near_its_start_is_not_closed():
    # a spiral in three dimensions with a pitch of about 6e-3
    spiral = System(
        lambda x: np.array([x[0] - np.cos(1e3 * x[2]), x[1] - np.sin(1e3 * x[2])]),
        lambda x: np.array([[1.0, 0.0, 1e3 * np.sin(1e3 * x[2])], [0.0, 1.0, -1e3 * np.cos(1e3 * x[2])]]),
    )
    curve = trace_curve(spiral, [1.0, 0.0, 0.0], length=15.0)
    assert not curve.closed
    scaled = replace(spiral, periods=(0.0, 0.0, REVOLUTION / 1e3))
    closed = trace_curve(scaled, [1.0, 0.0, 0.0])
    assert closed.closed
    assert abs(closed.length - REVOLUTION * np.sqrt(1.0 + 1e-6)) <= 1e-8


def test_both_modes_of_a_swinging_four_bar_form_one_curve():
    system, dead = crank_and_rocker(FOUR_BAR), FOUR_BAR.dead_centres()
    f = -1.0
    rocker = float(FOUR_BAR.solve([f]).joints["rocker"].value[0])
    curve = trace_curve(system, [f, rocker])
    assert curve.closed
    turning = turning_points(system, curve, 0)
    assert len(turning) == 2
    # at a turning point the angle error is the square of the error along the curve
    assert np.abs(np.sort(turning[:, 0]) - np.sort([a for a in dead if a < 0])).max() <= 1e-12
    observed = set()
    for crank, angle in curve.points:
        gaps = [
            abs(
                np.exp(1j * angle)
                - np.exp(1j * replace(FOUR_BAR, branch=b).solve([crank]).joints["rocker"].value[0])
            )
            for b in (1, -1)
        ]
        observed.add(int(np.argmin(gaps)))
        # near a dead centre the closed form keeps half the digits
        assert min(gaps) <= 1e-7
    assert observed == {0, 1}


def test_a_rotating_crank_closes_after_a_full_turn():
    linkage = FourBar()
    system = crank_and_rocker(linkage)
    start = [0.0, float(linkage.solve([0.0]).joints["rocker"].value[0])]
    curve = trace_curve(system, start, direction=[1.0, 0.0])
    assert curve.closed
    assert np.abs(curve.points[-1] - curve.points[0] - [REVOLUTION, 0.0]).max() <= 1e-12
    assert len(turning_points(system, curve, 0)) == 0
    assert len(turning_points(system, curve, 1)) == 2


@pytest.mark.parametrize("linkage", [Rrsrr(), SWINGING["rrsrr"]], ids=["turning", "swinging"])
def test_finite_differences_give_the_path_of_exact_gradients(linkage):
    path = trace_path(linkage)
    system = replace(torus_sphere(linkage), jacobian=None)
    curve = trace_curve(system, path.on_torus[0], direction=path.on_torus[1] - path.on_torus[0])
    assert curve.closed
    assert abs(curve.length - path.curve.length) <= 1e-9 * linkage.link


@pytest.mark.parametrize("linkage", [Rrsrr(), SWINGING["rrsrr"]], ids=["turning", "swinging"])
def test_the_four_parameters_of_the_paper_give_the_same_dead_centres(linkage):
    def residual(u):
        return (torus(linkage, u[0], u[1]) - sphere(linkage, u[2], u[3])) / linkage.link

    path, system = trace_path(linkage), System(residual, periods=(REVOLUTION,) * 4)
    curve = trace_curve(system, path.parameters[0], direction=path.parameters[1] - path.parameters[0])
    assert curve.closed
    turning = np.round((curve.points[-1] - curve.points[0]) / REVOLUTION)
    assert (turning == np.round((path.parameters[-1] - path.parameters[0]) / REVOLUTION)).all()
    dead = turning_points(system, curve, 0)[:, 0]
    ends = np.array(linkage.dead_centres())
    assert len(dead) == (2 if len(ends) else 0)
    assert all(np.abs(np.exp(1j * angle) - np.exp(1j * ends)).min() <= 1e-12 for angle in dead)


def test_invalid_systems_and_starts_are_rejected():
    circle = System(lambda x: np.array([x @ x - 1.0]), name="circle")
    cross = System(lambda x: np.array([x[0] * x[1]]), lambda x: np.array([[x[1], x[0]]]), name="cross")
    line = System(lambda x: np.array([x[0] - x[1]]))
    empty_curve = System(lambda x: np.array([x @ x + 1.0]))
    with pytest.raises(InputError, match=r"circle: the start is 0\.1 off the curve; the nearest point"):
        trace_curve(circle, [1.1, 0.0])
    with pytest.raises(InputError, match="no point of the curve is near"):
        trace_curve(empty_curve, [0.4, 0.3])
    with pytest.raises(InputError, match="more than one direction is free"):
        trace_curve(cross, [0.0, 0.0])
    with pytest.raises(AssemblyError, match=r"cross: (branches of the curve cross|more than one direction)"):
        trace_curve(cross, [-1.0, 0.0], direction=[1.0, 0.0])
    with pytest.raises(AssemblyError, match="not closed after 20 steps"):
        trace_curve(line, [0.0, 0.0], most_steps=20)
    with pytest.raises(InputError, match=r"1 equations .* 3 unknowns"):
        trace_curve(circle, [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="no finite number"):
        trace_curve(System(lambda x: np.array([x[0] * np.nan, 0.0])), [1.0, 0.0])
