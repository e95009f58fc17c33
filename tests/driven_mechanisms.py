"""Mechanisms whose drivers are several, slides or coupled, for both methods."""

from dataclasses import replace

import numpy as np
from model_files import model_mechanism, stated_mechanism

from mechsim import catalog
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.links import GROUND, Link
from mechsim.mechanism.mechanism import Mechanism

ALONG_X, ALONG_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def sinusoidal(middle, reach, rate, phase=0.0):
    """Return a sinusoidal motion law."""

    def state(time):
        rotated = rate * time + phase
        return (
            middle + reach * np.sin(rotated),
            reach * rate * np.cos(rotated),
            -reach * rate**2 * np.sin(rotated),
        )

    return state


def five_bar() -> Mechanism:
    """Return a five-bar: arms of 50 mm on pivots 100 mm apart, rods of 90 mm that meet in P above them."""
    return model_mechanism("driven_mechanisms_five_bar.toml")


def circle_intersection(left, right):
    """Return P of the five-bar, above the line of the arms' ends, (n, 2)."""
    a = 0.05 * np.stack([np.cos(left), np.sin(left)], 1)
    d = 0.05 * np.stack([np.cos(right), np.sin(right)], 1) + [0.1, 0.0]
    across = d - a
    length = np.sqrt((across**2).sum(1, keepdims=True))
    u = across / length
    return (a + d) / 2 + np.sqrt(0.09**2 - length**2 / 4) * np.stack([-u[:, 1], u[:, 0]], 1)


def boom() -> Mechanism:
    """Return a boom lifted by a cylinder, whose length is driven."""
    return stated_mechanism("driven_mechanisms_boom.toml")


def rack_and_cam() -> Mechanism:
    """Return a rack and a cam follower, coupled to the crank linearly and by a polynomial."""
    return model_mechanism("driven_mechanisms_rack_and_cam.toml")


def nonlinear_rack() -> Mechanism:
    """Return a driven pinion with a linear rack, and a follower coupled nonlinearly to the rack."""
    whole = rack_and_cam()
    law = Coupling("cam", "cam", "rack", (0.0, 0.3, -8.0, 40.0), zeros=(0.003, 0.01))
    return replace(whole, driver=("crank",), locked={}, couplings=(whole.couplings[0], law))


def nonlinear_rocker() -> Mechanism:
    """Return a four-bar with a slide coupled nonlinearly to its rocker."""
    whole = catalog.make("four_bar").mechanism
    sides = End(GROUND, (0.0, 0.2, 0.0), ALONG_X), End("slider", axis=ALONG_X)
    return replace(
        whole,
        links=(*whole.links, Link("slider", outline=((0.0, 0.0, 0.0), (0.02, 0.0, 0.0)))),
        joints=(*whole.joints, Joint("cam", "prismatic", *sides)),
        couplings=(Coupling("cam", "cam", "rocker", (0.0, 0.05, 0.03, -0.02)),),
    )


def five_bar_with_cam() -> Mechanism:
    """Return a five-bar with a slide coupled nonlinearly to a passive joint."""
    whole = five_bar()
    cam = Joint("cam", "prismatic", End("b", axis=ALONG_X), End("d2", axis=ALONG_X))
    return replace(
        whole,
        links=(*whole.links, replace(whole.links[0], name="d2", outline=((0.01, 0.0, 0.0),))),
        joints=(*whole.joints, cam),
        couplings=(Coupling("cam", "cam", "A", (0.0, 0.01, 0.004)),),
        points={"Q": ("d2", (0.0, 0.0, 0.0))},
    )


def press() -> Mechanism:
    """Return a screw with a guided nut."""
    return model_mechanism("driven_mechanisms_press.toml")


def table(*, backwards: bool) -> Mechanism:
    """Return a plate on a plane, its two displacements and its rotation coupled to the tool on it."""
    whole = stated_mechanism("driven_mechanisms_table.toml")
    plane, tool = whole.joints
    return replace(whole, joints=(replace(plane, a=plane.b, b=plane.a), tool)) if backwards else whole
