"""Pendulums of point masses, and a block that slides, under their weight."""

from dataclasses import replace

import numpy as np
from model_files import stated_mechanism

import mechsim as ms

GRAVITY = 9.81
WEIGHT = ms.Forces(gravity=(0.0, -GRAVITY, 0.0))


def point_mass(mass=1.0, centre=(1.0, 0.0, 0.0), about=1e-20):
    return ms.Inertia(mass, centre, tuple(tuple(row) for row in about * np.eye(3)))


def pendulum():
    return stated_mechanism("pendulums_pendulum.toml")


def double_pendulum():
    return stated_mechanism("pendulums_double_pendulum.toml")


def slider(**more):
    """A block of 2 kg that slides along x."""
    return replace(stated_mechanism("pendulums_slider.toml"), **more)
