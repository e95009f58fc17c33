"""Batched designs have the measures of single designs: catalogue, couplings, motion laws, idle spins."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.sweep.methods import by_one_formula, come_back, measured_designs
from mechsim.studies.sweep.sweeping import swept_task
from mechsim.studies.sweep.task import OUTCOMES, SweepTask

# numeric roots, gears, special dimensions, motion laws and a gear train
SWEPT = {
    "looper": ({"crank": [0.0055, 0.0062], "arm_angle": [5.6, 5.65]}, ["max:C.ax", "stroke:E"]),
    "warp_knitter": ({"crank1": [0.0088, 0.0091]}, ["range:rocker", "max:K.vx", "max:crank2"]),
    "bennett": ({"length0": [0.05, 0.06]}, ["range:rocker", "max:B.az"]),
    "five_bar": ({"half": [0.029, 0.031]}, ["max:P.x", "max:P.ay"]),
    "planetary_gear": ({"module": [0.002, 0.0021]}, ["max:carrier.v"]),
}


def batched_and_single(monkeypatch, task):
    """Return the measures of batched designs and of single designs."""
    assert task.loops is not None
    assert not by_one_formula(task)
    count = task.designs.count
    unbatched = []
    monkeypatch.setattr(
        "mechsim.studies.sweep.methods.one_by_one", lambda t, r, index, f: unbatched.extend(index)
    )
    batched = measured_designs(task, 0, count)
    monkeypatch.undo()
    assert unbatched == []
    with monkeypatch.context() as patched:
        patched.setattr(SweepTask, "loops", None)
        single = measured_designs(task, 0, count)
    return batched, single


def assert_same(monkeypatch, task):
    batched, single = batched_and_single(monkeypatch, task)
    assert (batched.outcome == 0).all()
    for name, values in single.values.items():
        # accelerations are less accurate: they divide by the conditioning twice
        tolerance = 1e-10 if ".a" in name else 1e-12
        scale = max(np.abs(values).max(), 1e-2)
        np.testing.assert_allclose(batched.values[name], values, atol=tolerance * scale, err_msg=name)


@pytest.mark.long
@pytest.mark.parametrize("name", SWEPT)
def test_batched_designs_have_the_measures_of_single_designs(monkeypatch, name):
    vary, measures = SWEPT[name]
    assert_same(monkeypatch, swept_task(name, vary, measures, samples=24))


def test_designs_with_an_idle_spin_are_batched(monkeypatch):
    # without a closed form: the spin of the coupler about its own line is undetermined
    spinning = ms.catalog.make("rssr").mechanism
    vary = {"P3.a.at.x": [-0.0455, -0.046]}
    assert_same(monkeypatch, swept_task(spinning, vary, ["range:rocker", "max:P3.ax"], samples=24))


def test_a_design_without_a_full_turn_swings():
    result = measured_designs(swept_task("looper", {"crank": [0.05, 0.006]}, "max:C.x", samples=24), 0, 2)
    assert [OUTCOMES[i] for i in result.outcome] == ["swings", "passed"]
    # a further root of one sign is numbered by its whole turn and not by its start
    task = swept_task("looper", {"crank": [0.006]}, "max:C.x", set={"side": "2"})
    assert task.subject.closed.start_frames(1) is None


def test_a_turn_is_complete_only_if_the_links_return():
    motion = ms.catalog.make("four_bar").solve(np.array([0.0, 1.0, 2.0 * np.pi, 0.0, 1.0, 6.2]))
    assert come_back(motion, 2).tolist() == [True, False]
