"""Laws of mechanisms of the gallery with slides, straight lines and plates that do not turn.

A function takes crank angles in [rad], (n,), and the parameters of its file, in mm and degrees, and returns
the tracked points, (n, 3) in [m].
"""

import numpy as np


def placed(x, y, z=0.0):
    """Return a point in mm as (n, 3) in [m]."""
    return np.column_stack(np.broadcast_arrays(x, y, z)) / 1000.0


def quick_return(angle, p):
    """Return block, end of the lever and ram: the lever points at the block."""
    x, y = p["crank"] * np.cos(angle), p["ground"] + p["crank"] * np.sin(angle)
    from_pivot = np.hypot(x, y)
    end_x, end_y = p["lever"] * x / from_pivot, p["lever"] * y / from_pivot
    ram = end_x + np.sqrt(p["rod"] ** 2 - (p["height"] - end_y) ** 2)
    return {"block": placed(x, y), "end": placed(end_x, end_y), "ram": placed(ram, p["height"])}


def scotch_yoke(angle, p):
    """Return pin and yoke: the yoke has the pin's abscissa."""
    x = p["crank"] * np.cos(angle)
    return {"pin": placed(x, p["crank"] * np.sin(angle)), "yoke": placed(x, 0.0)}


def elliptic_trammel(angle, p):
    """Return both ends of the bar, on the axes, and the pen on its ellipse."""
    return {
        "A": placed(-p["bar"] * np.cos(angle), 0.0),
        "B": placed(0.0, p["bar"] * np.sin(angle)),
        "pen": placed(p["arm"] * np.cos(angle), (p["bar"] + p["arm"]) * np.sin(angle)),
    }


def peaucellier_lipkin(angle, p):
    """Return Q on its circle through the centre, and P, its inverse."""
    x, y = p["crank"] * (1.0 + np.cos(angle)), p["crank"] * np.sin(angle)
    power = (p["long"] ** 2 - p["side"] ** 2) / (x**2 + y**2)
    return {"Q": placed(x, y), "P": placed(power * x, power * y)}


def parallel_gripper(angle, p):
    """Return the pads: the fingers do not turn."""
    x = p["base"] + p["arm"] * np.cos(angle) - p["pad"]
    y = p["arm"] * np.sin(angle) + p["reach"]
    return {"right": placed(x, y), "left": placed(-x, y)}


def sarrus(angle, p):
    """Return the plate, straight above the base, and the elbows."""
    out, up = p["lower"] * np.cos(angle), p["lower"] * np.sin(angle)
    height = up + np.sqrt(p["upper"] ** 2 - out**2)
    second = np.sqrt(p["second"] ** 2 - (height / 2.0) ** 2)
    return {
        "top": placed(0.0, 0.0, height),
        "elbow_1": placed(p["half"] + out, 0.0, up),
        "elbow_2": placed(0.0, p["half"] + second, height / 2.0),
    }


def cam_follower(angle, p):
    """Return the roller's centre: the cycloidal law over rise and return."""
    halves = np.mod(angle, 2.0 * np.pi) / np.pi
    u = np.minimum(np.mod(halves, 1.0) * 180.0 / p["rise"], 1.0)
    law = u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi)
    lift = p["lift"] * np.where(halves < 1.0, law, 1.0 - law)
    start = np.sqrt((p["base"] + p["roller"]) ** 2 - p["offset"] ** 2)
    return {"roller": placed(p["offset"], start + lift)}


def geneva_drive(angle, p):
    """Return the pin and the end of a slot: the pin in the slot turns the wheel, which rests otherwise."""
    # the file is in [m] and [rad]
    step, distance = np.pi / p["slots"], 1000.0 * p["distance"]
    crank = distance * np.sin(step)
    turns = np.round(angle / (2.0 * np.pi))
    q = np.clip(angle - 2.0 * np.pi * turns, step - np.pi / 2.0, np.pi / 2.0 - step)
    wheel = -2.0 * step * turns - np.arctan2(crank * np.sin(q), distance - crank * np.cos(q))
    arm = crank - distance
    return {
        "pin": placed(crank * np.cos(angle), crank * np.sin(angle)),
        "slot": placed(distance + arm * np.cos(wheel), arm * np.sin(wheel)),
    }
