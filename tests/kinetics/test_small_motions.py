"""Runs of small motions are as accurate, relative to the motion, as those of large ones."""

import numpy as np
import pytest

import mechsim as ms

SLIDE = """name = "slide"
drivers = ["slide"]
[links.block]
inertia = {{ mass = {mass}, centre = [0, 0, 0], moments = [1e-3, 1e-3, 1e-3] }}
[joints.slide]
kind = "prismatic"
a = {{ link = "ground", axis = [1, 0, 0] }}
b = {{ link = "block", axis = [1, 0, 0] }}
[forces]
gravity = [0, 0, 0]
joint_springs.slide = {{ stiffness = {stiffness}, rest = {rest} }}
[initial]
slide = {{ q = {start} }}
"""
PENDULUM = """name = "pendulum"
drivers = ["hinge"]
[links.bob]
inertia = {{ mass = {mass}, centre = [0, {height}, 0], moments = [0, 0, 0] }}
[joints.hinge]
kind = "revolute"
a = {{ link = "ground" }}
b = {{ link = "bob" }}
[points.P]
link = "bob"
at = [0, {height}, 0]
[forces]
gravity = [0, -9.81, 0]
[initial]
hinge = {{ q = {start} }}
"""


# start and rest of the spring in [m]; with an offset the rounding of the coordinate limits the accuracy
@pytest.mark.parametrize(
    ("mass", "start", "rest", "limit"),
    [(1.0, 0.0, 2e-4, 1e-11), (1e-6, 0.0, 1e-9, 1e-11), (1.0, 0.5, 0.500001, 1e-8)],
)
def test_a_block_on_a_spring_moves_harmonically(tmp_path, mass, start, rest, limit):
    path = tmp_path / "slide.toml"
    path.write_text(SLIDE.format(mass=mass, stiffness=1000.0 * mass, start=start, rest=rest))
    run = ms.dynamics.run(str(path), duration=2.0)
    exact = rest + (start - rest) * np.cos(np.sqrt(1000.0) * run.time)
    error = np.abs(run.motion.joints["slide"].value - exact).max()
    assert error < limit * abs(rest - start)


@pytest.mark.parametrize(("length", "mass"), [(1.0, 1.0), (1000.0, 1.0), (1e-3, 1e-6)])
def test_a_pendulum_at_a_microradian_moves_harmonically(tmp_path, length, mass):
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM.format(mass=mass, height=-length, start=1e-6))
    frequency = np.sqrt(9.81 / length)
    run = ms.dynamics.run(str(path), duration=10.0 * np.pi / frequency)
    # the period is longer by 1/16 of the amplitude squared, 6e-14
    exact = 1e-6 * np.cos(frequency * run.time)
    assert np.abs(run.motion.joints["hinge"].value - exact).max() < 1e-11 * 1e-6


def test_a_small_motion_agrees_with_mujoco(tmp_path, mechsim):
    path = tmp_path / "slide.toml"
    path.write_text(SLIDE.format(mass=1.0, stiffness=1000.0, start=0.0, rest=1e-4))
    answer = mechsim("dynamics", "forward", str(path), "--duration", "1s")
    assert answer.code == 0, answer.out


@pytest.mark.long
def test_a_spring_at_rest_stores_nothing(tmp_path):
    path = tmp_path / "slide.toml"
    path.write_text(SLIDE.format(mass=1.0, stiffness=10.0, start=0.0, rest=0.1))
    assert [each.potential for each in ms.dynamics.equilibria(str(path))] == [0.0]
