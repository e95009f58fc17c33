"""The table of engines: exact poses have no error, wrong ones have theirs, and a page states both."""

import csv
from dataclasses import replace

import by_mujoco
import engine_table
import numpy as np
import pytest
import reference_problem

import mechsim as ms


@pytest.fixture(scope="module")
def four_bar():
    return reference_problem.problem("four_bar")


@pytest.fixture(scope="module")
def exact(four_bar):
    reference = reference_problem.REFERENCE
    with (reference / "data" / "four_bar.csv").open() as file:
        angles = [float(row["angle"]) for row in csv.DictReader(file)][1:]
    qpos = ms.closed_qpos(reference / "mechanisms" / "four_bar.toml", {"crank": angles})
    return four_bar.poses(qpos, four_bar.exact[1], 0.0)


def test_exact_poses_have_no_error(four_bar, exact):
    # rounding of a few additions of lengths
    assert max(four_bar.errors(exact)) < 1e-14


@pytest.mark.parametrize("moved", [1e-9, 1e-3])
def test_a_moved_body_is_an_error_of_its_points_and_loops(four_bar, exact, moved):
    rocker = four_bar.model.body("rocker").id
    shifted = exact.position.copy()
    shifted[40, rocker, 1] += moved * four_bar.characteristic_length
    position, gap, torque = four_bar.errors(replace(exact, position=shifted))
    assert position == pytest.approx(moved, rel=1e-5)
    assert gap == pytest.approx(moved, rel=1e-5)
    assert torque == 0.0


def test_a_torque_of_the_wrong_sign_is_wrong_by_twice_its_value(four_bar, exact):
    assert four_bar.errors(replace(exact, torque=-exact.torque))[2] == pytest.approx(2.0)


def test_poses_that_are_no_numbers_have_an_infinite_error(four_bar, exact):
    position = np.where(np.arange(len(exact.position))[:, None, None] == 3, np.nan, exact.position)
    assert four_bar.errors(replace(exact, position=position)) == (np.inf, np.inf, np.inf)


def test_the_search_takes_the_setting_of_least_error_and_the_page_states_failures(four_bar):
    settings = [item for item in by_mujoco.SETTINGS if item.step != -25.0]
    rows = [engine_table.run(by_mujoco, four_bar, setting) for setting in settings]
    assert rows[0].default
    # MuJoCo's own time constant is 20 ms, of a turn of 0.3 s
    assert 1e-3 < rows[0].position < 1e-1
    least = engine_table.best(rows)
    assert least.setting == "RK4, loops: mechsim"
    assert least.position < 1e-5
    failed = replace(rows[0], engine="Another", position=None, failure="couplings between joints")
    page = engine_table.written([*rows, failed])
    assert "| four_bar | " in page
    assert "- Another, couplings between joints: four_bar." in page
