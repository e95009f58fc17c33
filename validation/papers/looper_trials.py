"""Trials of the search in looper_search.py: many loopers side by side, checked by a few array operations.

Everything is in units of the crank and of shape (..., m) for m trials.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.looper import Looper

Array = NDArray[np.float64]

NODES = 17
TURN_STEPS = 120
# reweightings towards the best approximation, of which a dozen come within a tenth
ROUNDS = 12
# a trial that breaks a condition costs more than any that does not
BROKEN = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What a straighter linkage must keep.

    Attributes:
        stroke: least and greatest extent of C along the line over the turn, in [m]; with the follower's
            length it is the follower's swing.
        width: least extent of C across the line over the turn, in [m].
        clearance: least distance of C's path back from the line, over `needle`, in [m].
        needle: part of the line at its middle where needles pass, in [m].
        transmission: least angle between coupler and rocker over the turn, in [rad].
        longest: no link, nor the frame, is longer, in [m].
        centred: greatest distance of the follower's axis from the middle of the stroke, in [m].

    Source: stroke, width and swing are the paper's. It prints no bounds for the other three; its own
    linkage clears 1.47 mm about the middle of its straightest 11 mm, transmits by 58.9 degrees at the
    least, and has no link above 35.4 mm.
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
    """Linkages side by side, (m,) each in units of the crank, and how far each one's line error goes."""

    coupler: Array
    arm: Array
    arm_angle: Array
    line: Array
    middle: Array
    axis: Array


def trials_of(x: Array, base: Looper) -> Trials:
    """Return what the search's variables mean, (3 or 6, m)."""
    unit, same = base.crank, np.ones(x.shape[1])
    rest = (
        x[3:] if len(x) > 3 else [base.coupler / unit * same, base.arm / unit * same, base.arm_angle * same]
    )
    return Trials(rest[0], rest[1], rest[2], x[0], x[1] + x[2], x[1])


def cost(trials: Trials, length: float, base: Looper, wanted: Conditions, spare: float) -> Array:
    """Return the error of the line in units of the crank, or `BROKEN` and by how much, (m,)."""
    unit = base.crank
    y = trials.middle - 0.5 * length * np.cos(np.pi * np.arange(NODES) / (NODES - 1))[:, None]  # (nodes, m)
    x = trials.line + np.zeros_like(y)
    z = _depth(y - trials.axis, base)
    pin, b = _dyad(trials, np.stack([x, y]), z)
    centre, radius2, slack = _circle(b, np.stack([x, y]), pin)
    frame, rocker = np.hypot(*centre), np.sqrt(radius2)
    low = (trials.coupler**2 + rocker**2 - (frame - 1.0) ** 2) / (2.0 * trials.coupler * rocker)
    high = (trials.coupler**2 + rocker**2 - (frame + 1.0) ** 2) / (2.0 * trials.coupler * rocker)
    bent = _wedge(b - centre[:, None], pin - centre[:, None])
    faults = [
        np.maximum(np.abs(low), np.abs(high)) - np.cos(wanted.transmission),
        1.01 - frame,
        np.maximum(rocker, frame) * unit / wanted.longest - 1.0 + spare,
        1.0 - np.abs(np.sign(bent).sum(0)) / NODES,
    ]
    path = _path(trials, centre, rocker, np.sign(bent[0]), base)
    stroke, lowest = np.ptp(path[1], axis=0), path[1].min(0)
    passing = np.abs(path[1] - trials.middle) <= 0.5 * wanted.needle / unit
    # on its path back C moves backwards along Y, the crank still turning forwards
    outward = np.sign(_wedge(pin[:, 0], pin[:, -1]))
    returning = outward * (np.roll(path[1], -1, 0) - np.roll(path[1], 1, 0)) < 0.0
    back = np.where(passing & returning, np.abs(path[0] - trials.line), np.inf).min(0)
    faults += [
        (wanted.stroke[0] / unit - stroke) / stroke + spare,
        (stroke - wanted.stroke[1] / unit) / stroke + spare,
        1.0 - np.ptp(path[0], axis=0) / (wanted.width / unit) + spare,
        1.0 - back / (wanted.clearance / unit) + spare,
        (np.abs(lowest + 0.5 * stroke - trials.axis) - wanted.centred / unit) / stroke + spare,
    ]
    worse = np.sum([np.maximum(fault, 0.0) for fault in faults], axis=0)
    bad = ~np.isfinite(worse + slack)
    return np.where(bad, 10.0 * BROKEN, np.where(worse > 0.0, BROKEN * (1.0 + np.minimum(worse, 8.0)), slack))


