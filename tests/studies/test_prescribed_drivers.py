"""Runs in which some coordinates follow motion laws and the others are free."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.model.forces import Forces
from mechsim.studies.dynamics_check import crosscheck_forward

LENGTH, MASS, INERTIA, GRAVITY = 0.2, 1.5, 2e-3, 9.81
WEIGHT = Forces(gravity=(0.0, 0.0, -GRAVITY))
# a bead on a hoop that turns about a vertical diameter; it swings about the hoop's axis x
HOOP = f"""
name = "hoop"
drivers = ["hoop"]
[joints.hoop]
kind = "revolute"
a = {{ link = "ground" }}
b = {{ link = "hoop" }}
[joints.bead]
kind = "revolute"
a = {{ link = "hoop", axis = [1, 0, 0], reference = [0, 1, 0] }}
b = {{ link = "bead", axis = [1, 0, 0], reference = [0, 1, 0] }}
[links.hoop]
inertia = {{ mass = 1.0, centre = [0, 0, 0], moments = [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]] }}
[links.bead]
[links.bead.inertia]
mass = {MASS}
centre = [0, 0, {-LENGTH}]
moments = [[{INERTIA}, 0, 0], [0, {INERTIA}, 0], [0, 0, {INERTIA}]]
[points]
P = {{ link = "bead", at = [0, 0, {-LENGTH}] }}
"""
START = {"bead.q": "1rad", "bead.v": "-2rad/s"}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    file = tmp_path_factory.mktemp("hoop") / "hoop.toml"
    file.write_text(HOOP)
    return file


def model(path, law, forces=WEIGHT):
    return ms.dynamics.dynamic_model(ms.load(path, drive={"hoop": law}), forces)


def test_a_bead_on_a_turning_hoop_keeps_the_jacobi_integral_and_needs_the_torque_of_its_angular_momentum(
    path,
):
    speed = 2.0 * np.pi
    run = ms.dynamics.run(model(path, "60rpm"), initial=START, prescribed=["hoop"], duration=2.0)
    bead = run.motion.joints["bead"]
    sine, cosine = np.sin(bead.value), np.cos(bead.value)
    jacobi = 0.5 * (MASS * LENGTH**2 + INERTIA) * bead.rate**2
    jacobi -= 0.5 * MASS * (LENGTH * speed * sine) ** 2 + MASS * GRAVITY * LENGTH * cosine
    # the energy that changes hands is a few joules; eight digits beyond the step tolerance are rounding
    assert np.ptp(jacobi) < 1e-10 * np.ptp(MASS * GRAVITY * LENGTH * cosine)
    torque = 2.0 * MASS * LENGTH**2 * sine * cosine * bead.rate * speed
    assert run.driving["hoop"] == pytest.approx(torque, abs=1e-12 * np.abs(torque).max())
    assert run.motion.joints["hoop"].value == pytest.approx(speed * run.time, abs=1e-13)
    assert run.energy_error < 1e-10
    assert "drive hoop" in dict(run.columns())


@pytest.mark.parametrize("law", ["60rpm", pytest.param("30deg*sin(2*pi*3*t)", marks=pytest.mark.slow)])
def test_mujoco_follows_the_same_law_and_a_wrong_driving_torque_is_noticed(path, law):
    acting = model(path, law)
    run = ms.dynamics.run(acting, initial=START, prescribed=["hoop"], duration=0.5, samples=60)
    start = initial_values(acting, START)
    verdict = crosscheck_forward(run, acting, start)
    assert verdict.passed, verdict
    assert "drive of hoop" in {check.quantity for check in verdict.checks}
    wrong = replace(run, driving={"hoop": 1.0001 * run.driving["hoop"]})
    assert not crosscheck_forward(wrong, acting, start).passed
    later = replace(run, motion=replace(run.motion, points={"P": run.motion.points["P"]}))
    assert crosscheck_forward(later, acting, start).passed


def test_one_motor_of_a_five_bar_is_prescribed_and_the_other_released():
    linkage = ms.dynamics.dynamic_model(ms.load("five_bar", drive={"left": "2rad+0.3rad*sin(2*pi*t)"}))
    run = ms.dynamics.run(linkage, initial={"right.v": 1.0}, prescribed=["left"], duration=0.2, samples=40)
    assert run.motion.joints["left"].value == pytest.approx(
        2.0 + 0.3 * np.sin(2 * np.pi * run.time), abs=1e-12
    )
    assert run.energy_error < 1e-10
    verdict = crosscheck_forward(run, linkage, initial_values(linkage, {"right.v": 1.0}))
    assert verdict.passed, verdict


def test_what_contradicts_a_motion_law_ends_in_one_sentence(path):
    with pytest.raises(ms.InputError, match="'hoop' follows its motion law"):
        ms.dynamics.run(model(path, "60rpm"), initial={"hoop.q": 1.0}, prescribed=["hoop"], duration=1.0)
    with pytest.raises(ms.InputError, match="'bead' has no motion law"):
        ms.dynamics.run(model(path, "60rpm"), prescribed=["bead"], duration=1.0)
