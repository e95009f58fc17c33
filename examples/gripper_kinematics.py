"""Pad positions of the gallery's parallel gripper; `short_arm` has an arm that is 1 mm too short.

Run: mechsim validate parallel_gripper --against examples/gripper_kinematics.py:short_arm
"""

import numpy as np

HEIGHT, OPENING = 0.04, 0.085


def pads(angle, arm=0.057):
    """Return the positions of both pads at driver angles in [rad], each (n, 3) in [m]."""
    # the pads are OPENING apart at a driver angle of 30 degrees
    x = OPENING / 2 + arm * (np.cos(angle) - np.cos(np.pi / 6))
    y = HEIGHT + arm * np.sin(angle)
    z = np.zeros_like(x)
    return {"right": np.column_stack([x, y, z]), "left": np.column_stack([-x, y, z])}


def short_arm(angle):
    """Return the same for an arm that is 1 mm too short."""
    return pads(angle, arm=0.056)
