"""Laws of planar linkages of the gallery that are built of dyads: each new pin is where two circles meet.

A function takes crank angles in [rad], (n,), and the parameters of its file, in mm and degrees, and returns
the tracked points, (n, 3) in [m]. Points in the plane are complex numbers.
"""

import numpy as np

from mechsim import vectors


def intersection(a, b, radius_a, radius_b, side):
    """Return where circles about two points meet, to the left of the line from a to b where side is 1."""
    gap = abs(b - a)
    angle = vectors.triangle_angle(gap, radius_a, radius_b)
    return a + radius_a * (b - a) / gap * np.exp(1j * side * angle)


def placed(**points):
    """Return points in mm as (n, 3) in [m]."""
    return {
        name: np.column_stack([point.real, point.imag, 0.0 * point.real]) / 1000.0
        for name, point in points.items()
    }


def opposite(angle, p, side):
    """Return tracer and coupler's end of a linkage with three equal arms.

    A circle about B goes through A, the rocker's pivot and, opposite A, the tracer: so the angle at the
    pivot is right.
    """
    a = p["crank"] * np.exp(1j * angle)
    radius = a - p["ground"]
    reach = np.sqrt((2.0 * p["arm"]) ** 2 - abs(radius) ** 2)
    tracer = p["ground"] + 1j * side * radius / abs(radius) * reach
    return placed(P=tracer, B=(a + tracer) / 2.0)


def hoeken(angle, p):
    """Return tracer P and pin B."""
    return opposite(angle, p, -1)


def chebyshev_lambda(angle, p):
    """Return tracer P and pin B."""
    return opposite(angle, p, 1)


def four_bar(angle, p):
    """Return both ends of the coupler."""
    a = p["crank"] * np.exp(1j * angle)
    return a, intersection(a, p["ground"], p["coupler"], p["rocker"], 1)


def watt_six_bar(angle, p):
    """Return the pins of the second four-bar."""
    _, b = four_bar(angle, p)
    rotation = (b - p["ground"]) / p["rocker"]
    c = p["ground"] + rotation * p["arm"] * np.exp(1j * np.deg2rad(40.0))
    return placed(C=c, D=intersection(c, p["ground"] + p["second"], p["rod"], p["output"], 1))


def stephenson_six_bar(angle, p):
    """Return the coupler point and the dyad's pin."""
    a, b = four_bar(angle, p)
    c = a + (b - a) / p["coupler"] * (p["coupler"] / 2.0 + 1j * p["arm"])
    return placed(C=c, D=intersection(c, p["ground"] + p["second"], p["rod"], p["output"], 1))


def klann(angle, p):
    """Return elbow, knee, hip and foot."""
    c = p["AC"] * np.exp(1j * angle)
    h = intersection(c, p["Bx"] + 1j * p["By"], p["CH"], p["BH"], -1)
    f = intersection(h, c, p["FH"], p["CF"], 1)
    e = intersection(p["Dx"] + 1j * p["Dy"], f, p["DE"], p["EF"], -1)
    return placed(H=h, F=f, E=e, G=intersection(e, f, p["EG"], p["FG"], 1))


def jansen(angle, p):
    """Return the joints of the leg that are tracked."""
    pin, hip = p["m"] * np.exp(1j * angle), -p["a"] - 1j * p["l"]
    top = intersection(pin, hip, p["j"], p["b"], -1)
    back = intersection(hip, top, p["d"], p["e"], 1)
    knee = intersection(pin, hip, p["k"], p["c"], 1)
    heel = intersection(back, knee, p["f"], p["g"], -1)
    return placed(top=top, knee=knee, heel=heel, foot=intersection(heel, knee, p["h"], p["i"], -1))


def rack_steering(angle, p):
    """Return the rack and the ends of the steering arms."""
    rack = p["radius"] * angle - 1j * p["behind"]
    right = intersection(rack + p["rack"] / 2.0, p["track"] / 2.0 + 0j, p["rod"], p["arm"], -1)
    left = intersection(rack - p["rack"] / 2.0, -p["track"] / 2.0 + 0j, p["rod"], p["arm"], 1)
    return placed(rack=rack, left=left, right=right)
