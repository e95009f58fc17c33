"""Change points: the closed forms go through them smoothly, or fold, and say where they are."""

from dataclasses import replace
from functools import partial

import mpmath
import numpy as np
import pytest
from flat_linkages import FLAT_ONES, FOLDING, flat_linkages, named, smooth_b, worst

from mechsim import catalog, loops
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.vector_method.trig_polynomial import ZERO_POLYNOMIAL, sampled_polynomial, signed_root
from mechsim.errors import AssemblyError
from mechsim.report.facts import facts

TURN = 2.0 * np.pi
ANGLES = np.unique(
    np.concatenate([np.linspace(-2 * TURN, 2 * TURN, 49), [1e-6, -3e-5, np.pi + 1e-9, 1e-3, 1e-12]])
)


MEETINGS = {
    "parallelogram": (2, 1),
    "kite": (2, 1),
    "kite round its frame": (1, 2),
    "rhombus": (2, 1),
    "rod as long as the crank": (2, 1),
    "offset slide": (1, 2),
    "rssr laid flat": (2, 1),
    "rrsrr just touching": (1, 2),
}


@pytest.mark.parametrize(
    "lengths", flat_linkages(), ids=lambda item: "-".join(f"{1e3 * x:.0f}" for x in item)
)
def test_the_closed_form_is_smooth_through_change_points(lengths):
    drive = catalog.make("four_bar", **named(lengths))
    # where crank and frame lie on each other the coupler could turn about them
    angles = ANGLES[np.abs(lengths[1] * np.exp(1j * ANGLES) - lengths[0]) > 1e-3 * lengths[0]]
    point = drive.solve(angles, 2.0).points["B"]
    with mpmath.workdps(40):
        truths = {sign: [smooth_b(lengths, mpmath.mpf(at), sign) for at in angles] for sign in (1, -1)}
        sign = min(truths, key=lambda item: worst(truths[item], point.position))
        slopes = [2 * mpmath.diff(lambda at: smooth_b(lengths, at, sign), mpmath.mpf(at)) for at in angles]
    # measured 4e-15 and 1.4e-14: dimensions known to rounding leave the gap of a flat pose open by that
    assert worst(truths[sign], point.position) <= 2e-14 * drive.mechanism.characteristic_length
    assert worst(slopes, point.velocity) <= 1e-13 * drive.mechanism.characteristic_length


@pytest.mark.parametrize("which", FLAT_ONES)
def test_change_points_and_period_are_reported(which):
    drive = FLAT_ONES[which]
    count, turns = MEETINGS[which]
    assert len(drive.change_points()) == count
    assert drive.crank_range().full
    assert drive.dead_centres() == ()
    reported = facts(drive)
    assert reported["change_points"] == list(drive.change_points())
    assert reported["turns_to_come_round"] == turns == round(drive.period / TURN)
    assert len(facts(drive, drive.change_points()[0])["assemblies"]) == 2
    begin = drive.mechanism.start
    for point in drive.positions([begin, begin + drive.period, begin - drive.period]).values():
        assert np.ptp(point, axis=0).max() <= 1e-12 * drive.mechanism.characteristic_length


@pytest.mark.parametrize("which", FLAT_ONES)
def test_loop_equations_and_closed_form_agree_through_change_points(which):
    drive = FLAT_ONES[which]
    angles = np.unique([*np.linspace(-TURN, TURN, 33), *drive.change_points()])
    exact, result = (solve(angles, 3.0, -2.0) for solve in (drive.solve, partial(loops.solve, drive)))
    # measured 5e-15, 3e-12 and 5e-10
    for part, most in (("position", 1e-13), ("velocity", 2e-11), ("acceleration", 2e-9)):
        for name, point in exact.points.items():
            np.testing.assert_allclose(
                getattr(result.points[name], part), getattr(point, part), rtol=0, atol=most, err_msg=part
            )


@pytest.mark.parametrize("which", FLAT_ONES)
def test_motions_are_continuous_at_change_points(which):
    drive = FLAT_ONES[which]
    for at in drive.change_points():
        near = at + np.array([-1e-3, -1e-6, -1e-9, -1e-13, 0.0, 1e-13, 1e-9, 1e-6, 1e-3])
        motion = drive.solve(near)
        for point in motion.points.values():
            gone = np.diff(point.position, axis=0)
            assert np.abs(gone - point.velocity[:-1] * np.diff(near)[:, None]).max() <= 1e-5
        for name, link in motion.links.items():
            assert np.ptp(link.rotation[3:6], axis=0).max() <= 1e-9, name


