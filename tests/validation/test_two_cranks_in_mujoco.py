"""Velocities of the warp knitter in MuJoCo with one crank stopped, with the other, and with both."""

import numpy as np
from two_cranks import one_crank_stopped
from velocity_plan import velocity_plans

from mechsim import catalog
from mechsim.simulation import simulate

SPEED = 62.0


def simulated_velocities(mechanism, speed):
    """Velocities at the start by solved poses: no integration, so the instant is exact."""
    points = simulate(mechanism, speed=speed, turns=1e-3, samples=1, method="pose").motion.points
    return {name: points[name].velocity[0] for name in "ABCDK"}


def test_velocities_of_geared_cranks_equal_the_summed_plans():
    linkage = catalog.make("warp_knitter")
    run = simulate(linkage.mechanism, speed=SPEED, samples=12, method="pose").motion
    for i, angle in enumerate(run.angle):
        _, _, drawn = velocity_plans(linkage, float(angle), SPEED)
        for name in "BCK":
            np.testing.assert_allclose(run.points[name].velocity[i], drawn[name], atol=1e-12)


def test_a_plan_with_the_wrong_crank_stopped_differs():
    linkage = catalog.make("warp_knitter")
    first, _, _ = velocity_plans(linkage, 0.3, SPEED)
    crank2_only = simulated_velocities(one_crank_stopped(linkage, "crank1", 0.3), linkage.gear_ratio * SPEED)
    assert np.abs(crank2_only["K"] - first.velocities["K"]).max() > 1e-3
