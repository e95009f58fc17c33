"""Optimisation of dimensions: the examples, and that the result is a minimum within its limits."""

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
ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)


def search_result(name):
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["search"]()


@pytest.mark.slow
def test_a_straighter_line_keeps_its_length_and_full_turn():
    result = search_result("straighter_line")
    assert result.outcome == "found"
    assert result.after < 0.6 * result.before
    assert result.moved.solver.crank_range().full
    columns = result.moved.values(["C.x", "C.y"], {})
    height = columns["C.y"][9:28]
    assert np.std(height) == pytest.approx(result.after, rel=1e-9)
    assert np.ptp(columns["C.x"][9:28]) >= result.limits["length of the line"] * (1.0 - 1e-9)


@pytest.mark.slow
def test_less_torque_ripple_keeps_swing_transmission_and_size():
    result = search_result("torque_ripple")
    assert result.outcome == "found"
    assert result.after < 0.8 * result.before
    columns = result.moved.values(["rocker.q", "B.q", "torque"], {})
    # the last pose of the turn equals the first
    assert np.std(columns["torque"][:-1]) == pytest.approx(result.after, rel=1e-9)
    assert np.abs(np.cos(columns["B.q"])).max() <= np.cos(np.deg2rad(40.0)) * (1.0 + 1e-6)
    assert sum(result.values.values()) <= 0.3


@pytest.mark.long
def test_counterweights_equal_those_of_berkof_and_lowen():
    result = search_result("counterweights")
    assert result.after <= 1e-12 * result.before
    # the coupler's 0.25 kg at (0.45, 0.1) of AB, taken to A and B; links of 0.1 and 0.2 kg at their middles
    crank, rocker = 32e-3, 74e-3
    exact = {
        "crank_x": -(0.25 * 0.55 * crank + 0.1 * crank / 2.0) / 0.5,
        "crank_y": 0.25 * 0.1 * crank / 0.5,
        "rocker_x": -(0.25 * 0.45 * rocker + 0.2 * rocker / 2.0) / 0.5,
        "rocker_y": -0.25 * 0.1 * rocker / 0.5,
    }
    for name, value in exact.items():
        assert result.values[name] == pytest.approx(value, rel=1e-9)


@pytest.mark.slow
def test_a_generated_function_is_a_local_minimum():
    result = search_result("function_generation")
    assert result.after < 0.05 * result.before
    names = runpy.run_path(str(EXAMPLES / "function_generation.py"))
    free = [name for name in result.values if name not in result.at_bounds]
    assert free

    def deviation(values):
        return np.sqrt(np.square(names["off"](result.moved.values(["rocker.q"], values))).mean())

    assert deviation({}) == pytest.approx(result.after, rel=1e-9)
    for factor in (0.999, 1.001):
        assert deviation({free[0]: factor * result.values[free[0]]}) > result.after


@pytest.mark.slow
def test_an_infeasible_limit_is_reported():
    start = ms.moved("four_bar", angles=ANGLES)
    result = ms.optimise(
        start, {"rocker": (0.07, 0.08)}, "rms:rocker.v", [MeasureLimit("range:rocker", low=6.0)]
    )
    assert result.outcome == "limits missed"


@pytest.mark.long
def test_a_search_returns_from_infeasible_designs():
    start = ms.moved("four_bar", angles=ANGLES)
    # the largest swing is at the border of a full turn; beyond it the loops do not close
    grown = Goal(
        ("rocker.q",),
        lambda quantities: 3.0 - largest(quantities["rocker.q"]) + smallest(quantities["rocker.q"]),
    )
    result = ms.optimise(start, {"crank": (0.02, 0.2)}, grown, most=3)
    assert result.outcome == "not converged"
    assert 0.032 <= result.values["crank"] < 0.0571
    assert result.moved.values(["rocker.q"], {})["rocker.q"].shape == ANGLES.shape


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
def test_an_invalid_search_is_rejected(vary, goal, output):
    with pytest.raises(InputError, match=output):
        ms.optimise(ms.moved("four_bar", angles=ANGLES), vary, goal)


def test_a_goal_without_derivative_is_rejected():
    not_differentiable = Goal(("rocker.v",), lambda quantities: np.abs(quantities["rocker.v"]))
    with pytest.raises(InputError, match="loses the derivative"):
        ms.optimise(ms.moved("four_bar", angles=ANGLES), {"crank": (0.01, 0.04)}, not_differentiable)


def test_a_limit_without_a_bound_is_rejected():
    with pytest.raises(InputError, match="has no bound"):
        Limit((), lambda quantities: quantities["crank"])
    with pytest.raises(InputError, match="range:rocker has no bound"):
        ms.optimise("four_bar", {"crank": (0.01, 0.04)}, "rms:torque", [MeasureLimit("range:rocker")])


MEASURES = [
    "range:rocker",
    "stroke:C",
    "max:C.vx",
    "min:rocker.a",
    "rms:speed:C",
    "mean:force:B",
    "ripple:torque",
    "at:60deg:C.y",
]


@pytest.mark.long
@pytest.mark.parametrize("text", MEASURES)
def test_measures_and_derivatives_equal_those_of_sweeps(text):
    start, step = ms.moved("four_bar", angles=ANGLES, speed=10.0), 2.0**-14
    goal, name = goal_of(text, start), "coupler"
    result = start.derivatives(start.quantities(goal.quantities), [name])
    with_derivatives = {
        item: stepped(values, result.by[name][item]) for item, values in result.values.items()
    }
    value = limit_of(MeasureLimit(text, low=0.0), start).function(with_derivatives)
    lengths = 0.091 + step * np.array([-1.0, 0.0, 1.0])
    swept = ms.sweep("four_bar", {name: lengths}, measure=[text], samples=12, speed=10.0)[text].values
    assert np.real(value) == pytest.approx(swept[1], rel=1e-9)
    # central differences with steps of a thousandth of the coupler
    assert change_of(value) == pytest.approx((swept[2] - swept[0]) / (2.0 * step), rel=1e-4)
    root_mean_square = np.sqrt(np.square(goal.function(result.values)).mean())
    assert root_mean_square == pytest.approx(abs(swept[1]), rel=1e-9)
