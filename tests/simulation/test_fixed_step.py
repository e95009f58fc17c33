"""A requested time step is used exactly, or rejected with the limit and the remedy."""

import numpy as np
import pytest

import mechsim as ms

LAW = {"crank": "0.3*sin(2*pi*t)"}
SPEED = ms.units.rpm(600)


@pytest.fixture(scope="module")
def swung():
    return ms.load("four_bar", drive=LAW, duration=1.0)


def run_with_step(model, timestep, **options):
    """Return a stepped run and check its time step from the recorded times."""
    run = ms.simulate(model, timestep=timestep, **options)
    assert run.method == "step"
    assert run.timestep == pytest.approx(timestep, rel=1e-12)
    assert run.motion.time is not None
    assert run.motion.time[-1] == pytest.approx(run.steps * timestep, rel=1e-12)
    return run


def test_a_motion_law_run_uses_the_requested_time_step(swung):
    run = run_with_step(swung, 0.002)
    assert run.steps == 500
    assert run.outcome == "passed"
    # the crank follows its law at these times; a force constant over a step makes it lag by (w dt)^2/12
    lag = 0.3 * (2.0 * np.pi * 0.002) ** 2 / 12.0
    crank = run.motion.joints["crank"].value
    np.testing.assert_allclose(crank, 0.3 * np.sin(2.0 * np.pi * run.motion.time), atol=1.01 * lag)


@pytest.mark.parametrize(("speed", "steps"), [(SPEED, 50), (1.01 * SPEED, 49)])
def test_a_crank_run_uses_a_time_step_that_need_not_divide_the_turn(speed, steps):
    run = run_with_step(ms.catalog.make("rssr"), 0.002, speed=speed)
    assert run.steps == steps
    assert ("the run ends at 0.098 s" in run.note) == (steps == 49)


def test_records_lie_on_whole_steps(swung):
    run = run_with_step(swung, 0.002, samples=100)
    np.testing.assert_allclose(run.motion.time, np.linspace(0.0, 1.0, 101), atol=1e-12)
    with pytest.raises(ms.InputError, match=r"71 equal .* 500 steps of 0\.002 s; take 50 or 100 intervals"):
        ms.simulate(swung, timestep=0.002, samples=71)
