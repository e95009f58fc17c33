"""Laws of couplings and gears of the gallery: how one shaft turns with another.

A function takes crank angles in [rad], (n,), and the parameters of its file, in mm and degrees, and returns
the tracked points, (n, 3) in [m].
"""

import numpy as np


def rim(angle, radius, first, second, centre=(0.0, 0.0, 0.0)):
    """Return a point on a wheel in [m]: towards `first` at angle 0, towards `second` at a right angle."""
    on = np.cos(angle)[:, None] * np.array(first) + np.sin(angle)[:, None] * np.array(second)
    return (np.array(centre) + radius * on) / 1000.0


def on_circle(angle, radius):
    """Return a point in mm in the plane of the shafts that lies at an angle."""
    return rim(angle, radius, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def crossed(angle, p):
    """Return the tips of the yokes before and beyond a cross, where tan(out) = tan(in) cos(shaft_angle)."""
    shaft_angle = np.deg2rad(p["bend"])
    out = np.arctan2(np.sin(angle) * np.cos(shaft_angle), np.cos(angle))
    across = (-np.sin(shaft_angle), np.cos(shaft_angle), 0.0)
    return (
        rim(angle, p["arm"], (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)),
        rim(out, p["arm"], across, (0.0, 0.0, 1.0)),
    )


def cardan_joint(angle, p):
    """Return the tips of both yokes."""
    driving, driven = crossed(angle, p)
    return {"driving": driving, "driven": driven}


def double_cardan(angle, p):
    """Return the tips of all yokes: the last turns as the first."""
    driving, middle = crossed(angle, p)
    shaft_angle = np.deg2rad(p["bend"])
    centre = (p["length"] * np.cos(shaft_angle), p["length"] * np.sin(shaft_angle), 0.0)
    back = (np.sin(2.0 * shaft_angle), -np.cos(2.0 * shaft_angle), 0.0)
    driven = rim(angle, p["arm"], (0.0, 0.0, 1.0), back, centre)
    return {"driving": driving, "middle": middle, "driven": driven}


def oldham_coupling(angle, p):
    """Return the disc's centre: on the circle over the offset, where two lines at right angles meet."""
    across = p["offset"] * np.cos(angle) / 1000.0
    return {"disc": across[:, None] * on_circle(angle, 1000.0)}


def planetary_gear(angle, p):
    """Return the planet's axle and a point of planet and sun: Willis."""
    axle = on_circle(angle, p["arm"])
    planet = angle * (1.0 - p["teeth_ring"] / p["teeth_planet"])
    sun = angle * (1.0 + p["teeth_ring"] / p["teeth_sun"])
    return {"axle": axle, "planet": axle + on_circle(planet, p["planet"]), "sun": on_circle(sun, p["sun"])}


def belt_drive(angle, p):
    """Return a point on each pulley: belts keep the ratio of the radii, a crossed one the opposite sense."""
    fan, pump = p["motor"] / p["fan"], -p["motor"] / p["pump"]
    x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    return {
        "motor": on_circle(angle, p["motor"]),
        "fan": rim(fan * angle, p["fan"], x, y, (150.0, 60.0, 0.0)),
        "pump": rim(pump * angle, p["pump"], x, y, (-120.0, 50.0, 0.0)),
    }


def hoist(angle, p):
    """Return a point on the drum, and the hook on two falls."""
    hook = np.array([1.5 * p["radius"], -560.0, 0.0]) + p["radius"] / 2.0 * np.outer(angle, (0.0, 1.0, 0.0))
    return {"rim": on_circle(angle, p["radius"]), "hook": hook / 1000.0}
