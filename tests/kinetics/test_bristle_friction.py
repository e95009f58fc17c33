"""Friction with bristles (LuGre) against scipy's integration of its equations, and in MuJoCo."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinetics import dynamic_model


@pytest.mark.long
def test_bristles_bring_a_small_motion_to_rest_in_c():
    """Errors relative to a creep of 0.4 mrad are near rounding, which shorter steps would not reduce.

    At rest the bristles hold the weight, by virtual work: k sum of z_i dq_i = -dV.
    """
    names = ("crank", "crank2", "A")
    rows = tuple(
        ms.Friction(name, coulomb=1e-3, bristle_stiffness=1.0, bristle_damping=1e-3) for name in names
    )
    model = dynamic_model(ms.load("warp_knitter"), ms.Forces(gravity=(0.0, -9.81, 0.0), friction=rows))
    run = ms.dynamics.run(model, duration=0.3, samples=900)
    assert (run.outcome, run.executed) == ("done", "C")
    assert run.energy_error <= 1e-10
    values = [run.motion.joints[name].value for name in names]
    along = (values[0] - values[0][-1]) / np.ptp(values[0])

    def derivative(course):
        return np.polyfit(along, course - course[-1], 3)[-2]

    carried = sum(z[-1] * derivative(value) for z, value in zip(run.activation, values, strict=True))
    assert abs(carried + derivative(run.potential)) <= 1e-5 * abs(carried)
