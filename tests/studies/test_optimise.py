"""Searching dimensions: the examples, and that what was found is a valley that keeps its limits."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import InputError
from mechsim.studies.optimise import Goal, Limit, goal_of, limit_of

EXAMPLES = Path(__file__).parents[2] / "examples" / "design"
TURN = np.linspace(0.0, 2.0 * np.pi, 13)


def searched(name):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["search"]()


def test_a_straighter_line_is_no_shorter_and_its_crank_turns_fully():
    found = searched("straighter_line")
    assert found.outcome == "found"
    assert found.after < 0.6 * found.before
    assert found.moved.form.crank_range().full
    columns = found.moved.values(["C.x", "C.y"], {})
    height = columns["C.y"][9:28]
    assert np.std(height) == pytest.approx(found.after, rel=1e-9)
    assert np.ptp(columns["C.x"][9:28]) >= found.limits["length of the line"] * (1.0 - 1e-9)


def test_less_torque_ripple_keeps_swing_transmission_and_size():
    found = searched("torque_ripple")
    assert found.outcome == "found"
    assert found.after < 0.8 * found.before
    columns = found.moved.values(["rocker.q", "B.q", "torque"], {})
    assert np.std(columns["torque"]) == pytest.approx(found.after, rel=1e-9)
    assert np.abs(np.cos(columns["B.q"])).max() <= np.cos(np.deg2rad(40.0)) * (1.0 + 1e-6)
    assert sum(found.values.values()) <= 0.3


def test_counterweights_are_those_of_berkof_and_lowen():
    found = searched("counterweights")
    assert found.after <= 1e-12 * found.before
    # the coupler's 0.25 kg at (0.45, 0.1) of AB, taken to A and B; links of 0.1 and 0.2 kg at their middles
    crank, rocker = 32e-3, 74e-3
    exact = {
        "crank_x": -(0.25 * 0.55 * crank + 0.1 * crank / 2.0) / 0.5,
        "crank_y": 0.25 * 0.1 * crank / 0.5,
        "rocker_x": -(0.25 * 0.45 * rocker + 0.2 * rocker / 2.0) / 0.5,
        "rocker_y": -0.25 * 0.1 * rocker / 0.5,
    }
    for name, value in exact.items():
        assert found.values[name] == pytest.approx(value, rel=1e-9)


def test_a_generated_function_is_the_nearest_of_its_neighbours():
    found = searched("function_generation")
    assert found.after < 0.05 * found.before
    names = runpy.run_path(str(EXAMPLES / "function_generation.py"))
    free = [name for name in found.values if name not in found.at_bounds]
    assert free

    def missed(values):
        return np.sqrt(np.square(names["off"](found.moved.values(["rocker.q"], values))).mean())

    assert missed({}) == pytest.approx(found.after, rel=1e-9)
    for part in (0.999, 1.001):
        assert missed({free[0]: part * found.values[free[0]]}) > found.after


def test_a_limit_that_cannot_be_kept_is_said_to_be_missed():
    start = ms.moved("four_bar", angles=TURN)
    found = ms.optimise(
        start, {"rocker": (0.07, 0.08)}, "rms:rocker.v", [limit_of("range:rocker.q", low=6.0)]
    )
    assert found.outcome == "limits missed"


def test_a_search_goes_back_from_where_no_crank_turns():
    start = ms.moved("four_bar", angles=TURN)
    # the most swing is where the crank hardly turns: beyond, the loops are open
    swing = goal_of("range:rocker.q").function
    grown = Goal(("rocker.q",), lambda given: 3.0 - swing(given))
    found = ms.optimise(start, {"crank": (0.02, 0.2)}, grown, most=3)
    assert found.outcome == "not converged"
    assert 0.032 <= found.values["crank"] < 0.0571
    assert found.moved.values(["rocker.q"], {})["rocker.q"].shape == TURN.shape


@pytest.mark.parametrize(
    ("vary", "goal", "said"),
    [
        ({"crnk": (0.1, 0.2)}, "rms:torque", "did you mean 'crank'"),
        ({"crank": (0.2, 0.1)}, "rms:torque", "give its lowest and highest value"),
        ({"crank": (0.1, 0.2)}, "rms:torque", "crank is 0.032 as it stands, outside 0.1 to 0.2"),
        ({"crank": (0.01, 0.04)}, "worst:torque", "there is no goal 'worst:torque'; write one of max, min"),
        ({"crank": (0.01, 0.04)}, "rms:rockr.q", "has no quantity"),
        ({}, "rms:torque", "no dimension may vary"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_one_line(vary, goal, said):
    with pytest.raises(InputError, match=said):
        ms.optimise(ms.moved("four_bar", angles=TURN), vary, goal)


def test_a_function_that_loses_its_derivative_is_refused():
    lost = Goal(("rocker.v",), lambda given: np.abs(given["rocker.v"]))
    with pytest.raises(InputError, match="gives real numbers of what carries a derivative"):
        ms.optimise(ms.moved("four_bar", angles=TURN), {"crank": (0.01, 0.04)}, lost)


def test_a_limit_needs_a_bound_and_a_goal_a_word():
    with pytest.raises(InputError, match="has no bound"):
        Limit((), lambda given: given["crank"])
    assert goal_of("peak:torque").function({"torque": np.array([1.0, -3.0])}) == 3.0
