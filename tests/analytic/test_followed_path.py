"""Change points: where two assemblies meet, the motion by the loop equations goes on smoothly."""

import mpmath
import numpy as np
import pytest
from flat_linkages import flat_linkages, named, smooth_b, worst

from mechsim import catalog
from mechsim.analytic import closure
from mechsim.analytic.closure.whole_motion import followed
from mechsim.errors import AssemblyError

ANGLES = np.unique(
    np.concatenate([np.linspace(-4 * np.pi, 4 * np.pi, 49), [1e-6, -3e-5, np.pi + 1e-4, 1e-3]])
)


@pytest.mark.parametrize("lengths", flat_linkages(), ids=lambda one: "-".join(f"{1e3 * x:.0f}" for x in one))
def test_a_linkage_passes_its_flat_poses_smoothly_and_rates_there_are_limits(lengths):
    mechanism = catalog.make("four_bar", **named(lengths)).mechanism
    # where crank and frame lie on each other the coupler could turn about them
    angles = ANGLES[np.abs(lengths[1] * np.exp(1j * ANGLES) - lengths[0]) > 1e-3 * lengths[0]]
    point = closure.solve(mechanism, angles, 2.0, 0.0).points["B"]
    with mpmath.workdps(40):
        truths = {sign: [smooth_b(lengths, mpmath.mpf(at), sign) for at in angles] for sign in (1, -1)}
        sign = min(truths, key=lambda one: worst(truths[one], point.position))
        slopes = [2 * mpmath.diff(lambda at: smooth_b(lengths, at, sign), mpmath.mpf(at)) for at in angles]
    # measured 3e-13 and 8e-11
    assert worst(truths[sign], point.position) <= 1e-11 * mechanism.size
    assert worst(slopes, point.velocity) <= 1e-8 * mechanism.size


def test_a_parallelogram_stays_one_turn_after_turn():
    drive = catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045, branch=-1)
    mechanism = drive.mechanism
    path = followed(mechanism)
    path.extend(7.0)
    path.extend(-7.0)
    found = np.sort(path.meetings)
    np.testing.assert_allclose(found, np.pi * np.round(found / np.pi), atol=1e-9)
    assert {0, 1, 2} <= set(np.round(found / np.pi).astype(int))
    motion = closure.solve(mechanism, ANGLES)
    np.testing.assert_allclose(motion.links["coupler"].angular_velocity, 0.0, atol=1e-9)


@pytest.mark.parametrize("excess", [1e-3, 1e-6, 1e-9, 1e-12])
def test_near_a_change_point_the_assembly_is_kept_round_the_bend_as_the_closed_form_says(excess):
    drive = catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06 + excess)
    assert drive.crank_range().full
    angles = np.linspace(-np.pi, 3 * np.pi, 64)
    found, exact = closure.follow(drive.mechanism, angles), drive.solve(angles).links
    for name, link in exact.items():
        assert np.abs(found[name].position - link.position).max() <= 1e-9 * drive.mechanism.size


@pytest.mark.parametrize("lack", [1e-4, 1e-6, 1e-9])
def test_a_gap_before_the_flat_pose_is_not_leapt_over(lack):
    drive = catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06 - lack)
    ((low, high),) = drive.crank_range().arcs
    assert high - low < 2 * np.pi
    path = followed(drive.mechanism)
    with pytest.raises(AssemblyError, match="cannot pass") as refused:
        path.extend(high + 2.0 * (2 * np.pi - (high - low)))
    said = float(str(refused.value).split("cannot pass ")[1].split()[0])
    assert said == pytest.approx(high, abs=1e-6)
