"""The verdict on every mechanism rejects a wrong mechanism and states the reason."""

import numpy as np
import pytest
from catalog_faults import FAULTS, SWINGING
from grids import grid

import mechsim as ms
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of

SPEED = 20.0 * np.pi

# each fault by one method, each mechanism by both
CASES = [
    (name, fault, ("pose", "step")[i % 2])
    for name in ms.catalog.MECHANISMS
    for i, fault in enumerate(FAULTS[name])
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "fault", "method"), CASES)
def test_a_wrong_mechanism_fails(name, fault, method):
    linkage = ms.catalog.make(name)
    wrong = linkage.with_parameters(**FAULTS[linkage.name][fault])
    # a crank with a dead centre, as on the looper's other side, makes half a revolution
    turns = 1.0 if wrong.crank_range().full else 0.5
    run = simulate(wrong.mechanism, speed=SPEED, turns=turns, method=method, samples=36)
    verdict = ms.crosscheck(run.motion, linkage)
    assert not verdict.passed, str(verdict)
    assert verdict.reason
    if "assembly" in fault:
        assert verdict.outcome == "changed assembly"


@pytest.mark.long
@pytest.mark.parametrize("name", grid(ms.catalog.MECHANISMS))
@pytest.mark.parametrize("method", ["pose", "step"])
def test_the_correct_mechanism_passes(name, method):
    linkage = ms.catalog.make(name)
    run = simulate(linkage.mechanism, speed=SPEED, method=method, samples=36)
    verdict = ms.crosscheck(run.motion, linkage, speed=SPEED)
    assert verdict.passed, str(verdict)


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
def test_swinging_cranks_are_validated_within_their_range(name):
    swinging = ms.catalog.make(name, **SWINGING[name])
    arcs = swinging.crank_range()
    assert not arcs.full
    assert arcs.arcs
    case = case_of(swinging)
    assert case.passed, case.verdict.reason


@pytest.mark.long
def test_variants_of_a_mechanism_are_validated():
    case = case_of(ms.catalog.make("rssr"))
    assert any(check.title == "guided, step: orientation of coupler" for check in case.verdict.checks)
    assert case.passed