def _depth(height: Array, base: Looper) -> Array:
    """Return z of C on the cylinder at a height above its axis, in units of the crank."""
    f, p = base.follower / base.crank, base.axis_z / base.crank
    return p - np.copysign(np.sqrt((f - height) * (f + height)), p)


def _dyad(trials: Trials, c: Array, z: Array) -> tuple[Array, Array]:
    """Return A and B with C at given places, (2, nodes, m) each."""
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
    """Return centre (2, m), radius squared and the error of the line (m,) of nearly best circles."""
    middle = b.mean(1, keepdims=True)
    near = b - middle
    size = np.sqrt((near**2).sum(0).max(0))
    u, v = near / size
    basis = np.stack([2.0 * u, 2.0 * v, np.ones_like(u)], -1).swapaxes(0, 1)  # (m, nodes, 3)
    goal = (u**2 + v**2).T
    usable = np.isfinite(basis).all((1, 2)) & np.isfinite(goal).all(1)
    basis, goal = (
        np.where(usable[:, None, None], basis, np.eye(NODES, 3)),
        np.where(usable[:, None], goal, 0.0),
    )
    weights = np.ones_like(goal)
    centre, radius2, away = middle[:, 0], np.ones(len(goal)), goal
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        q, r = np.linalg.qr(root[..., None] * basis)
        singular = ~(np.abs(np.diagonal(r, axis1=1, axis2=2)).min(1) > 1e-12)
        r = np.where(singular[:, None, None], np.eye(3), r)
        p = np.linalg.solve(r, (np.swapaxes(q, 1, 2) @ (root * goal)[..., None]))[..., 0]
        error = (goal - (basis @ p[..., None])[..., 0]) * size[:, None] ** 2
        centre = middle[:, 0] + size * p[:, :2].T
        radius2 = size**2 * (p[:, 2] + p[:, 0] ** 2 + p[:, 1] ** 2)
        away = np.where(singular[:, None], np.nan, np.abs(error) * _lever(b, c, pin, centre))
        # Lawson: weights grow where the error is, so that its greatest value falls
        weights = weights * (away / away.max(1, keepdims=True) + 1e-3)
        weights = np.where(np.isfinite(weights), weights, 1.0)
        weights /= weights.max(1, keepdims=True)
    return centre, radius2, np.where(usable, away.max(1), np.nan)


def _lever(b: Array, c: Array, pin: Array, centre: Array) -> Array:
    """Return by how much C leaves the line for an error of one in |B - O2|2, as in the plane, (m, nodes)."""
    closed = 2.0 * np.abs(_wedge(b - pin, b - centre[:, None]))
    return (np.abs(c[1] - pin[1]) / closed).T


def _path(trials: Trials, centre: Array, rocker: Array, branch: Array, base: Looper) -> Array:
    """Return places of C over a turn, seen along Z, (2, steps, m)."""
    turn = (2.0 * np.pi * np.arange(TURN_STEPS) / TURN_STEPS)[:, None]
    pin = np.stack([np.cos(turn), np.sin(turn)])
    to_pin = pin - centre[:, None]
    reach2 = (to_pin**2).sum(0)
    ahead = (reach2 + rocker**2 - trials.coupler**2) / (2.0 * reach2)
    beside = branch * np.sqrt(rocker**2 / reach2 - ahead**2)
    # branch is the sign of O2B . (O2A x eZ)
    b = centre[:, None] + ahead * to_pin + beside * np.stack([to_pin[1], -to_pin[0]])
    x, y = (b - pin) / trials.coupler
    c, s = trials.arm * np.cos(trials.arm_angle), trials.arm * np.sin(trials.arm_angle)
    # out of the plane by z, which hardly depends on how little that lowers C, the arm shows shorter
    z = _depth(pin[1] + c * y + s * x - trials.axis, base)
    s = np.sign(s) * np.sqrt(s**2 - z**2)
    return pin + np.stack([c * x - s * y, c * y + s * x])


def _wedge(u: Array, v: Array) -> Array:
    return u[0] * v[1] - u[1] * v[0]
