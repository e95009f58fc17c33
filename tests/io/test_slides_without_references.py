"""Slides with different axes in the frames of their links: both methods start in one assembly mode."""

import numpy as np
import pytest
from model_files import FOLDER

import mechsim as ms


@pytest.mark.parametrize("tilt", [0.7, -2.2])
def test_the_orientation_of_an_inclined_slider_agrees_in_both_methods(tilt: float) -> None:
    solver = ms.load(FOLDER / "slides_without_references.toml", set={"tilt": tilt})
    run = ms.simulate(solver, method="pose", speed=1.0)
    exact = solver.solve(run.motion.angle)
    for motion in (run.motion, exact):
        along = motion.links["slider"].rotation[:, :, 0]
        assert np.abs(along - [np.cos(tilt), np.sin(tilt), 0.0]).max() < 1e-12
        assert np.abs(motion.links["slider"].rotation[:, 2, 2] - 1.0).max() < 1e-12
    distance = run.motion.points["nose"].position - exact.points["nose"].position
    assert np.abs(distance).max() < 1e-12 * solver.mechanism.characteristic_length
