"""A swinging follower under a spring: at rest on a dwell."""

import numpy as np
import pytest
from model_files import load_model

from mechsim.kinetics import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run

# law of cosines: arm 70 mm, centres 80 mm, base and roller 38 mm
START = np.arccos((0.08**2 + 0.07**2 - 0.038**2) / (2 * 0.08 * 0.07))


@pytest.mark.long
def test_a_light_cam_does_not_make_its_contact_compliant_in_mujoco():
    model = dynamic_model(load_model("swinging_cam.toml", moment=1e-9, still=True))
    stepped = stepped_run(model.mechanism, model.forces, {}, {}, np.linspace(0.0, 1.0, 101), 10)
    pivot = stepped.motion.joints["pivot"].value
    # 1e-4 rad with the mobility of the cam, which does not move
    assert np.abs(pivot + START).max() < 1e-7
