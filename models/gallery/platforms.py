"""Laws of machines of the gallery with several drivers.

A function takes the drivers' coordinates, name -> (n,) in [rad] or [m], and the parameters of its file, in mm
and degrees, and returns the tracked points, (n, 3) in [m].
"""

import numpy as np


def solved(residual, start, count):
    """Return the roots (k, n) of k analytic equations at n instants, by Newton from one start for all.

    The Jacobian is by complex steps, exact to rounding.
    """
    x = np.repeat(np.array(start, dtype=float)[:, None], count, axis=1)
    for _ in range(30):
        jacobian = np.empty((count, len(x), len(x)))
        for i in range(len(x)):
            step = np.zeros_like(x, dtype=complex)
            step[i] = 1e-30j
            jacobian[:, :, i] = residual(x + step).imag.T * 1e30
        x = x - np.linalg.solve(jacobian, residual(x).T[..., None])[..., 0].T
    return x


def rotated(vector, x, y, z):
    """Return a vector, (3,), rotated about x, then y, then z, as (3, n)."""
    a, b, c = vector
    b, c = b * np.cos(x) - c * np.sin(x), b * np.sin(x) + c * np.cos(x)
    a, c = a * np.cos(y) + c * np.sin(y), c * np.cos(y) - a * np.sin(y)
    return np.array([a * np.cos(z) - b * np.sin(z), a * np.sin(z) + b * np.cos(z), c + 0.0 * z])


def excess(first, second, distance):
    """Return the square of the distance of points (3, n) minus that of a distance."""
    return ((first - second) ** 2).sum(0) - distance**2


def around(radius, angle, height=0.0):
    """Return a point on a circle about z, its angle in degrees, (3,)."""
    return radius * np.cos(np.deg2rad(angle)), radius * np.sin(np.deg2rad(angle)), height


def upright(points):
    """Return points (3, n) in mm whose height is their third coordinate as (n, 3) in [m], height along y."""
    return np.column_stack([points[0], points[2], -points[1]]) / 1000.0


def column(vector):
    """Return a vector as (3, 1)."""
    return np.array(vector)[:, None]


def coordinates(drivers, letter, count):
    """Return the coordinates of drivers called l1, l2 and so on."""
    return [drivers[f"{letter}{i + 1}"] for i in range(count)]


def five_bar(drivers, p):
    """Return the tool, above the line between the elbows."""
    left = -p["half"] + p["arm"] * np.exp(1j * drivers["left"])
    right = p["half"] + p["arm"] * np.exp(1j * drivers["right"])
    half = (right - left) / 2.0
    tool = left + half * (1.0 + 1j * np.sqrt(p["forearm"] ** 2 / abs(half) ** 2 - 1.0))
    return {"P": np.column_stack([tool.real, tool.imag, 0.0 * tool.real]) / 1000.0}


def planar_3rrr(drivers, p):
    """Return the plate's centre and a corner."""
    angles = (90.0, 210.0, 330.0)
    elbows = [
        column(around(p["base"], angle)) + p["arm"] * np.array([np.cos(q), np.sin(q), 0.0 * q])
        for angle, q in zip(angles, coordinates(drivers, "m", 3), strict=True)
    ]

    def corner(x, angle):
        zero = 0.0 * x[2]
        return np.array([x[0], x[1], zero]) + rotated(around(p["plate"], angle), zero, zero, x[2])

    def residual(x):
        return np.array(
            [excess(corner(x, angle), e, p["forearm"]) for angle, e in zip(angles, elbows, strict=True)]
        )

    x = solved(residual, (0.0, 0.0, 0.0), len(drivers["m1"]))
    return {
        "P": np.column_stack([x[0], x[1], 0.0 * x[0]]) / 1000.0,
        "corner": corner(x, 90.0).T / 1000.0,
    }


def delta_robot(drivers, p):
    """Return the plate's centre, where three spheres meet, and the first elbow."""
    elbows = [
        column(around(p["base"], angle))
        + p["arm"] * (np.cos(q) * column(around(1.0, angle)) - np.sin(q) * column((0.0, 0.0, 1.0)))
        for angle, q in zip((0.0, 120.0, 240.0), coordinates(drivers, "m", 3), strict=True)
    ]
    a, b, c = (
        (elbow - column(around(p["plate"], angle))).T
        for angle, elbow in zip((0.0, 120.0, 240.0), elbows, strict=True)
    )
    # the centre lies on the line through the triangle's circumcentre, square to it
    u, v = b - a, c - a
    normal = np.cross(u, v)
    square = (normal**2).sum(1, keepdims=True)
    centre = np.cross((u**2).sum(1, keepdims=True) * v - (v**2).sum(1, keepdims=True) * u, normal)
    centre = centre / (2.0 * square)
    height = np.sqrt((p["forearm"] ** 2 - (centre**2).sum(1, keepdims=True)) / square)
    return {"P": upright((a + centre - height * normal).T), "E1": upright(elbows[0])}


def stewart_gough(drivers, p):
    """Return the plate's centre and a corner."""
    feet = [column(around(p["base"], angle)) for angle in (10.0, 110.0, 130.0, 230.0, 250.0, 350.0)]
    corners = (50.0, 70.0, 170.0, 190.0, 290.0, 310.0)
    legs = [1000.0 * length for length in coordinates(drivers, "l", 6)]

    def corner(x, angle):
        return x[:3] + rotated(around(p["plate"], angle), *x[3:])

    def residual(x):
        ends = zip(feet, corners, legs, strict=True)
        return np.array([excess(corner(x, angle), foot, leg) for foot, angle, leg in ends])

    x = solved(residual, (0.0, 0.0, p["height"], 0.0, 0.0, 0.0), len(drivers["l1"]))
    return {"P": upright(x[:3]), "corner": upright(corner(x, 50.0))}


def humanoid_ankle(drivers, p):
    """Return toe and heel of the foot, which rolls, then pitches."""
    sides = (("left", p["half"], p["left_up"]), ("right", -p["half"], p["right_up"]))

    def point(x, vector):
        return rotated(vector, x[1], x[0], 0.0 * x[0])

    def residual(x):
        rows = []
        for name, aside, up in sides:
            q = drivers[name]
            pin = np.array([-p["crank"] * np.cos(q), 0.0 * q, p["crank"] * np.sin(q)])
            pin = pin + column((p["crank"] - p["back"], aside, up))
            rows.append(excess(point(x, (-p["back"], aside, p["foot_up"])), pin, up - p["foot_up"]))
        return np.array(rows)

    x = solved(residual, (0.0, 0.0), len(drivers["left"]))
    return {
        "toe": upright(point(x, (110.0, 0.0, -30.0))),
        "heel": upright(point(x, (-40.0, 20.0, -30.0))),
    }
