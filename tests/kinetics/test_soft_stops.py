"""Soft stops of joints: convergence of MuJoCo, and states between them."""

import numpy as np
import pytest
from model_files import changed_model, load_model

import mechsim as ms
from mechsim.kinetics.model import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run


@pytest.mark.long
def test_mujoco_converges_for_a_pendulum_between_two_stops():
    solver = load_model(
        "soft_stops_pendulum.toml",
        ('"-30 deg"', '"-80 deg"'),
        ('"1 rad/s"', '"4 rad/s"'),
        limits='{ lower = "-100 deg", upper = "-60 deg", stiffness = 40, damping = "0.3 N m s/rad" }',
        still=True,
    )
    run = ms.dynamics.run(solver, duration="0.3s", samples=30)
    model = dynamic_model(solver)

    def error(substeps):
        stepped = stepped_run(
            model.mechanism, model.forces, {"hip": np.radians(-80.0)}, {"hip": 4.0}, run.time, substeps
        )
        return np.abs(stepped.motion.joints["hip"].value - run.motion.joints["hip"].value).max()

    # first order: MuJoCo's steps do not end at the contacts
    coarse, fine = error(10), error(80)
    assert fine < 0.4 * coarse
    assert fine < 1e-4


def test_states_are_drawn_between_soft_stops():
    """`sample` and `show` know limits of a TOML file, hard or soft."""
    for law in ("restitution = 0.5", "stiffness = 20"):
        crank = ms.sample(changed_model("soft_stops_four_bar.toml", law=law), 50).qpos[:, 0]
        assert np.radians(-10.0) <= crank.min() < 0.0
        assert 1.0 < crank.max() <= np.radians(100.0)
