"""Accelerations of solved poses are exact to rounding despite large servo and spring forces."""

import numpy as np
from model_files import model_text

import mechsim as ms

# light links with a servo, a spring and a damper whose forces are large for them
OPPOSED = model_text("forces_of_posed_scenes_opposed.xml")


def test_opposing_servos_do_not_affect_accelerations_of_solved_poses(tmp_path):
    path = tmp_path / "opposed.xml"
    path.write_text(OPPOSED)
    subject = ms.load(path, drive={"crank": "0.3*(1-cos(2*pi*t))"})
    posed = ms.simulate(subject, method="pose").motion
    exact = subject.solve(t=posed.time)
    for name in ("rod", "rocker"):
        expected = exact.joints[name].acceleration
        # measured 1e-15 of the largest, and 3.5e-7 with those forces active
        assert np.abs(posed.joints[name].acceleration - expected).max() < 1e-13 * np.abs(expected).max()
