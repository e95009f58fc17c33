"""Searching dimensions: the examples, and that what was found is a valley that keeps its limits."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import InputError
from mechsim.numerics.jets import change_of, stepped
from mechsim.studies.optimise import Goal, Limit, MeasureLimit, largest, smallest
from mechsim.studies.optimise.goals import goal_of, limit_of

EXAMPLES = Path(__file__).parents[2] / "examples" / "design"
TURN = np.linspace(0.0, 2.0 * np.pi, 13)


def searched(name):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["search"]()


def test_a_straighter_line_is_no_shorter_and_its_crank_turns_fully():
    found = searched("straighter_line")
    assert found.outcome == "found"
    assert found.after < 0.6 * found.before
    assert found.moved.solver.crank_range().full
    columns = found.moved.values(["C.x", "C.y"], {})
    height = columns["C.y"][9:28]
    assert np.std(height) == pytest.approx(found.after, rel=1e-9)
    assert np.ptp(columns["C.x"][9:28]) >= found.limits["length of the line"] * (1.0 - 1e-9)


@pytest.mark.slow
def test_less_torque_ripple_keeps_swing_transmission_and_size():
    found = searched("torque_ripple")
    assert found.outcome == "found"
    assert found.after < 0.8 * found.before
    columns = found.moved.values(["rocker.q", "B.q", "torque"], {})
    # the last pose of the turn is the first again
    assert np.std(columns["torque"][:-1]) == pytest.approx(found.after, rel=1e-9)
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


@pytest.mark.slow
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


def test_a_limit_that_cannot_be_kept_is_stated_to_be_missed():
    start = ms.moved("four_bar", angles=TURN)
    found = ms.optimise(
        start, {"rocker": (0.07, 0.08)}, "rms:rocker.v", [MeasureLimit("range:rocker", low=6.0)]
    )
    assert found.outcome == "limits missed"


def test_a_search_goes_back_from_where_no_crank_turns():
    start = ms.moved("four_bar", angles=TURN)
    # the most swing is where the crank hardly turns: beyond, the loops are open
    grown = Goal(("rocker.q",), lambda given: 3.0 - largest(given["rocker.q"]) + smallest(given["rocker.q"]))
    found = ms.optimise(start, {"crank": (0.02, 0.2)}, grown, most=3)
    assert found.outcome == "not converged"
    assert 0.032 <= found.values["crank"] < 0.0571
    assert found.moved.values(["rocker.q"], {})["rocker.q"].shape == TURN.shape


@pytest.mark.parametrize(
    ("vary", "goal", "output"),
    [
        ({"crnk": (0.1, 0.2)}, "rms:torque", "did you mean 'crank'"),
        ({"crank": (0.2, 0.1)}, "rms:torque", "give its lowest and highest value"),
        ({"crank": (0.1, 0.2)}, "rms:torque", "crank is 0.032 initially, outside 0.1 to 0.2"),
        ({"crank": (0.01, 0.04)}, "worst:torque", "there is no measure 'worst:torque'"),
        ({"crank": (0.01, 0.04)}, "rms:rockr", "has no quantity 'rockr'; did you mean 'rocker'"),
        ({"crank": (0.01, 0.04)}, "crank_range", "crank_range has no derivative by dimensions"),
        ({"crank": (0.01, 0.04)}, "min:transmission", "min:transmission has no derivative by dimensions"),
        (
            {"crank": (0.01, 0.04)},
            "at:10deg:rocker",
            "at crank angle 0.174533 rad, where the motion is not solved",
        ),
        ({}, "rms:torque", "no dimension may vary"),
    ],
)
def test_what_cannot_be_searched_is_rejected_in_one_line(vary, goal, output):
    with pytest.raises(InputError, match=output):
        ms.optimise(ms.moved("four_bar", angles=TURN), vary, goal)


def test_a_function_that_loses_its_derivative_is_rejected():
    lost = Goal(("rocker.v",), lambda given: np.abs(given["rocker.v"]))
    with pytest.raises(InputError, match="loses the derivative"):
        ms.optimise(ms.moved("four_bar", angles=TURN), {"crank": (0.01, 0.04)}, lost)


def test_a_limit_needs_a_bound():
    with pytest.raises(InputError, match="has no bound"):
        Limit((), lambda given: given["crank"])
    with pytest.raises(InputError, match="range:rocker has no bound"):
        ms.optimise("four_bar", {"crank": (0.01, 0.04)}, "rms:torque", [MeasureLimit("range:rocker")])


WORDS = [
    "range:rocker",
    "stroke:C",
    "max:C.vx",
    "min:rocker.a",
    "rms:speed:C",
    "mean:force:B",
    "ripple:torque",
    "at:60deg:C.y",
]


@pytest.mark.parametrize("word", WORDS)
def test_a_measure_is_the_one_of_a_sweep_and_its_jacobian_that_of_two_sweeps(word):
    start, step = ms.moved("four_bar", angles=TURN, speed=10.0), 2.0**-14
    goal, name = goal_of(word, start), "coupler"
    found = start.derivatives(start.quantities(goal.quantities), [name])
    alike = {item: stepped(values, found.by[name][item]) for item, values in found.values.items()}
    value = limit_of(MeasureLimit(word, low=0.0), start).function(alike)
    beside = 0.091 + step * np.array([-1.0, 0.0, 1.0])
    swept = ms.sweep("four_bar", {name: beside}, measure=[word], samples=12, speed=10.0)[word].values
    assert np.real(value) == pytest.approx(swept[1], rel=1e-9)
    # of second order, of steps a thousandth of the coupler
    assert change_of(value) == pytest.approx((swept[2] - swept[0]) / (2.0 * step), rel=1e-4)
    least = np.sqrt(np.square(goal.function(found.values)).mean())
    assert least == pytest.approx(abs(swept[1]), rel=1e-9)
