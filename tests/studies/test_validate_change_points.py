"""Mechanisms with change points on their path are validated by every method."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.motion_laws import constant
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of

FLAT = {
    "parallelogram": ("four_bar", {"ground": 0.1, "crank": 0.045, "coupler": 0.1, "rocker": 0.045}),
    "one change point": ("four_bar", {"ground": 0.1, "crank": 0.04, "coupler": 0.12, "rocker": 0.06}),
    "offset slide": ("slider_crank", {"crank": 0.05, "rod": 0.06, "offset": 0.01}),
}


@pytest.mark.long
@pytest.mark.parametrize("which", FLAT)
def test_a_mechanism_with_change_points_passes_validation(which):
    name, lengths = FLAT[which]
    linkage = ms.catalog.make(name, **lengths)
    case = case_of(linkage)
    assert case.verdict.outcome == "passed", case.verdict.reason
    assert np.ptp(case.exact.angle) == pytest.approx(linkage.period)
    # forces do not determine the branch at a change point, so the stepped run swings between two of them
    nearest = np.abs(
        np.exp(1j * case.run.motion.angle[:, None]) - np.exp(1j * np.array(linkage.change_points()))
    )
    assert nearest.min() > 0.04


def test_another_branch_of_a_parallelogram_fails_the_check():
    name, lengths = FLAT["parallelogram"]
    other_branch = ms.catalog.make(name, **lengths, change_point="branch")
    run = simulate(ms.catalog.make(name, **lengths), speed=20.0, method="pose")
    assert ms.crosscheck(run, other_branch).outcome == "changed assembly"


@pytest.mark.slow
def test_the_branch_policy_passes_validation():
    name, lengths = FLAT["one change point"]
    other_branch = ms.catalog.make(name, **lengths, change_point="branch")
    case = case_of(other_branch)
    assert case.verdict.outcome == "passed", case.verdict.reason
    # over the one revolution between two passes of the change point the smooth motion is the same
    run = simulate(other_branch, profile=constant(20.0, 2.0), method="pose")
    assert ms.crosscheck(run, ms.catalog.make(name, **lengths)).outcome == "changed assembly"
