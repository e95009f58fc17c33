"""Position of the piston: the formula of the control software, and a mistyped one."""

import numpy as np


def piston(angle):
    """Return the position of the piston at crank angles in [rad], (n, 3) in [m]."""
    return {"piston": along(angle, rod=0.095)}


def mistyped(angle):
    """Return the same with a rod of 96 mm for 95."""
    return {"piston": along(angle, rod=0.096)}


def along(angle, rod, crank=0.03, offset=0.008):
    """Return positions on the slide, (n, 3) in [m]."""
    x = crank * np.cos(angle) + np.sqrt(rod**2 - (offset - crank * np.sin(angle)) ** 2)
    return np.column_stack([x, np.full_like(x, offset), np.zeros_like(x)])
