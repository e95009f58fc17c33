"""Designs followed together measure as each by itself: of the catalogue, coupled, programmed, spinning."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.sweep.methods import by_one_formula, come_back, measured_designs
from mechsim.studies.sweep.sweeping import swept_task
from mechsim.studies.sweep.task import OUTCOMES, SweepTask

# what could not be swept but one by one: numeric roots, gears, special dimensions, programs, a gear train
SWEPT = {
    "looper": ({"crank": [0.0055, 0.0062], "arm_angle": [5.6, 5.65]}, ["max:C.ax", "stroke:E"]),
    "warp_knitter": ({"crank1": [0.0088, 0.0091]}, ["range:rocker", "max:K.vx", "max:crank2"]),
    "bennett": ({"length0": [0.05, 0.06]}, ["range:rocker", "max:B.az"]),
    "five_bar": ({"half": [0.029, 0.031]}, ["max:P.x", "max:P.ay"]),
    "planetary_gear": ({"module": [0.002, 0.0021]}, ["max:carrier.v"]),
}


def both(monkeypatch, task):
    """Return what a sweep measures of designs together, and of each by itself."""
    assert task.loops is not None
    assert not by_one_formula(task)
    count = task.designs.count
    left = []
    monkeypatch.setattr("mechsim.studies.sweep.methods.one_by_one", lambda t, r, index, f: left.extend(index))
    together = measured_designs(task, 0, count)
    monkeypatch.undo()
    assert left == []
    with monkeypatch.context() as patched:
        patched.setattr(SweepTask, "loops", None)
        alone = measured_designs(task, 0, count)
    return together, alone


def require_same(monkeypatch, task):
    together, alone = both(monkeypatch, task)
    assert (together.outcome == 0).all()
    for name, values in alone.values.items():
        # accelerations by 1e-11: they divide by the conditioning twice
        tolerance = 1e-10 if ".a" in name else 1e-12
        scale = max(np.abs(values).max(), 1e-2)
        np.testing.assert_allclose(together.values[name], values, atol=tolerance * scale, err_msg=name)


@pytest.mark.parametrize("name", SWEPT)
def test_designs_together_measure_as_each_by_itself(monkeypatch, name):
    vary, measures = SWEPT[name]
    require_same(monkeypatch, swept_task(name, vary, measures, samples=24))


def test_a_link_that_spins_is_followed_with_what_it_belongs_to(monkeypatch):
    # described without its closed form: nothing determines the coupler's spin about its own line
    spinning = ms.catalog.make("rssr").mechanism
    vary = {"P3.a.at.x": [-0.0455, -0.046]}
    require_same(monkeypatch, swept_task(spinning, vary, ["range:rocker", "max:P3.ax"], samples=24))


def test_what_does_not_turn_fully_swings():
    result = measured_designs(swept_task("looper", {"crank": [0.05, 0.006]}, "max:C.x", samples=24), 0, 2)
    assert [OUTCOMES[i] for i in result.outcome] == ["swings", "passed"]
    # a further root of one sign is numbered by all it does over the turn, which no start tells
    task = swept_task("looper", {"crank": [0.006]}, "max:C.x", set={"side": "2"})
    assert task.subject.closed.start_frames(1) is None


def test_what_stands_elsewhere_after_a_turn_did_not_turn_fully():
    turn = ms.catalog.make("four_bar").solve(np.array([0.0, 1.0, 2.0 * np.pi, 0.0, 1.0, 6.2]))
    assert come_back(turn, 2).tolist() == [True, False]
