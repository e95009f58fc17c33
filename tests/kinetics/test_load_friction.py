"""Friction by load and rate in a prescribed motion, by both methods."""

import numpy as np
import pytest
from model_files import load_model

from mechsim import dynamics
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven


def test_friction_by_rate_acts_in_a_prescribed_motion_by_both_methods():
    solver = load_model(
        "load_friction_slider_crank.toml",
        ("coefficient = 0.1 }", 'coefficient = 0.1, static = 0.3, stribeck = "0.5 m/s" }'),
        more="[forces.loads.press]\nat = { link = 'slider' }\nforce = ['-300 N', 0, 0]",
    )
    model = dynamics.dynamic_model(solver)
    run = driven(model.mechanism, model.forces, speed=25.0, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    study = dynamics.prescribed(model, run.motion.angle, 25.0)
    joints = model.solver.solve(run.motion.angle, 25.0).joints
    slide, normal = joints["slide"].rate, study.forces.reactions["slide"].force[:, 1]
    curve = 0.1 + 0.2 * np.exp(-((slide / 0.5) ** 2))
    # the power of all friction less that of the pins
    pins = np.zeros(13)
    for name, moment in (("crank", 0.15 * 8e-3), ("A", 0.2 * 6e-3), ("B", 0.25 * 5e-3)):
        load = np.linalg.norm(study.forces.reactions[name].force[:, :2], axis=1)
        pins += (moment * load + 0.01 * (name == "A")) * np.abs(joints[name].rate)
    expected = curve * np.abs(normal * slide)
    assert study.forces.power_lost - pins == pytest.approx(expected, rel=1e-9, abs=1e-9)
