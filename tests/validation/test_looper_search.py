"""The search for straighter loopers: results satisfy the conditions of the paper and improve its linkage."""

from dataclasses import replace

import looper_synthesis
import numpy as np
import pytest
from looper_search import straighter_looper, violated_conditions
from looper_trials import Conditions

from mechsim.analytic.catalog.looper import Looper
from mechsim.errors import InputError


@pytest.mark.slow
def test_a_straighter_looper_with_the_published_coupler_is_valid():
    result = straighter_looper(4e-3, Looper())
    assert violated_conditions(result, Conditions()) == []
    design = result.design
    assert (design.crank, design.coupler, design.arm, design.arm_angle) == (
        0.006,
        0.025,
        0.033,
        Looper().arm_angle,
    )
    # the deviation of the straightest 4 mm of the published linkage is 3.05 um
    assert result.deviation < 1.93e-6
    alternating_errors = result.error[list(result.alternation)]
    assert np.abs(alternating_errors) == pytest.approx(result.deviation, rel=1e-3)


def test_violated_conditions_are_listed():
    paper = looper_synthesis.paper_linkage()
    assert "the centring of the follower's axis" in str(violated_conditions(paper, Conditions(centred=1e-6)))
    output = str(
        violated_conditions(
            paper,
            Conditions(stroke=(0.01, 0.012), width=0.004, clearance=0.003, transmission=1.1, longest=0.03),
        )
    )
    for word in ("stroke", "width", "clearance", "transmission", "longest"):
        assert word in output
    immobile = replace(paper, design=replace(paper.design, coupler=0.005))
    assert violated_conditions(immobile, Conditions()) == ["full turning of the crank"]


@pytest.mark.slow
def test_a_search_without_a_solution_is_rejected():
    with pytest.raises(InputError, match="relax"):
        straighter_looper(4e-3, Looper(), Conditions(stroke=(0.05, 0.06)))


@pytest.mark.slow
def test_the_study_finds_straighter_loopers_for_both_strokes():
    improvements = looper_synthesis.study()
    assert [(item.length, item.free_coupler) for item in improvements] == [
        (4e-3, False),
        (4e-3, True),
        (11e-3, False),
        (11e-3, True),
    ]
    for item in improvements:
        assert item.result.deviation < item.paper
        assert violated_conditions(item.result, Conditions()) == []
    assert [round(1e6 * item.paper, 1) for item in improvements] == [3.1, 3.1, 63.0, 63.0]
    # a free coupler reduces 2 um to nanometres, and 63 um below 10 um
    assert improvements[1].result.deviation < 1e-8
    assert improvements[3].result.deviation < 1e-5
    assert improvements[2].result.deviation < 46e-6
