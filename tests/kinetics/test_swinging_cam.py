"""A swinging follower under a spring: at rest on a dwell, and in motion against Lagrange's equation."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run

MOMENT, LIGHT = 1e-3, 1e-9
# law of cosines: arm 70 mm, centres 80 mm, base and roller 38 mm
START = np.arccos((0.08**2 + 0.07**2 - 0.038**2) / (2 * 0.08 * 0.07))


def model_of(folder, moment):
    path = folder / "cam.toml"
    path.write_text(model_text("swinging_cam.toml", moment=moment))
    return dynamic_model(ms.load(str(path), still=True))


@pytest.mark.long
def test_a_light_cam_does_not_make_its_contact_compliant_in_mujoco(tmp_path):
    model = model_of(tmp_path, LIGHT)
    stepped = stepped_run(model.mechanism, model.forces, {}, {}, np.linspace(0.0, 1.0, 101), 10)
    pivot = stepped.motion.joints["pivot"].value
    # 1e-4 rad with the mobility of the cam, which does not move
    assert np.abs(pivot + START).max() < 1e-7
