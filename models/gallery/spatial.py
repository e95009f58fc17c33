"""Laws of spatial linkages of the gallery.

A function takes crank angles in [rad], (n,), and the parameters of its file, in mm and degrees, and returns
the tracked points, (n, 3) in [m].
"""

import numpy as np


def spherical_four_bar(angle, p):
    """Return both ends of the coupler: B keeps its angles to A and to the rocker's axis."""
    ground, crank, coupler, rocker = (
        np.deg2rad(p[name]) for name in ("ground", "crank", "coupler", "rocker")
    )
    a = np.column_stack(
        [np.sin(crank) * np.cos(angle), np.sin(crank) * np.sin(angle), np.full_like(angle, np.cos(crank))]
    )
    axis = np.array([np.sin(ground), 0.0, np.cos(ground)])
    between = (a @ axis)[:, None]
    square = 1.0 - between**2
    along_axis = (np.cos(rocker) - between * np.cos(coupler)) / square
    along_a = (np.cos(coupler) - between * np.cos(rocker)) / square
    flat = along_axis * axis + along_a * a
    across = np.sqrt((1.0 - (flat**2).sum(1, keepdims=True)) / square)
    b = flat - across * np.cross(axis, a)
    return {"A": p["radius"] / 1000.0 * a, "B": p["radius"] / 1000.0 * b}


def rsur(angle, p):
    """Return both ends of the coupler and a point beside it: |AB| gives a cos + b sin = c for the rocker."""
    zero = np.zeros_like(angle)
    a = np.column_stack([p["crank"] * np.cos(angle), p["crank"] * np.sin(angle), zero])
    pivot = np.array([p["x"], p["y"], p["z"]])
    gap = pivot - a
    cosine, sine = 2.0 * p["rocker"] * gap[:, 2], -2.0 * p["rocker"] * gap[:, 1]
    wanted = p["coupler"] ** 2 - p["rocker"] ** 2 - (gap**2).sum(1)
    rocker = np.arctan2(sine, cosine) + np.arccos(wanted / np.hypot(cosine, sine))
    b = pivot + p["rocker"] * np.column_stack([zero, -np.sin(rocker), np.cos(rocker)])
    # the coupler's axis in the cross is square to the coupler and to the rocker's axis, which is x
    along = (b - a) / p["coupler"]
    axis = np.cross(along, [1.0, 0.0, 0.0])
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    c = a + p["coupler"] / 2.0 * along + p["arm"] * axis
    return {"A": a / 1000.0, "B": b / 1000.0, "C": c / 1000.0}
