"""Change points: closed forms pass them smoothly or stay on the branch, and report them."""

from functools import partial

import mpmath
import numpy as np
import pytest
from change_point_linkages import (
    CHANGE_POINT_LINKAGES,
    WITH_BRANCHES,
    change_point_lengths,
    named,
    smooth_b,
    worst,
)
from motions import largest_difference

from mechsim import catalog, loops
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinematics.vector_method.trig_polynomial import ZERO_POLYNOMIAL, sampled_polynomial, signed_root
from mechsim.report.facts import facts

REVOLUTION = 2.0 * np.pi
CLOSE = (1e-6, -3e-5, np.pi + 1e-9, 1e-3, 1e-12)
ANGLES = np.unique([*np.linspace(-2 * REVOLUTION, 2 * REVOLUTION, 49), *CLOSE])


# after one change point a revolution the linkage is in its other assembly mode
ONE_CHANGE_POINT = ("kite about its frame", "offset slide", "tangent rrsrr")


@pytest.mark.long
@pytest.mark.parametrize(
    "lengths", change_point_lengths(), ids=lambda item: "-".join(f"{1e3 * x:.0f}" for x in item)
)
def test_the_closed_form_is_smooth_through_change_points(lengths):
    linkage = catalog.make("four_bar", **named(lengths))
    # where crank and frame coincide the coupler is undetermined
    angles = ANGLES[np.abs(lengths[1] * np.exp(1j * ANGLES) - lengths[0]) > 1e-3 * lengths[0]]
    point = linkage.solve(angles, 2.0).points["B"]
    with mpmath.workdps(40):
        truths = {sign: [smooth_b(lengths, mpmath.mpf(angle), sign) for angle in angles] for sign in (1, -1)}
        sign = min(truths, key=lambda item: worst(truths[item], point.position))
        derivatives = [
            2 * mpmath.diff(lambda angle: smooth_b(lengths, angle, sign), mpmath.mpf(angle))
            for angle in angles
        ]
    # measured 4e-15 and 1.4e-14: rounded dimensions violate the condition of a change point
    assert worst(truths[sign], point.position) <= 2e-14 * linkage.mechanism.characteristic_length
    assert worst(derivatives, point.velocity) <= 1e-13 * linkage.mechanism.characteristic_length


@pytest.mark.parametrize("which", CHANGE_POINT_LINKAGES)
def test_change_points_and_period_are_reported(which):
    linkage = CHANGE_POINT_LINKAGES[which]
    count, turns = (1, 2) if which in ONE_CHANGE_POINT else (2, 1)
    assert len(linkage.change_points()) == count
    assert linkage.crank_range().full
    assert linkage.dead_centres() == ()
    reported = facts(linkage)
    assert reported["change_points"] == list(linkage.change_points())
    assert reported["turns_to_come_round"] == turns == round(linkage.period / REVOLUTION)
    assert len(facts(linkage, linkage.change_points()[0])["assemblies"]) == 2
    start = linkage.mechanism.start
    for point in linkage.positions([start, start + linkage.period, start - linkage.period]).values():
        assert np.ptp(point, axis=0).max() <= 1e-12 * linkage.mechanism.characteristic_length


@pytest.mark.long
@pytest.mark.parametrize("which", CHANGE_POINT_LINKAGES)
def test_loop_equations_and_closed_form_agree_through_change_points(which):
    linkage = CHANGE_POINT_LINKAGES[which]
    angles = np.unique([*np.linspace(-REVOLUTION, REVOLUTION, 33), *linkage.change_points()])
    exact, result = (solve(angles, 3.0, -2.0) for solve in (linkage.solve, partial(loops.solve, linkage)))
    # measured 5e-15, 3e-12 and 5e-10
    for quantity, most in (("position", 1e-13), ("velocity", 2e-11), ("acceleration", 2e-9)):
        assert largest_difference(result, exact, quantity) <= most, quantity


