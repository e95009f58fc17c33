"""Laws of spatial linkages of the gallery.

A function takes crank angles in [rad], (n,), and the parameters of its file, in mm and degrees, and returns
the tracked points, (n, 3) in [m].
"""

import numpy as np

from mechsim import vectors


def spherical_four_bar(angle, p):
    """Return both ends of the coupler: B keeps its angles to A and to the rocker's axis."""
    ground, crank, coupler, rocker = (
        np.deg2rad(p[name]) for name in ("ground", "crank", "coupler", "rocker")
    )
    a = np.stack(
        [np.sin(crank) * np.cos(angle), np.sin(crank) * np.sin(angle), np.full_like(angle, np.cos(crank))]
    )
    axis = vectors.column((np.sin(ground), 0.0, np.cos(ground)))
    b = vectors.unit_at_angles(axis, a, rocker, coupler, -1)
    return {"A": p["radius"] / 1000.0 * a.T, "B": p["radius"] / 1000.0 * b.T}


def rsur(angle, p):
    """Return both ends of the coupler and a point off their line; B moves in a circle about the x axis."""
    ex, pivot = vectors.column((1.0, 0.0, 0.0)), vectors.column((p["x"], p["y"], p["z"]))
    a = p["crank"] * vectors.rotate(ex, vectors.column((0.0, 0.0, 1.0)), angle)
    b = pivot + p["rocker"] * vectors.circle_sphere(pivot, ex, p["rocker"], a, p["coupler"], 1)
    # the coupler's axis in the cross is square to the coupler and to the rocker's axis
    along = (b - a) / p["coupler"]
    axis = vectors.cross(along, ex)
    c = a + p["coupler"] / 2.0 * along + p["arm"] * axis / vectors.norm(axis)
    return {"A": a.T / 1000.0, "B": b.T / 1000.0, "C": c.T / 1000.0}