@pytest.mark.parametrize("which", FOLDING)
def test_the_branch_policy_keeps_the_assembly_sign(which):
    drive = FLAT_ONES[which].with_change_point("branch")
    angles = np.linspace(-TURN, TURN, 41)
    assert (drive.assembly_sign(drive.positions(angles)) >= -1e-15).all()
    smooth = FLAT_ONES[which].assembly_sign(FLAT_ONES[which].positions(angles))
    assert smooth.min() < 0.0 < smooth.max()
    reported = FLAT_ONES[which].positions(angles, change_point="branch")
    for name, places in drive.positions(angles).items():
        assert (reported[name] == places).all()


@pytest.mark.parametrize("which", FOLDING)
def test_loop_equations_and_closed_form_agree_with_the_branch_policy(which):
    drive = FLAT_ONES[which]
    beside = [at + off for at in drive.change_points() for off in (-1e-3, -1e-7, 0.0, 1e-7, 1e-3)]
    angles = np.unique([*np.linspace(-TURN, TURN, 33), *beside])
    exact = drive.solve(angles, -2.0, change_point="branch")
    result = loops.solve(drive.mechanism, angles, -2.0, change_point="branch")
    smooth = loops.solve(drive.mechanism, angles, -2.0)
    # measured 3e-14 of the size, 2e-12 and 1e-8
    for name, point in exact.points.items():
        there = result.points[name]
        assert np.abs(there.position - point.position).max() <= 1e-12 * drive.mechanism.characteristic_length
        assert np.abs(there.velocity - point.velocity).max() <= 1e-10
        assert np.abs(there.acceleration - point.acceleration).max() <= 1e-6
    leaps = max(
        np.abs(smooth.points[name].position - there.position).max() for name, there in result.points.items()
    )
    assert leaps > 0.1 * drive.mechanism.characteristic_length


@pytest.mark.parametrize("which", ["kite round its frame", "rhombus"])
def test_a_branch_that_ends_is_rejected_by_both_methods(which):
    drive = FLAT_ONES[which]
    with pytest.raises(AssemblyError, match="no assembly mode leads into another; use change_point=smooth"):
        drive.positions([0.5], change_point="branch")
    with pytest.raises(AssemblyError, match="with policy 'branch', since it does not move"):
        loops.solve(drive.mechanism, [-0.5, 0.5], change_point="branch")


def test_the_branch_policy_applies_to_user_defined_mechanisms():
    drive = FLAT_ONES["parallelogram"]
    form = LoopForm(drive.mechanism).with_change_point("branch")
    angles = np.linspace(-TURN, TURN, 17)
    exact = drive.positions(angles, change_point="branch")
    for name, places in form.positions(angles).items():
        np.testing.assert_allclose(places, exact[name], atol=1e-12)
    assert form.period == TURN
    assert np.sort(np.abs(form.change_points())) == pytest.approx([0.0, np.pi], abs=1e-9)


def test_catalogue_defaults_have_no_change_points():
    for name in catalog.DRIVES:
        drive = catalog.make(name)
        assert drive.change_points() == ()
        assert drive.with_change_point("branch").positions([0.3]).keys() == drive.positions([0.3]).keys()


@pytest.mark.parametrize("lack", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_double_root_is_distinguished_from_a_near_miss(lack):
    near = sampled_polynomial(lambda f: 1.0 - np.cos(f) + lack, 1)
    assert near.touching() == ()
    assert signed_root(near).over(np.zeros(1))[0] == pytest.approx(np.sqrt(lack), rel=1e-3)
    assert sampled_polynomial(lambda f: 1.0 - np.cos(f) - lack, 1).touching() == ()
    assert sampled_polynomial(lambda f: 1.0 - np.cos(f) + ZERO_POLYNOMIAL / 4, 1).touching() == pytest.approx(
        (0.0,), abs=1e-12
    )


LOOPER = catalog.make("looper")
FLAT_LOOPERS = {
    "one flat pose": (replace(LOOPER, rocker=LOOPER.crank + LOOPER.frame - LOOPER.coupler), 1),
    "parallelogram": (replace(LOOPER, coupler=LOOPER.frame, rocker=LOOPER.crank), 2),
}


@pytest.mark.parametrize("which", FLAT_LOOPERS)
def test_the_crank_range_of_a_looper_ends_at_change_points(which):
    drive, count = FLAT_LOOPERS[which]
    flat = drive.change_points()
    assert len(flat) == count
    assert np.sin(np.array(flat) - drive.frame_angle) == pytest.approx(0.0, abs=1e-9)
    arcs = drive.crank_range()
    assert not arcs.full
    assert not any(low < at + lap < high for low, high in arcs.arcs for at in flat for lap in (0.0, TURN))
    low, high = arcs.arcs[0]
    angles = np.linspace(low + 0.1, high - 0.1, 25)
    result = loops.solve(drive.mechanism, angles)
    for name, point in drive.solve(angles).points.items():
        assert (
            np.abs(result.points[name].position - point.position).max()
            <= 1e-12 * drive.mechanism.characteristic_length
        )