@pytest.mark.parametrize("which", WITH_BRANCHES)
def test_the_branch_policy_keeps_the_assembly_sign(which):
    linkage = CHANGE_POINT_LINKAGES[which].with_change_point("branch")
    angles = np.linspace(-REVOLUTION, REVOLUTION, 41)
    assert (linkage.assembly_sign(linkage.positions(angles)) >= -1e-15).all()
    smooth = CHANGE_POINT_LINKAGES[which].assembly_sign(CHANGE_POINT_LINKAGES[which].positions(angles))
    assert smooth.min() < 0.0 < smooth.max()
    reported = CHANGE_POINT_LINKAGES[which].positions(angles, change_point="branch")
    for name, positions in linkage.positions(angles).items():
        assert (reported[name] == positions).all()


@pytest.mark.long
@pytest.mark.parametrize("which", WITH_BRANCHES)
def test_loop_equations_and_closed_form_agree_with_the_branch_policy(which):
    linkage = CHANGE_POINT_LINKAGES[which]
    close = np.add.outer(linkage.change_points(), [-1e-3, -1e-7, 0.0, 1e-7, 1e-3])
    angles = np.unique([*np.linspace(-REVOLUTION, REVOLUTION, 33), *close.ravel()])
    exact = linkage.solve(angles, -2.0, change_point="branch")
    result = loops.solve(linkage.mechanism, angles, -2.0, change_point="branch")
    smooth = loops.solve(linkage.mechanism, angles, -2.0)
    # measured 3e-14 of the size, 2e-12 and 1e-8
    length = linkage.mechanism.characteristic_length
    for quantity, most in (("position", 1e-12 * length), ("velocity", 1e-10), ("acceleration", 1e-6)):
        assert largest_difference(result, exact, quantity) <= most, quantity
    assert largest_difference(smooth, result) > 0.1 * length


def test_the_branch_policy_applies_to_user_defined_mechanisms():
    linkage = CHANGE_POINT_LINKAGES["parallelogram"]
    solver = KinematicSolver(linkage.mechanism).with_change_point("branch")
    angles = np.linspace(-REVOLUTION, REVOLUTION, 17)
    exact = linkage.positions(angles, change_point="branch")
    for name, positions in solver.positions(angles).items():
        np.testing.assert_allclose(positions, exact[name], atol=1e-12)
    assert solver.period == REVOLUTION
    assert np.sort(np.abs(solver.change_points())) == pytest.approx([0.0, np.pi], abs=1e-9)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_double_root_is_distinguished_from_a_near_miss(distance):
    polynomial = sampled_polynomial(lambda f: 1.0 - np.cos(f) + distance, 1)
    assert polynomial.touching == ()
    assert signed_root(polynomial).over(np.zeros(1))[0] == pytest.approx(np.sqrt(distance), rel=1e-3)
    assert sampled_polynomial(lambda f: 1.0 - np.cos(f) - distance, 1).touching == ()
    assert sampled_polynomial(lambda f: 1.0 - np.cos(f) + ZERO_POLYNOMIAL / 4, 1).touching == pytest.approx(
        (0.0,), abs=1e-12
    )


LOOPER = catalog.make("looper")
FLAT_LOOPERS = {
    "one change point": (LOOPER.with_parameters(rocker=LOOPER.crank + LOOPER.frame - LOOPER.coupler), 1),
    "parallelogram": (LOOPER.with_parameters(coupler=LOOPER.frame, rocker=LOOPER.crank), 2),
}


@pytest.mark.long
@pytest.mark.parametrize("which", FLAT_LOOPERS)
def test_the_crank_range_of_a_looper_ends_at_change_points(which):
    linkage, count = FLAT_LOOPERS[which]
    flat = linkage.change_points()
    assert len(flat) == count
    assert np.sin(np.array(flat) - linkage.frame_angle) == pytest.approx(0.0, abs=1e-9)
    arcs = linkage.crank_range()
    assert not arcs.full
    for low, high in arcs.arcs:
        inside = np.add.outer(flat, [0.0, REVOLUTION])
        assert not ((low < inside) & (inside < high)).any()
    low, high = arcs.arcs[0]
    angles = np.linspace(low + 0.1, high - 0.1, 25)
    off = largest_difference(loops.solve(linkage.mechanism, angles), linkage.solve(angles))
    assert off <= 1e-12 * linkage.mechanism.characteristic_length
