"""Ropes over pulleys against the equation of motion of a hoist."""

import numpy as np

import mechsim as ms
from mechsim.studies.robots.serial_twin import serial_twin


def test_a_hoist_without_loops_couples_the_hook_to_the_drum_by_its_name():
    # in models of MuJoCo the crank has another name, which the terms of the rope must not keep
    twin = serial_twin("hoist", "urdf", independent={"drum": (-1.0, 1.0)})
    assert abs(float(twin.text.split('multiplier="')[1].split('"')[0]) - 0.025) < 1e-15
    states = ms.sample("hoist", 4)
    assert np.abs(states.qpos[:, 1] - 0.025 * states.qpos[:, 0]).max() < 1e-15
