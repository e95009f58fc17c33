"""Pendulums of point masses, and a block that slides, under their weight."""

import numpy as np

import mechsim as ms

GRAVITY = 9.81
WEIGHT = ms.Forces(gravity=(0.0, -GRAVITY, 0.0))


def point_mass(mass=1.0, centre=(1.0, 0.0, 0.0), about=1e-20):
    return ms.Inertia(mass, centre, tuple(tuple(row) for row in about * np.eye(3)))


def pendulum():
    arm = ms.Link("arm", outline=((1.0, 0.0, 0.0),), inertia=point_mass())
    pivot = ms.Joint("pivot", "revolute", ms.End("ground"), ms.End("arm"))
    return ms.Mechanism("simple pendulum", (arm,), (pivot,), "pivot", {"P": ("arm", (1.0, 0.0, 0.0))})


def double_pendulum():
    tip = (1.0, 0.0, 0.0)
    links = tuple(ms.Link(name, outline=(tip,), inertia=point_mass()) for name in ("first", "second"))
    joints = (
        ms.Joint("A", "revolute", ms.End("ground"), ms.End("first")),
        ms.Joint("B", "revolute", ms.End("first", tip), ms.End("second")),
    )
    points = {"P": ("first", tip), "Q": ("second", tip)}
    return ms.Mechanism("double pendulum", links, joints, ("A", "B"), points)


def slider(**more):
    """A block of 2 kg that slides along x."""
    block = ms.Link(
        "block", inertia=ms.Inertia(2.0, (0.0, 0.0, 0.0), tuple(tuple(row) for row in 0.01 * np.eye(3)))
    )
    rail = ms.Joint(
        "s", "prismatic", ms.End("ground", axis=(1.0, 0.0, 0.0)), ms.End("block", axis=(1.0, 0.0, 0.0))
    )
    return ms.Mechanism("slider", (block,), (rail,), "s", {"P": ("block", (1.0, 0.0, 0.0))}, **more)
