"""Runs of small motions are as accurate, relative to the motion, as those of large ones."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms


# start and rest of the spring in [m]; with an offset the rounding of the coordinate limits the accuracy
@pytest.mark.parametrize(
    ("mass", "start", "rest", "limit"),
    [(1.0, 0.0, 2e-4, 1e-11), (1e-6, 0.0, 1e-9, 1e-11), (1.0, 0.5, 0.500001, 1e-8)],
)
def test_a_block_on_a_spring_moves_harmonically(file, mass, start, rest, limit):
    path = file(
        model_text("small_motions_slide.toml", mass=mass, stiffness=1000.0 * mass, start=start, rest=rest)
    )
    run = ms.dynamics.run(path, duration=2.0)
    exact = rest + (start - rest) * np.cos(np.sqrt(1000.0) * run.time)
    error = np.abs(run.motion.joints["slide"].value - exact).max()
    assert error < limit * abs(rest - start)


@pytest.mark.parametrize(("length", "mass"), [(1.0, 1.0), (1000.0, 1.0), (1e-3, 1e-6)])
def test_a_pendulum_at_a_microradian_moves_harmonically(file, length, mass):
    path = file(model_text("small_motions_pendulum.toml", mass=mass, height=-length, start=1e-6))
    frequency = np.sqrt(9.81 / length)
    run = ms.dynamics.run(path, duration=10.0 * np.pi / frequency)
    # the period is longer by 1/16 of the amplitude squared, 6e-14
    exact = 1e-6 * np.cos(frequency * run.time)
    assert np.abs(run.motion.joints["hinge"].value - exact).max() < 1e-11 * 1e-6


def test_a_small_motion_agrees_with_mujoco(file, mechsim):
    path = file(model_text("small_motions_slide.toml", mass=1.0, stiffness=1000.0, start=0.0, rest=1e-4))
    answer = mechsim("dynamics", "forward", path, "--duration", "1s")
    assert answer.code == 0, answer.out


@pytest.mark.long
def test_a_spring_at_rest_stores_nothing(file):
    path = file(model_text("small_motions_slide.toml", mass=1.0, stiffness=10.0, start=0.0, rest=0.1))
    assert [each.potential for each in ms.dynamics.equilibria(path)] == [0.0]
