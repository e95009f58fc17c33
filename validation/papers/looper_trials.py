"""Trials of the search in looper_search.py: many loopers at once, evaluated by array operations.

Lengths are in units of the crank; arrays have shape (..., m) for m trials.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.looper import Looper

Array = NDArray[np.float64]

NODES = 17
TURN_STEPS = 120
# reweightings; a dozen come within a tenth of the best approximation
ROUNDS = 12
# cost of a trial that violates a condition; valid trials cost less
PENALTY = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of a straighter linkage.

    Attributes:
        stroke: smallest and largest extent of C along the line, in [m]; the follower's length and the stroke
            determine its swing.
        width: smallest extent of C across the line, in [m].
        clearance: smallest distance of the return path of C from the line, over `needle`, in [m].
        needle: part of the line at its middle where needles pass, in [m].
        transmission: smallest angle between coupler and rocker, in [rad].
        longest: largest length of a link or the frame, in [m].
        centred: largest distance of the follower's axis from the middle of the stroke, in [m].

    Source: stroke, width and swing are the paper's. It prints no limits of the other three. Its
    linkage has a clearance of 1.47 mm at the middle of its straightest 11 mm, transmission angles from
    58.9 degrees, and a longest link of 35.4 mm.
    """

    stroke: tuple[float, float] = (0.0133, 0.0138)
    width: float = 0.003
    clearance: float = 0.00145
    needle: float = 0.004
    transmission: float = np.deg2rad(45.0)
    longest: float = 0.040
    centred: float = 0.0005


@dataclass(frozen=True, slots=True)
class Trials:
    """Dimensions and line of each trial, (m,), in units of the crank."""

    coupler: Array
    arm: Array
    arm_angle: Array
    line: Array
    middle: Array
    axis: Array


def trials_of(x: Array, base: Looper) -> Trials:
    """Return the trials of the search variables, (3 or 6, m)."""
    unit, unit_row = base.crank, np.ones(x.shape[1])
    coupler_values = (
        x[3:]
        if len(x) > 3
        else [base.coupler / unit * unit_row, base.arm / unit * unit_row, base.arm_angle * unit_row]
    )
    return Trials(coupler_values[0], coupler_values[1], coupler_values[2], x[0], x[1] + x[2], x[1])


def cost(trials: Trials, length: float, base: Looper, conditions: Conditions, margin: float) -> Array:
    """Return the error of the line in units of the crank, or a penalty for violated conditions, (m,)."""
    unit = base.crank
    y = trials.middle - 0.5 * length * np.cos(np.pi * np.arange(NODES) / (NODES - 1))[:, None]  # (nodes, m)
    x = trials.line + np.zeros_like(y)
    z = _depth(y - trials.axis, base)
    pin, b = _dyad(trials, np.stack([x, y]), z)
    centre, radius2, error = _circle(b, np.stack([x, y]), pin)
    frame, rocker = np.hypot(*centre), np.sqrt(radius2)
    cosine_low = (trials.coupler**2 + rocker**2 - (frame - 1.0) ** 2) / (2.0 * trials.coupler * rocker)
    cosine_high = (trials.coupler**2 + rocker**2 - (frame + 1.0) ** 2) / (2.0 * trials.coupler * rocker)
    orientation = _cross(b - centre[:, None], pin - centre[:, None])
    violations = [
        np.maximum(np.abs(cosine_low), np.abs(cosine_high)) - np.cos(conditions.transmission),
        1.01 - frame,
        np.maximum(rocker, frame) * unit / conditions.longest - 1.0 + margin,
        1.0 - np.abs(np.sign(orientation).sum(0)) / NODES,
    ]
    path = _path(trials, centre, rocker, np.sign(orientation[0]), base)
    stroke, lowest = np.ptp(path[1], axis=0), path[1].min(0)
    passing = np.abs(path[1] - trials.middle) <= 0.5 * conditions.needle / unit
    # on its return path C moves backwards along Y while the crank rotates forwards
    outward = np.sign(_cross(pin[:, 0], pin[:, -1]))
    returning = outward * (np.roll(path[1], -1, 0) - np.roll(path[1], 1, 0)) < 0.0
    return_distance = np.where(passing & returning, np.abs(path[0] - trials.line), np.inf).min(0)
    violations += [
        (conditions.stroke[0] / unit - stroke) / stroke + margin,
        (stroke - conditions.stroke[1] / unit) / stroke + margin,
        1.0 - np.ptp(path[0], axis=0) / (conditions.width / unit) + margin,
        1.0 - return_distance / (conditions.clearance / unit) + margin,
        (np.abs(lowest + 0.5 * stroke - trials.axis) - conditions.centred / unit) / stroke + margin,
    ]
    violation = np.sum([np.maximum(value, 0.0) for value in violations], axis=0)
    invalid = ~np.isfinite(violation + error)
    return np.where(
        invalid,
        10.0 * PENALTY,
        np.where(violation > 0.0, PENALTY * (1.0 + np.minimum(violation, 8.0)), error),
    )


