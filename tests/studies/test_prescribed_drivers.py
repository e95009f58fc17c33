"""Runs in which some coordinates follow motion laws and the others are free."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import changed_model

import mechsim as ms
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

LENGTH, MASS, INERTIA, GRAVITY = 0.2, 1.5, 2e-3, 9.81
WEIGHT = ms.Forces(gravity=(0.0, 0.0, -GRAVITY))
# a bead on a hoop that turns about a vertical diameter; it swings about the hoop's axis x
HOOP = {"mass": MASS, "height": -LENGTH, "inertia": INERTIA}
START = {"bead.q": "1rad", "bead.v": "-2rad/s"}


def hoop(law, drivers='["hoop"]'):
    path = changed_model("prescribed_drivers_hoop.toml", ('["hoop"]', drivers), **HOOP)
    return ms.dynamics.dynamic_model(ms.load(path, drive={"hoop": law}, still=True), WEIGHT)


@pytest.mark.long
@pytest.mark.parametrize("drivers", ['["hoop"]', '["bead", "hoop"]'])
def test_a_bead_on_a_rotating_hoop_keeps_the_jacobi_integral(drivers):
    speed = 2.0 * np.pi
    run = ms.dynamics.run(hoop("60rpm", drivers), initial=START, prescribed=["hoop"], duration=2.0)
    bead = run.motion.joints["bead"]
    sine, cosine = np.sin(bead.value), np.cos(bead.value)
    jacobi = 0.5 * (MASS * LENGTH**2 + INERTIA) * bead.rate**2
    jacobi -= 0.5 * MASS * (LENGTH * speed * sine) ** 2 + MASS * GRAVITY * LENGTH * cosine
    # relative to the exchanged energy of a few joules
    assert np.ptp(jacobi) < 1e-10 * np.ptp(MASS * GRAVITY * LENGTH * cosine)
    torque = 2.0 * MASS * LENGTH**2 * sine * cosine * bead.rate * speed
    assert run.driving["hoop"] == pytest.approx(torque, abs=1e-12 * np.abs(torque).max())
    assert run.motion.joints["hoop"].value == pytest.approx(speed * run.time, abs=1e-13)
    assert (run.executed, run.energy_error < 1e-10) == ("C", True)
    assert "drive hoop" in dict(run.columns())


@pytest.mark.long
@pytest.mark.parametrize("law", ["60rpm", pytest.param("30deg*sin(2*pi*3*t)", marks=pytest.mark.slow)])
def test_mujoco_agrees_on_the_driving_torque_and_rejects_a_wrong_one(law):
    driven_model = hoop(law)
    run = ms.dynamics.run(driven_model, initial=START, prescribed=["hoop"], duration=0.15, samples=20)
    start = initial_values(driven_model, START)
    verdict = crosscheck_forward(run, driven_model, start)
    assert verdict.passed, verdict
    assert "drive of hoop" in {check.quantity for check in verdict.checks}
    wrong = replace(run, driving={"hoop": 1.0001 * run.driving["hoop"]})
    assert not crosscheck_forward(wrong, driven_model, start).passed
    points_only = replace(run, motion=replace(run.motion, points={"P": run.motion.points["P"]}))
    assert crosscheck_forward(points_only, driven_model, start).passed