def _depth(height: Array, base: Looper) -> Array:
    """Return z of C on the cylinder at a height above its axis, in units of the crank."""
    f, p = base.follower / base.crank, base.axis_z / base.crank
    return p - np.copysign(np.sqrt((f - height) * (f + height)), p)


def _dyad(trials: Trials, c: Array, z: Array) -> tuple[Array, Array]:
    """Return A and B for positions of C, (2, nodes, m) each."""
    k = np.sqrt(trials.arm**2 - z**2)
    cosine = trials.arm * np.cos(trials.arm_angle) / k
    sine = np.sign(np.sin(trials.arm_angle)) * np.sqrt(1.0 - cosine**2)
    reach = np.hypot(*c)
    # the paper's assembly: A lies left of the line from O1 to C
    angle = np.arctan2(c[1], c[0]) + np.arccos((1.0 + reach**2 - k**2) / (2.0 * reach))
    pin = np.stack([np.cos(angle), np.sin(angle)])
    x, y = (c - pin) / k
    b = pin + trials.coupler * np.stack([cosine * x + sine * y, cosine * y - sine * x])
    return pin, b


def _circle(b: Array, c: Array, pin: Array) -> tuple[Array, Array, Array]:
    """Return centre (2, m), squared radius and error of the line (m,) of nearly best circles."""
    middle = b.mean(1, keepdims=True)
    shifted = b - middle
    radius = np.sqrt((shifted**2).sum(0).max(0))
    u, v = shifted / radius
    basis = np.stack([2.0 * u, 2.0 * v, np.ones_like(u)], -1).swapaxes(0, 1)  # (m, nodes, 3)
    target = (u**2 + v**2).T
    usable = np.isfinite(basis).all((1, 2)) & np.isfinite(target).all(1)
    basis, target = (
        np.where(usable[:, None, None], basis, np.eye(NODES, 3)),
        np.where(usable[:, None], target, 0.0),
    )
    weights = np.ones_like(target)
    centre, radius2, distance = middle[:, 0], np.ones(len(target)), target
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        q, r = np.linalg.qr(root[..., None] * basis)
        singular = ~(np.abs(np.diagonal(r, axis1=1, axis2=2)).min(1) > 1e-12)
        r = np.where(singular[:, None, None], np.eye(3), r)
        p = np.linalg.solve(r, (np.swapaxes(q, 1, 2) @ (root * target)[..., None]))[..., 0]
        error = (target - (basis @ p[..., None])[..., 0]) * radius[:, None] ** 2
        centre = middle[:, 0] + radius * p[:, :2].T
        radius2 = radius**2 * (p[:, 2] + p[:, 0] ** 2 + p[:, 1] ** 2)
        distance = np.where(singular[:, None], np.nan, np.abs(error) * _sensitivity(b, c, pin, centre))
        # Lawson: weights grow with the error, which reduces the largest error
        weights = weights * (distance / distance.max(1, keepdims=True) + 1e-3)
        weights = np.where(np.isfinite(weights), weights, 1.0)
        weights /= weights.max(1, keepdims=True)
    return centre, radius2, np.where(usable, distance.max(1), np.nan)


def _sensitivity(b: Array, c: Array, pin: Array, centre: Array) -> Array:
    """Return the deviation of C for a unit error of |B - O2|2, as in the plane, (m, nodes)."""
    lever = 2.0 * np.abs(_cross(b - pin, b - centre[:, None]))
    return (np.abs(c[1] - pin[1]) / lever).T


def _path(trials: Trials, centre: Array, rocker: Array, branch: Array, base: Looper) -> Array:
    """Return positions of C over a revolution, in the XY plane, (2, steps, m)."""
    angles = (2.0 * np.pi * np.arange(TURN_STEPS) / TURN_STEPS)[:, None]
    pin = np.stack([np.cos(angles), np.sin(angles)])
    to_pin = pin - centre[:, None]
    reach2 = (to_pin**2).sum(0)
    along = (reach2 + rocker**2 - trials.coupler**2) / (2.0 * reach2)
    across = branch * np.sqrt(rocker**2 / reach2 - along**2)
    # branch is the sign of O2B . (O2A x eZ)
    b = centre[:, None] + along * to_pin + across * np.stack([to_pin[1], -to_pin[0]])
    x, y = (b - pin) / trials.coupler
    c, s = trials.arm * np.cos(trials.arm_angle), trials.arm * np.sin(trials.arm_angle)
    # the arm leaves the plane by z, so its projection is shorter; the change of y hardly affects z
    z = _depth(pin[1] + c * y + s * x - trials.axis, base)
    s = np.sign(s) * np.sqrt(s**2 - z**2)
    return pin + np.stack([c * x - s * y, c * y + s * x])


def _cross(u: Array, v: Array) -> Array:
    return u[0] * v[1] - u[1] * v[0]
